//! What can go wrong with a twin. Every message names the file and the field; [`TwinError::hint`] says the way out.

use std::io;
use std::path::{Path, PathBuf};

use gic_files::{LockError, WriteError};
use gic_mpm::SimulationError;

/// A failure around a twin.
#[derive(Debug, thiserror::Error)]
pub enum TwinError {
    /// A file could not be read.
    #[error("cannot read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// A file or folder could not be written.
    #[error("cannot write {}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: io::Error,
    },
    /// Another process writes into the folder.
    #[error("{} is being written by {holder}", folder.display())]
    Locked {
        /// The folder.
        folder: PathBuf,
        /// Process and host.
        holder: String,
    },
    /// A text file does not parse.
    #[error("{} is not valid {format}", path.display())]
    Syntax {
        /// The file.
        path: PathBuf,
        /// What it should have been.
        format: &'static str,
        /// The cause, with line and column.
        source: Box<dyn std::error::Error + Send + Sync>,
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
    /// A value is missing, of the wrong kind or outside its bounds.
    #[error("{}: `{field}` {problem}", path.display())]
    Field {
        /// The file.
        path: PathBuf,
        /// The field with its path inside the file.
        field: String,
        /// What is wrong with it.
        problem: String,
        /// What to do about it.
        hint: Option<String>,
    },
    /// A particle or mesh file has the right syntax and the wrong content, or breaks off.
    #[error("{}: {problem}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
        /// What to do about it.
        hint: Option<String>,
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

fn nearest_suffix(nearest: Option<&str>) -> String {
    nearest.map(|n| format!(", did you mean `{n}`?")).unwrap_or_default()
}

impl From<WriteError> for TwinError {
    fn from(WriteError { path, source }: WriteError) -> Self {
        Self::Write { path, source }
    }
}

impl From<LockError> for TwinError {
    fn from(error: LockError) -> Self {
        match error {
            LockError::Held { folder, holder } => Self::Locked { folder, holder },
            LockError::Write(error) => error.into(),
        }
    }
}

impl TwinError {
    /// The way out, in one sentence, where there is one.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Read { source, .. } if source.kind() == io::ErrorKind::NotFound => {
                Some("check the path; relative paths inside a twin are relative to the twin's own folder".into())
            }
            Self::Read { .. } | Self::Syntax { .. } => None,
            Self::Locked { .. } => {
                Some("wait until it ends or stop it; commands that only read the folder need not wait".into())
            }
            Self::Write { source, .. } => gic_files::write_hint(source),
            Self::UnknownKey { valid, .. } => Some(format!("valid keys here: {}", valid.join(", "))),
            Self::Field { hint, .. }
            | Self::Content { hint, .. }
            | Self::Simulation { hint, .. }
            | Self::Usage { hint, .. } => hint.clone(),
            Self::OtherRun { hint, .. } => Some(hint.clone()),
            Self::Interrupted { resume, .. } => Some(resume.clone()),
        }
    }

    /// A [`TwinError::Read`] for `path`.
    pub fn read(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Read { path: path.to_owned(), source }
    }

    /// A [`TwinError::Write`] for `path`.
    pub fn write(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Write { path: path.to_owned(), source }
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
