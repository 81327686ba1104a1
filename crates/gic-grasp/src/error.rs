//! What can go wrong in a grasp; [`GraspError::hint`] says the way out.

use gic_twin::TwinError;
use gic_view::ViewError;

/// A failure of a grasp.
#[derive(Debug, thiserror::Error)]
pub enum GraspError {
    /// A twin, its matter or a file.
    #[error(transparent)]
    Twin(#[from] TwinError),
    /// Pictures of the grasp.
    #[error(transparent)]
    View(#[from] ViewError),
    /// The simulation of the grasp failed.
    #[error("grasp failed")]
    Failed {
        /// What to do about it.
        hint: Option<String>,
        /// The cause.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// Something that the caller asked for cannot be done.
    #[error("{problem}")]
    Usage {
        /// What.
        problem: String,
        /// What to do about it.
        hint: Option<String>,
    },
}

/// Result of a grasp.
pub type Result<T> = std::result::Result<T, GraspError>;

impl GraspError {
    /// The way out, in one sentence, where there is one.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Twin(error) => error.hint(),
            Self::View(error) => error.hint(),
            Self::Failed { hint, .. } | Self::Usage { hint, .. } => hint.clone(),
        }
    }

    /// Whether the request cannot be met, whatever the simulation would do.
    pub fn is_usage(&self) -> bool {
        matches!(self, Self::Usage { .. })
    }

    /// Whether the user interrupted.
    pub fn is_interrupt(&self) -> bool {
        match self {
            Self::Twin(error) => error.is_interrupt(),
            Self::View(error) => error.is_interrupt(),
            Self::Failed { .. } | Self::Usage { .. } => false,
        }
    }

    /// A [`GraspError::Failed`] by another crate's error.
    pub(crate) fn failed(source: impl Into<Box<dyn std::error::Error + Send + Sync>>) -> Self {
        Self::Failed { hint: None, source: source.into() }
    }
}
