//! What can go wrong with a suite. Every message names the file; [`BenchError::hint`] says the way out.

use std::io;
use std::path::{Path, PathBuf};
use std::process::ExitStatus;

use gic_scene::SceneError;
use gic_twin::TwinError;
use gic_view::ViewError;

/// A failure of a suite.
#[derive(Debug, thiserror::Error)]
pub enum BenchError {
    /// A file of gic's own, or an interruption.
    #[error(transparent)]
    Twin(#[from] TwinError),
    /// The page of a suite.
    #[error(transparent)]
    View(#[from] ViewError),
    /// A file could not be read.
    #[error("cannot read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The cause.
        source: io::Error,
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
    /// A value is missing or of the wrong kind.
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
    /// A file has the right syntax and the wrong content.
    #[error("{}: {problem}", path.display())]
    Content {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        problem: String,
        /// What to do about it.
        hint: Option<String>,
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
            Self::Read { source, .. } if source.kind() == io::ErrorKind::NotFound => Some("check the path".into()),
            Self::Read { .. } | Self::Syntax { .. } => None,
            Self::Program { hint, .. } | Self::Ended { hint, .. } => Some((*hint).into()),
            Self::Scene { .. } => Some("look at it with `gic inspect`".into()),
            Self::Usage { hint, .. } => Some(hint.clone()),
            Self::Field { hint, .. } | Self::Content { hint, .. } => hint.clone(),
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

    /// A [`BenchError::Read`] for `path`.
    pub(crate) fn read(path: &Path) -> impl FnOnce(io::Error) -> Self {
        move |source| Self::Read { path: path.to_owned(), source }
    }
}
