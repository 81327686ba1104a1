//! What can go wrong with a file. Every message names the file; [`FileError::hint`] says the way out.

use std::io;
use std::path::{Path, PathBuf};

/// A file that cannot be read, written or understood.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    /// A file could not be read.
    #[error("cannot read {}", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// A file or folder could not be written.
    #[error("cannot write {}", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// What the system said.
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
    /// A file or folder has the right syntax and the wrong content, or breaks off.
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

impl FileError {
    /// The way out, in one sentence, where there is one.
    pub fn hint(&self) -> Option<String> {
        match self {
            Self::Read { source, .. } if source.kind() == io::ErrorKind::NotFound => Some("check the path".into()),
            Self::Read { .. } | Self::Syntax { .. } => None,
            Self::Write { source, .. } => write_hint(source),
            Self::Field { hint, .. } | Self::Content { hint, .. } => hint.clone(),
        }
    }

    /// A [`FileError::Read`] of `path`.
    pub fn read(path: &Path) -> impl FnOnce(io::Error) -> FileError {
        move |source| FileError::Read { path: path.to_owned(), source }
    }

    /// A [`FileError::Syntax`] of `path`, which should have been `format`.
    pub fn syntax<E>(path: &Path, format: &'static str) -> impl Fn(E) -> FileError
    where
        E: Into<Box<dyn std::error::Error + Send + Sync>>,
    {
        move |source| FileError::Syntax { path: path.to_owned(), format, source: source.into() }
    }

    /// A [`FileError::Write`] to `path`.
    pub fn write(path: &Path) -> impl FnOnce(io::Error) -> FileError {
        move |source| FileError::Write { path: path.to_owned(), source }
    }
}

/// The way out where a file or folder cannot be written, in one sentence; `None` where what was to be written is at
/// fault, and says so.
fn write_hint(source: &io::Error) -> Option<String> {
    let hint = match source.kind() {
        io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem => {
            "choose a folder that you may write to with -o"
        }
        io::ErrorKind::InvalidData => return None,
        io::ErrorKind::StorageFull => "free some disk space and run the same command again",
        _ => "check that the parent is a folder and not a file, or choose another one with -o",
    };
    Some(hint.into())
}
