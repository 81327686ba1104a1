//! Reading JSON with errors that name the file and the entry.

use std::path::Path;

use gic_files::FileError;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::error::{Problem, SceneError};

/// Reads a whole JSON file.
pub(crate) fn read<T: DeserializeOwned>(path: &Path) -> Result<T, SceneError> {
    let text = gic_files::input::read(path).map_err(FileError::read(path))?;
    serde_json::from_slice(&text)
        .map_err(|error| SceneError::Malformed { path: path.to_owned(), reason: error.to_string() })
}

/// Reads one entry of a list, so that one bad entry does not hide the others.
pub(crate) fn entry<T: DeserializeOwned>(
    value: Value,
    path: &Path,
    name: impl FnOnce() -> String,
) -> Result<T, Problem> {
    serde_json::from_value(value).map_err(|error| Problem::BadEntry {
        path: path.to_owned(),
        entry: name(),
        reason: error.to_string(),
    })
}
