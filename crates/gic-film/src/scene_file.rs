//! `transforms.json` of an imported scene.

use std::path::{Path, PathBuf};

use gic_twin::atomic;
use serde_json::{Map, Value, json};

use crate::cameras::{CAMERA_KEYS, KnownCameras};
use crate::cut::Cut;
use crate::error::{FilmError, Result};
use crate::film::Film;
use crate::imported::Imported;

/// The list of pictures, with their times and cameras.
pub(crate) struct SceneFile {
    path: PathBuf,
    all: Map<String, Value>,
}

const IMPORT_HINT: &str = "import the films with `gic import FILMS -o SCENE`";

impl SceneFile {
    /// Where it is in a scene.
    pub(crate) fn path_in(scene: &Path) -> PathBuf {
        scene.join("transforms.json")
    }

    /// The picture of a camera's empty scene, from the scene's folder.
    pub(crate) fn background_of(camera: &str) -> String {
        format!("backgrounds/{camera}.png")
    }

    /// The list of a cut, without cameras.
    pub(crate) fn new(films: &[Film], cut: &Cut, imported: &Imported) -> SceneFile {
        let mut frames = Vec::new();
        for (film, shots) in films.iter().zip(&cut.shots) {
            for (frame, shot) in shots.iter().enumerate() {
                frames.push(json!({
                    "file_path": Cut::file_of(film, frame).to_string_lossy().replace('\\', "/"),
                    "camera_label": film.name,
                    "time": shot.time_s,
                    "film_frame": shot.index,
                    "background_path": SceneFile::background_of(&film.name),
                }));
            }
        }
        let all = json!({ "import": imported, "frames": frames });
        SceneFile { path: PathBuf::new(), all: all.as_object().cloned().unwrap_or_default() }
    }

    /// That of an imported scene.
    pub(crate) fn read(scene: &Path) -> Result<SceneFile> {
        let path = SceneFile::path_in(scene);
        let text = gic_files::input::read_to_string(&path)
            .map_err(|error| FilmError::content(scene, format!("is no imported scene: {error}"), IMPORT_HINT))?;
        match serde_json::from_str(&text) {
            Ok(Value::Object(all)) if all.contains_key("import") => Ok(SceneFile { path, all }),
            Ok(_) => Err(FilmError::content(&path, "is a scene that no import made", IMPORT_HINT)),
            Err(error) => Err(FilmError::content(&path, format!("is not JSON: {error}"), IMPORT_HINT)),
        }
    }

    /// Gives each picture its camera, and the world what is known of it.
    pub(crate) fn set_cameras(&mut self, cameras: &KnownCameras) -> Result<()> {
        let mut imported = self.imported()?;
        let damaged = |path: &Path| FilmError::content(path, "has a picture without a camera", IMPORT_HINT);
        let frames = self.all.get_mut("frames").and_then(Value::as_array_mut).ok_or_else(|| damaged(&self.path))?;
        for frame in frames.iter_mut().filter_map(Value::as_object_mut) {
            let label = frame.get("camera_label").and_then(Value::as_str).unwrap_or_default();
            let camera =
                imported.cameras.iter().find(|camera| camera.name == label).ok_or_else(|| damaged(&self.path))?;
            let keys = cameras.keys_of(&camera.name, (camera.size_px[0], camera.size_px[1]))?;
            frame.retain(|key, _| !CAMERA_KEYS.contains(&key.as_str()));
            frame.extend(keys.clone());
        }
        self.all.extend(cameras.world.clone());
        imported.is_calibrated = true;
        self.all.insert("import".into(), json!(imported));
        Ok(())
    }

    /// What was imported.
    pub(crate) fn imported(&self) -> Result<Imported> {
        let stored = self.all.get("import").cloned().unwrap_or_default();
        serde_json::from_value(stored)
            .map_err(|error| FilmError::content(&self.path, format!("`import`: {error}"), IMPORT_HINT))
    }

    /// Writes it into a scene.
    pub(crate) fn write(&self, scene: &Path) -> Result<()> {
        Ok(atomic::write_json(&SceneFile::path_in(scene), &self.all)?)
    }
}
