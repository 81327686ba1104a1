//! Folders, and files that appear whole or not at all, with the errors of a twin.

use std::fs::{self, File};
use std::io::{self, BufWriter};
use std::path::Path;

use gic_files::FileError;

use crate::error::{Result, TwinError};

/// Creates a folder and its parents.
///
/// # Errors
/// [`FileError::Write`].
pub fn create_folder(path: &Path) -> Result<()> {
    fs::create_dir_all(path).map_err(TwinError::write(path))
}

/// Writes a file through `fill`.
///
/// # Errors
/// [`FileError::Write`]; the file is then as it was.
pub fn write_with(path: &Path, fill: impl FnOnce(&mut BufWriter<&mut File>) -> io::Result<()>) -> Result<()> {
    Ok(gic_files::write_with(path, fill)?)
}

/// Writes `bytes` as a file.
///
/// # Errors
/// [`FileError::Write`]; the file is then as it was.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    Ok(gic_files::write(path, bytes)?)
}

/// Writes `value` as indented JSON with a final newline.
///
/// # Errors
/// [`FileError::Write`], also where a number is not finite; the file is then as it was.
pub fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<()> {
    Ok(crate::json::write(path, value)?)
}

/// Reads a JSON file that a stage wrote.
///
/// # Errors
/// A missing or damaged file.
pub fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T> {
    let text = gic_files::input::read_to_string(path).map_err(|source| match source.kind() {
        io::ErrorKind::NotFound => TwinError::File(FileError::Content {
            path: path.to_owned(),
            problem: "is missing: the stage that writes it has not finished".into(),
            hint: Some("finish the run first with `gic run SCENE -o RUN`".into()),
        }),
        _ => TwinError::read(path)(source),
    })?;
    let parsed = serde_json::from_str(&text).map_err(|error| FileError::Content {
        path: path.to_owned(),
        problem: format!("is not what this version writes there: {error}"),
        hint: Some("if another version wrote it, run the command again into a new folder".into()),
    });
    Ok(parsed?)
}
