//! What can go wrong with a calibration. Every message names the camera or file; the hint says the way out.

use gic_film::FilmError;
use gic_twin::TwinError;

/// A failure of a calibration.
#[derive(Debug, thiserror::Error)]
pub enum CalibrateError {
    /// Films or pictures that could not be read.
    #[error(transparent)]
    Film(#[from] FilmError),
    /// A file that could not be written, or an interruption.
    #[error(transparent)]
    Twin(#[from] TwinError),
    /// What was filmed does not tell the cameras.
    #[error("{problem}")]
    Pictures {
        /// What is wrong, with the camera's name.
        problem: String,
        /// What to do about it.
        hint: String,
    },
    /// Something that was asked for cannot be done.
    #[error("{problem}")]
    Usage {
        /// What.
        problem: String,
        /// What to do about it.
        hint: String,
    },
}

/// Result of a calibration.
pub type Result<T> = std::result::Result<T, CalibrateError>;

impl CalibrateError {
    /// The way out, in one sentence, where there is one.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Film(error) => error.hint(),
            Self::Twin(error) => error.hint(),
            Self::Pictures { hint, .. } | Self::Usage { hint, .. } => Some(hint.clone()),
        }
    }

    /// Whether the user interrupted.
    pub fn is_interrupt(&self) -> bool {
        match self {
            Self::Film(error) => error.is_interrupt(),
            Self::Twin(error) => error.is_interrupt(),
            _ => false,
        }
    }

    /// Whether the command was wrong, whatever its files hold.
    pub fn is_usage(&self) -> bool {
        match self {
            Self::Film(error) => error.is_usage(),
            _ => matches!(self, Self::Usage { .. }),
        }
    }

    /// A [`CalibrateError::Pictures`].
    pub(crate) fn pictures(problem: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Pictures { problem: problem.into(), hint: hint.into() }
    }

    /// A [`CalibrateError::Usage`].
    pub(crate) fn usage(problem: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Usage { problem: problem.into(), hint: hint.into() }
    }
}
