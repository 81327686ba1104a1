//! Files appear whole or not at all: each is written beside its place and then renamed. Numbers in them are finite.
//!
//! A reader sees the old content or all of the new one, and a program that is stopped half-way leaves the old. What the
//! system loses when the machine itself fails is not guarded against: nothing waits for the disk.

mod error;
mod finite;
pub mod input;
mod lock;
mod places;
mod ply;

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use tempfile::{Builder, NamedTempFile};

pub use error::FileError;
pub use finite::{NotFinite, require_finite_numbers};
pub use lock::{FolderLock, LockError};
pub use places::{relative_path, resolved};
pub use ply::{PlyLayout, PlyProperty, write_ply};

/// Ending of a file on its way; its name begins with a dot.
const UNFINISHED_ENDING: &str = ".part";

/// Whether a file's name is that of a file on its way.
fn is_unfinished(name: &std::ffi::OsStr) -> bool {
    let name = name.as_encoded_bytes();
    name.starts_with(b".") && name.ends_with(UNFINISHED_ENDING.as_bytes())
}

/// A file on its way: written beside its place, there once it is [finished](NewFile::finish), gone if it is dropped
/// unfinished.
#[derive(Debug)]
pub struct NewFile {
    part: NamedTempFile,
    path: PathBuf,
}

impl NewFile {
    /// Begins the file that is to appear at `path`, with the permissions that any new file gets.
    ///
    /// # Errors
    /// What the system says where the folder is missing or may not be written to.
    pub fn at(path: &Path) -> Result<NewFile, FileError> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let mut prefix = std::ffi::OsString::from(".");
        prefix.push(path.file_name().unwrap_or_default());
        let mut builder = Builder::new();
        builder.prefix(&prefix).suffix(UNFINISHED_ENDING);
        #[cfg(unix)]
        {
            use std::os::unix::fs::PermissionsExt;
            // The system takes away what the user's mask forbids.
            builder.permissions(std::fs::Permissions::from_mode(0o666));
        }
        let part = builder.tempfile_in(folder).map_err(FileError::write(path))?;
        Ok(NewFile { part, path: path.to_owned() })
    }

    /// Where the content is until the file is finished, for writers that open files by themselves.
    pub fn part(&self) -> &Path {
        self.part.path()
    }

    /// Puts the file at its place.
    ///
    /// # Errors
    /// What the system says, for example where a folder has that name.
    pub fn finish(self) -> Result<(), FileError> {
        let NewFile { part, path } = self;
        part.persist(&path).map(drop).map_err(|refused| FileError::Write { path, source: refused.error })
    }
}

impl Write for NewFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.part.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.part.flush()
    }
}

/// Writes a file through `fill`, buffered.
///
/// # Errors
/// What `fill` or the system says; then the file is as it was.
pub fn write_with(
    path: &Path,
    fill: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>,
) -> Result<(), FileError> {
    let mut new = NewFile::at(path)?;
    let mut writer = BufWriter::new(new.part.as_file_mut());
    fill(&mut writer).and_then(|()| writer.flush()).map_err(FileError::write(path))?;
    drop(writer);
    new.finish()
}

/// Writes `bytes` as a file.
///
/// # Errors
/// What the system says; then the file is as it was.
pub fn write(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    let mut new = NewFile::at(path)?;
    new.write_all(bytes).map_err(FileError::write(path))?;
    new.finish()
}

#[cfg(test)]
mod tests {
    use std::fs;

    use super::*;

    #[test]
    fn a_file_that_fails_half_way_stays_as_it_was_and_leaves_nothing_behind() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write(&path, b"old").unwrap();
        let failed = write_with(&path, |out| {
            out.write_all(&[b'x'; 100_000])?;
            Err(io::Error::other("no more"))
        });
        let FileError::Write { path: named, source } = failed.unwrap_err() else { panic!("no failure to write") };
        assert_eq!((named, source.to_string()), (path.clone(), "no more".to_owned()));
        assert_eq!(fs::read(&path).unwrap(), b"old");
        let unfinished = NewFile::at(&path).unwrap();
        assert!(unfinished.part().exists() && unfinished.part().parent() == Some(folder.path()));
        drop(unfinished);
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn what_was_written_takes_the_place_of_what_was_there() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write(&path, b"a longer content").unwrap();
        write_with(&path, |out| write!(out, "new")).unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"new");
        assert!(write(&folder.path().join("none/a.txt"), b"").is_err());
    }

    /// Temporary files are readable by their owner alone unless asked for otherwise.
    #[cfg(unix)]
    #[test]
    fn permissions_are_those_of_any_new_file() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let mode = |name: &str| fs::metadata(folder.path().join(name)).unwrap().permissions().mode();
        write(&folder.path().join("ours"), b"x").unwrap();
        fs::write(folder.path().join("plain"), b"x").unwrap();
        assert_eq!(mode("ours"), mode("plain"), "{:o} and {:o}", mode("ours"), mode("plain"));
    }
}
