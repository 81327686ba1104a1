//! What can go wrong with a suite. Every message names the file; [`BenchError::hint`] says the way out.

use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitStatus;

use gic_files::FileError;
use gic_scene::SceneError;
use gic_twin::TwinError;
use gic_view::ViewError;

/// A failure of a suite.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// A file that cannot be read, written or understood.
    #[error(transparent)]
    File(#[from] FileError),
    /// A file of gic's own, or an interruption.
    #[error(transparent)]
    Twin(#[from] TwinError),
    /// The page of a suite.
    #[error(transparent)]
    View(#[from] ViewError),
    /// A program that a cluster or Python brings could not be started.
    #[error("cannot start {program}")]
    Program {
        /// The program.
        program: String,
        /// What to do about it.
        hint: &'static str,
        /// The cause.
        source: io::Error,
    },
    /// Such a program ended with a failure.
    #[error("{program} ended with {status}{}", if words.is_empty() { String::new() } else { format!(": {words}") })]
    Ended {
        /// The program.
        program: String,
        /// How it ended.
        status: ExitStatus,
        /// What it said.
        words: String,
        /// What to do about it.
        hint: &'static str,
    },
    /// A scene could not be read.
    #[error("reading the scene {}", path.display())]
    Scene {
        /// The scene.
        path: PathBuf,
        /// The cause.
        source: SceneError,
    },
    /// Something that the caller asked for cannot be done.
    #[error("{problem}")]
    Usage {
        /// What.
        problem: String,
        /// What to do about it.
        hint: String,
    },
}

/// Result of a suite.
pub type Result<T> = std::result::Result<T, BenchError>;

impl BenchError {
    /// The way out, in one sentence, where there is one.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Twin(error) => error.hint(),
            Self::View(error) => error.hint(),
            Self::File(error) => error.hint(),
            Self::Program { hint, .. } | Self::Ended { hint, .. } => Some((*hint).into()),
            Self::Scene { .. } => Some("look at it with `gic inspect`".into()),
            Self::Usage { hint, .. } => Some(hint.clone()),
        }
    }

    /// Whether the user interrupted.
    pub fn is_interrupt(&self) -> bool {
        match self {
            Self::Twin(error) => error.is_interrupt(),
            Self::View(error) => error.is_interrupt(),
            _ => false,
        }
    }

    /// Whether the command was wrong, whatever its files hold.
    pub fn is_usage(&self) -> bool {
        matches!(self, Self::Usage { .. })
    }

    /// A [`BenchError::Usage`].
    pub(crate) fn usage(problem: impl Into<String>, hint: impl Into<String>) -> Self {
        Self::Usage { problem: problem.into(), hint: hint.into() }
    }

    /// A [`BenchError::Scene`] for `path`.
    pub(crate) fn scene(path: &Path) -> impl FnOnce(SceneError) -> Self {
        move |source| Self::Scene { path: path.to_owned(), source }
    }
}
