//! What can go wrong while drawing. Every message names what it is about; [`ViewError::hint`] says the way out.

use gic_twin::TwinError;

/// A failure of drawing.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// A motion or a file could not be read or written.
    #[error(transparent)]
    Twin(#[from] TwinError),
    /// A step of the work failed.
    #[error("{stage} failed")]
    Stage {
        /// The step.
        stage: &'static str,
        /// What to do about it.
        hint: Option<String>,
        /// The cause.
        source: Box<dyn std::error::Error + Send + Sync>,
    },
    /// Something that the caller asked for cannot be drawn.
    #[error("{problem}")]
    Usage {
        /// What.
        problem: String,
        /// What to do about it.
        hint: Option<String>,
    },
}

/// Result of drawing.
pub type Result<T> = std::result::Result<T, ViewError>;

impl ViewError {
    /// The way out, in one sentence, where there is one.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Twin(error) => error.hint(),
            Self::Stage { hint, .. } | Self::Usage { hint, .. } => hint.clone(),
        }
    }

    /// Whether the user interrupted.
    pub fn is_interrupt(&self) -> bool {
        matches!(self, Self::Twin(error) if error.is_interrupt())
    }

    /// A [`ViewError::Stage`] around another crate's error.
    pub fn stage<E>(stage: &'static str) -> impl FnOnce(E) -> Self
    where
        E: Into<Box<dyn std::error::Error + Send + Sync>>,
    {
        move |source| Self::Stage { stage, hint: None, source: source.into() }
    }
}
