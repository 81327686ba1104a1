//! JSON, with finite numbers only.

mod finite;

use std::io::{self, Write};
use std::path::Path;

use serde::Serialize;
use serde_json::Value;

pub use finite::{Unwritable, require_finite};
use gic_files::{FileError, write_with};

/// A value as JSON in one line.
///
/// # Errors
/// [`Unwritable`]: a number that is not finite, or a value that JSON has no form for.
pub fn text(value: &(impl Serialize + ?Sized)) -> Result<String, Unwritable> {
    require_finite(value)?;
    serde_json::to_string(value).map_err(refused)
}

/// A value as JSON, a line for each key.
///
/// # Errors
/// As [`text`].
pub fn text_indented(value: &(impl Serialize + ?Sized)) -> Result<String, Unwritable> {
    require_finite(value)?;
    serde_json::to_string_pretty(value).map_err(refused)
}

/// A value as JSON in memory.
///
/// # Errors
/// As [`text`].
pub fn value(of: &(impl Serialize + ?Sized)) -> Result<Value, Unwritable> {
    require_finite(of)?;
    serde_json::to_value(of).map_err(refused)
}

/// Writes a value as indented JSON with a final newline.
///
/// # Errors
/// As [`text`], and what the system says; then the file is as it was.
pub fn write(path: &Path, value: &(impl Serialize + ?Sized)) -> Result<(), FileError> {
    write_with(path, |out| {
        require_finite(value)?;
        serde_json::to_writer_pretty(&mut *out, value)?;
        out.write_all(b"\n")
    })
}

impl From<Unwritable> for io::Error {
    fn from(reason: Unwritable) -> Self {
        io::Error::new(io::ErrorKind::InvalidData, reason)
    }
}

fn refused(error: serde_json::Error) -> Unwritable {
    Unwritable::Refused(error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_with_a_number_that_is_none_is_not_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.json");
        write(&path, &[1.0, 2.0]).unwrap();
        let failed = write(&path, &[1.0, f64::NAN]).unwrap_err();
        let FileError::Write { source, .. } = failed else { panic!("{failed}") };
        assert!(source.to_string().contains("`[1]` is NaN"), "{source}");
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "[\n  1.0,\n  2.0\n]\n");
        assert!(text(&[f64::NAN]).is_err() && value(&[f64::NAN]).is_err());
        assert_eq!(text(&[1.0]).unwrap(), "[1.0]");
    }
}
