//! The scene that comes with gic: embedded in the program, so that it works from any folder.

use std::path::Path;

use gic_twin::atomic;
use include_dir::{Dir, include_dir};

use crate::error::Result;

/// A soft elastic cat, eight cameras x eleven frames, 300x300, with its ground truth;
/// `scripts/make_demo.py` makes it.
static SCENE: Dir = include_dir!("$CARGO_MANIFEST_DIR/demo");

/// Writes the scene into a folder, where it is not there yet.
///
/// # Errors
/// An unwritable folder.
pub fn unpack(folder: &Path) -> Result<()> {
    atomic::create_folder(folder)?;
    write(&SCENE, folder)
}

fn write(part: &Dir, folder: &Path) -> Result<()> {
    for inner in part.dirs() {
        atomic::create_folder(&folder.join(inner.path()))?;
        write(inner, folder)?;
    }
    for file in part.files() {
        let path = folder.join(file.path());
        if std::fs::read(&path).ok().as_deref() != Some(file.contents()) {
            atomic::write(&path, file.contents())?;
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scene_is_whole() {
        let folder = tempfile::tempdir().unwrap();
        unpack(folder.path()).unwrap();
        let scene = gic_scene::Scene::open(folder.path()).unwrap();
        assert_eq!((scene.cameras.len(), scene.times.len(), scene.views.len()), (8, 11, 88));
        assert!(folder.path().join("gt/params.json").exists());
    }
}
