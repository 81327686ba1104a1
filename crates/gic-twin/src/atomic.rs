//! Files appear complete or not at all: they are written beside their final place and then renamed.

use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::Path;

use crate::error::{Result, TwinError};

/// Creates a folder and its parents.
pub fn create_folder(path: &Path) -> Result<()> {
    fs::create_dir_all(path).map_err(TwinError::write(path))
}

/// Writes a file through `fill`; readers see the old content or the whole new one, never a part.
pub fn write_with(path: &Path, fill: impl FnOnce(&mut BufWriter<File>) -> std::io::Result<()>) -> Result<()> {
    let mut name = std::ffi::OsString::from(".");
    name.push(path.file_name().unwrap_or_default());
    name.push(".part");
    let part = path.with_file_name(name);
    let written = (|| {
        let mut writer = BufWriter::new(File::create(&part)?);
        fill(&mut writer)?;
        writer.flush()?;
        drop(writer);
        fs::rename(&part, path)
    })();
    written.map_err(|source| {
        // The half-written file is of no use to anyone; the error worth telling is the first one.
        let _ = fs::remove_file(&part);
        TwinError::write(path)(source)
    })
}

/// Writes `bytes` as a file, atomically.
pub fn write(path: &Path, bytes: &[u8]) -> Result<()> {
    write_with(path, |w| w.write_all(bytes))
}

/// Writes `value` as indented JSON with a final newline, atomically.
pub fn write_json(path: &Path, value: &impl serde::Serialize) -> Result<()> {
    write_with(path, |w| {
        serde_json::to_writer_pretty(&mut *w, value)?;
        w.write_all(b"\n")
    })
}

/// Reads a JSON file that a stage wrote.
pub fn read_json<T: serde::de::DeserializeOwned>(path: &Path) -> Result<T> {
    let text = std::fs::read_to_string(path).map_err(|source| match source.kind() {
        std::io::ErrorKind::NotFound => TwinError::Content {
            path: path.to_owned(),
            problem: "is missing: the stage that writes it has not finished".into(),
            hint: Some("finish the run first with `gic run SCENE -o RUN`".into()),
        },
        _ => TwinError::read(path)(source),
    })?;
    serde_json::from_str(&text).map_err(|source| TwinError::Syntax {
        path: path.to_owned(),
        format: "a stage's result",
        source: source.into(),
    })
}
