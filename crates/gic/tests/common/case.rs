//! A folder with a twin in it.

use std::fs;
use std::path::PathBuf;

use serde_json::Value;
use tempfile::TempDir;

pub(crate) struct Case {
    folder: TempDir,
}

impl Case {
    pub(crate) fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes twin.json.
    pub(crate) fn write(&self, twin: &Value) -> PathBuf {
        let path = self.path("twin.json");
        fs::write(&path, twin.to_string()).unwrap();
        path
    }
}
