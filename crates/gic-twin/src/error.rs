//! What can go wrong with a twin. Every message names the file and the field; [`TwinError::hint`] says the way out.

use std::io;
use std::path::{Path, PathBuf};

use gic_files::{FileError, LockError};
use gic_mpm::SimulationError;

/// A failure around a twin.
#[derive(Debug, thiserror::Error)]
pub enum TwinError {
    /// A file that cannot be read, written or understood.
    #[error(transparent)]
    File(#[from] FileError),
    /// Another process writes into the folder.
    #[error("{} is being written by {holder}", folder.display())]
    Locked {
        /// The folder.
        folder: PathBuf,
        /// Process and host.
        holder: String,
    },
    /// A key that no reader knows.
    #[error("{}: unknown key `{key}`{}", path.display(), nearest_suffix(nearest.as_deref()))]
    UnknownKey {
        /// The file.
        path: PathBuf,
        /// The key with its path inside the file, such as `material.youngs_modulus`.
        key: String,
        /// The valid key that is spelled most alike, if any comes near.
        nearest: Option<String>,
        /// All valid keys at that place.
        valid: Vec<String>,
    },
    /// A folder holds the output of other inputs or settings.
    #[error("{} holds the output of another run: {difference}", path.display())]
    OtherRun {
        /// The folder.
        path: PathBuf,
        /// What differs.
        difference: String,
        /// What to do about it.
        hint: String,
    },
    /// The simulator refused the twin, or failed.
    #[error("{stage} failed")]
    Simulation {
        /// What was being done.
        stage: &'static str,
        /// What to do about it.
        hint: Option<String>,
        /// The cause.
        source: Box<SimulationError>,
    },
    /// Something that the caller asked for cannot be done.
    #[error("{problem}")]
    Usage {
        /// What.
        problem: String,
        /// What to do about it.
        hint: Option<String>,
    },
    /// The user interrupted; what was finished is on disk.
    #[error("interrupted{}", if after.is_empty() { String::new() } else { format!(" after {after}") })]
    Interrupted {
        /// The last thing that was finished.
        after: String,
        /// How to go on.
        resume: String,
    },
}

/// Result around a twin.
pub type Result<T> = std::result::Result<T, TwinError>;

/// The way out of a failure with a file that a twin may name.
pub fn hint_of_file(error: &FileError) -> Option<String> {
    match error {
        FileError::Read { source, .. } if source.kind() == io::ErrorKind::NotFound => {
            Some("check the path; relative paths inside a twin are relative to the twin's own folder".into())
        }
        _ => error.hint(),
    }
}

fn nearest_suffix(nearest: Option<&str>) -> String {
    nearest.map(|n| format!(", did you mean `{n}`?")).unwrap_or_default()
}

impl From<LockError> for TwinError {
    fn from(error: LockError) -> Self {
        match error {
            LockError::Held { folder, holder } => Self::Locked { folder, holder },
            LockError::File(error) => error.into(),
        }
    }
}

impl TwinError {
    /// The way out, in one sentence, where there is one.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::File(error) => hint_of_file(error),
            Self::Locked { .. } => {
                Some("wait until it ends or stop it; commands that only read the folder need not wait".into())
            }
            Self::UnknownKey { valid, .. } => Some(format!("valid keys here: {}", valid.join(", "))),
            Self::Simulation { hint, .. } | Self::Usage { hint, .. } => hint.clone(),
            Self::OtherRun { hint, .. } => Some(hint.clone()),
            Self::Interrupted { resume, .. } => Some(resume.clone()),
        }
    }

    /// A [`FileError::Read`] of `path`.
    pub fn read(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| FileError::read(path)(source).into()
    }

    /// A [`FileError::Write`] to `path`.
    pub fn write(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| FileError::write(path)(source).into()
    }

    /// A [`TwinError::Simulation`] without a hint.
    pub(crate) fn simulation(stage: &'static str) -> impl FnOnce(SimulationError) -> Self {
        move |source| Self::Simulation { stage, hint: None, source: source.into() }
    }

    /// Whether the user interrupted.
    pub fn is_interrupt(&self) -> bool {
        matches!(self, Self::Interrupted { .. })
    }
}
