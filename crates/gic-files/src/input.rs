//! Files that are read: plain ones only. A pipe never ends and a device never stops giving; both are refused at once.

use std::fs::{self, File};
use std::io;
use std::path::Path;

/// Opens a plain file for reading.
///
/// # Errors
/// What the system says; a folder, a pipe or a device.
pub fn open(path: &Path) -> io::Result<File> {
    check_plain(path)?;
    File::open(path)
}

/// The bytes of a plain file.
///
/// # Errors
/// As [`open`].
pub fn read(path: &Path) -> io::Result<Vec<u8>> {
    check_plain(path)?;
    fs::read(path)
}

/// The text of a plain file.
///
/// # Errors
/// As [`open`]; bytes that are not UTF-8.
pub fn read_to_string(path: &Path) -> io::Result<String> {
    check_plain(path)?;
    fs::read_to_string(path)
}

/// Looks at the file without opening it, because opening a pipe waits for its writer.
fn check_plain(path: &Path) -> io::Result<()> {
    let kind = fs::metadata(path)?.file_type();
    match (kind.is_file(), kind.is_dir()) {
        (true, _) => Ok(()),
        (_, true) => Err(io::Error::new(io::ErrorKind::IsADirectory, "it is a folder; give a file")),
        _ => Err(io::Error::new(io::ErrorKind::InvalidInput, "it is a pipe or a device; save its content as a file")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_plain_files_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        fs::write(&path, b"text").unwrap();
        assert_eq!(read_to_string(&path).unwrap(), "text");
        assert_eq!(read(folder.path()).unwrap_err().kind(), io::ErrorKind::IsADirectory);
        assert_eq!(open(&folder.path().join("none")).unwrap_err().kind(), io::ErrorKind::NotFound);
    }

    #[cfg(unix)]
    #[test]
    fn a_pipe_is_refused_at_once() {
        use nix::sys::stat::Mode;
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        nix::unistd::mkfifo(&pipe, Mode::S_IRUSR | Mode::S_IWUSR).unwrap();
        assert!(open(&pipe).unwrap_err().to_string().contains("pipe"));
        assert!(open(Path::new("/dev/zero")).unwrap_err().to_string().contains("device"));
    }
}
