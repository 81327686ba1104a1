//! What can go wrong with films. Every message names the file; [`FilmError::hint`] says the way out.

use std::path::Path;

use gic_files::FileError;
use gic_scene::SceneError;
use gic_twin::TwinError;

/// A failure of taking films in.
#[derive(Debug, thiserror::Error)]
pub enum FilmError {
    /// A file that cannot be read, written or understood.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file that could not be written, or an interruption.
    #[error(transparent)]
    Twin(#[from] TwinError),
    /// A scene that could not be read.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// ffmpeg or ffprobe is not there.
    #[error("films are decoded by the program {program}, which is not to be found here")]
    NoProgram {
        /// The program.
        program: &'static str,
    },
    /// Something that the caller asked for cannot be done with these films.
    #[error("{problem}")]
    Usage {
        /// What.
        problem: String,
        /// What to do about it.
        hint: String,
    },
}

/// Result of taking films in.
pub type Result<T> = std::result::Result<T, FilmError>;

impl FilmError {
    /// The way out, in one sentence, where there is one.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Twin(error) => error.hint(),
            Self::Scene(_) => None,
            Self::NoProgram { .. } => Some(
                "install ffmpeg (5.1 or later; apt install ffmpeg, brew install ffmpeg, winget install ffmpeg), or \
                 give a folder of numbered PNG or JPEG files for each camera, with --frame-rate-hz"
                    .into(),
            ),
            Self::File(FileError::Read { .. }) => Some("check the path, and that you may read the file".into()),
            Self::File(error) => error.hint(),
            Self::Usage { hint, .. } => Some(hint.clone()),
        }
    }

    /// Whether the user interrupted.
    pub fn is_interrupt(&self) -> bool {
        matches!(self, Self::Twin(error) if error.is_interrupt())
    }

    /// Whether the command was wrong, whatever its files hold.
    pub fn is_usage(&self) -> bool {
        matches!(self, Self::Usage { .. })
    }

    /// A [`FileError::Content`] of `path`.
    pub(crate) fn content(path: &Path, problem: impl Into<String>, hint: impl Into<String>) -> Self {
        FileError::Content { path: path.to_owned(), problem: problem.into(), hint: Some(hint.into()) }.into()
    }

    /// A [`FilmError::Usage`].
    pub(crate) fn usage(problem: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Usage { problem: problem.into(), hint: hint.into() }
    }
}
