//! One writer for a folder at a time. Readers never wait: files appear whole.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use crate::WriteError;

const NAME: &str = ".lock";

/// Why a folder cannot be locked.
#[derive(Debug, thiserror::Error)]
pub enum LockError {
    /// Another process writes into the folder.
    #[error("{} is being written by {holder}", folder.display())]
    Held {
        /// The folder.
        folder: PathBuf,
        /// Process and host of the one that holds it.
        holder: String,
    },
    /// The lock file could not be made.
    #[error(transparent)]
    Write(#[from] WriteError),
}

/// The right to write into a folder. The system takes it back when the process ends, however it ends.
///
/// A file system that knows no locks keeps nobody out.
#[derive(Debug)]
pub struct FolderLock {
    /// Open as long as the lock is held.
    _file: File,
}

impl FolderLock {
    /// Takes the lock of a folder that exists, and leaves process and host in its file for others to read.
    ///
    /// # Errors
    /// [`LockError::Held`] where another process, or another part of this one, has it; an unwritable folder.
    pub fn take(folder: &Path) -> Result<Self, LockError> {
        let path = folder.join(NAME);
        let failed = |source| WriteError { path: path.clone(), source };
        let mut file =
            OpenOptions::new().create(true).read(true).write(true).truncate(false).open(&path).map_err(failed)?;
        match file.try_lock() {
            Ok(()) => (),
            Err(TryLockError::WouldBlock) => {
                return Err(LockError::Held { folder: folder.to_owned(), holder: holder(&mut file) });
            }
            Err(TryLockError::Error(source)) if source.kind() == io::ErrorKind::Unsupported => (),
            Err(TryLockError::Error(source)) => return Err(failed(source).into()),
        }
        let text = format!("process {} on {}\n", std::process::id(), host());
        file.set_len(0).and_then(|()| file.write_all(text.as_bytes())).map_err(failed)?;
        Ok(Self { _file: file })
    }
}

/// Who holds the lock, as its file says.
fn holder(file: &mut File) -> String {
    let mut text = String::new();
    // Some systems do not let others read a locked file, and the holder may not have written its name yet.
    let read = file.read_to_string(&mut text);
    let name = text.trim();
    if read.is_err() || name.is_empty() { "another process".into() } else { name.into() }
}

#[cfg(unix)]
fn host() -> String {
    nix::unistd::gethostname().map_or_else(|_| "an unknown host".into(), |name| name.to_string_lossy().into_owned())
}

#[cfg(not(unix))]
fn host() -> String {
    std::env::var("COMPUTERNAME").unwrap_or_else(|_| "an unknown host".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_second_is_told_who_holds_the_folder_and_gets_it_afterwards() {
        let folder = tempfile::tempdir().unwrap();
        let first = FolderLock::take(folder.path()).unwrap();
        let refused = FolderLock::take(folder.path()).unwrap_err().to_string();
        let process = format!("process {} on ", std::process::id());
        assert!(refused.contains(&process) && refused.contains(folder.path().to_str().unwrap()), "{refused}");
        drop(first);
        FolderLock::take(folder.path()).unwrap();
    }
}
