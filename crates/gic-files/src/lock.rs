//! One writer for a folder at a time. Readers never wait: files appear whole.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::{FileError, is_unfinished};

const NAME: &str = ".lock";
/// How long the name of a lock's holder is waited for: on a busy machine a process may pause before it writes.
const NAME_WAIT: Duration = Duration::from_secs(2);

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
    File(#[from] FileError),
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
    /// Takes the lock of a folder that exists, and leaves process and host in its file for others to read. Unfinished
    /// files in the folder and below go: the process that began them is dead, or it would hold the lock.
    ///
    /// # Errors
    /// [`LockError::Held`] where another process, or another part of this one, has it; an unwritable folder.
    pub fn take(folder: &Path) -> Result<Self, LockError> {
        let path = folder.join(NAME);
        let failed = |source| FileError::Write { path: path.clone(), source };
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
        remove_unfinished(folder);
        Ok(Self { _file: file })
    }
}

/// Removes what [`crate::NewFile`] began and did not finish; folders with a lock of their own are left to its holder.
/// What cannot be removed is in nobody's way.
fn remove_unfinished(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        // Of the entry itself: a link is no folder of the run.
        let Ok(kind) = entry.file_type() else { continue };
        if kind.is_dir() && !entry.path().join(NAME).exists() {
            remove_unfinished(&entry.path());
        } else if kind.is_file() && is_unfinished(&entry.file_name()) {
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// Who holds the lock, as its file says. The holder writes its name right after it has the lock; who comes between
/// waits for the name.
fn holder(file: &mut File) -> String {
    let asked = Instant::now();
    while asked.elapsed() < NAME_WAIT {
        let mut text = String::new();
        match file.rewind().and_then(|()| file.read_to_string(&mut text)) {
            Ok(_) if text.ends_with('\n') => return text.trim().to_owned(),
            Ok(_) => std::thread::sleep(Duration::from_millis(5)),
            // Some systems do not let others read a locked file.
            Err(_) => break,
        }
    }
    "another process".into()
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

    #[test]
    fn a_holder_that_has_not_written_its_name_yet_is_waited_for() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(NAME);
        let mut held = File::create(&path).unwrap();
        held.try_lock().unwrap();
        let late = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(100));
            held.write_all(b"process 7 on a host\n").unwrap();
            held
        });
        let refused = FolderLock::take(folder.path()).unwrap_err().to_string();
        assert!(refused.ends_with("process 7 on a host"), "{refused}");
        drop(late.join().unwrap());
    }

    #[test]
    fn what_a_dead_writer_left_unfinished_goes_and_all_else_stays() {
        let folder = tempfile::tempdir().unwrap();
        let inner = folder.path().join("filling");
        std::fs::create_dir(&inner).unwrap();
        let unfinished = crate::NewFile::at(&inner.join("0003.ply")).unwrap();
        let part = unfinished.part().to_owned();
        // A process that is killed does not tidy up.
        std::mem::forget(unfinished);
        let kept = ["0002.ply", "0002.ply.part", ".hidden"].map(|name| inner.join(name));
        for path in &kept {
            std::fs::write(path, b"x").unwrap();
        }
        assert!(part.exists());
        FolderLock::take(folder.path()).unwrap();
        assert!(!part.exists());
        assert!(kept.iter().all(|path| path.exists()));
    }
}
