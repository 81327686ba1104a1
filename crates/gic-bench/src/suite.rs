//! The scenes of a suite.

use std::path::{Path, PathBuf};

use gic_files::FileError;

use crate::error::{BenchError, Result};
use crate::truth::Truth;

/// A scene with its truth.
pub struct SuiteScene {
    /// Name of its folder.
    pub name: String,
    /// The folder, from the root.
    pub path: PathBuf,
    /// The truth.
    pub truth: Truth,
}

/// The scenes of a folder whose name contains `filter`, by name.
///
/// # Errors
/// No such scene, a truth that cannot be read.
pub fn find_scenes(suite: &Path, filter: &str) -> Result<Vec<SuiteScene>> {
    let entries = std::fs::read_dir(suite).map_err(FileError::read(suite))?;
    let mut folders: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.join("gt/params.json").is_file())
        .collect();
    folders.sort();
    let scenes: Vec<SuiteScene> = folders
        .into_iter()
        .map(|path| (path.file_name().unwrap_or_default().to_string_lossy().into_owned(), path))
        .filter(|(name, _)| name.contains(filter))
        .map(|(name, path)| {
            let path = std::path::absolute(&path).map_err(FileError::read(&path))?;
            Ok(SuiteScene { name, truth: Truth::read(&path.join("gt"))?, path })
        })
        .collect::<Result<_>>()?;
    if scenes.is_empty() {
        return Err(BenchError::File(FileError::Content {
            path: suite.to_owned(),
            problem: format!("has no scene with gt/params.json whose name contains \"{filter}\""),
            hint: Some("give the folder that holds the scenes' folders".into()),
        }));
    }
    Ok(scenes)
}
