//! Recognising a format by its files, and what all readers share: poses, masks, the final checks.

mod blender;
mod colmap;
mod draft;
mod enclosure;
mod finish;
mod json;
mod mask_file;
mod nerfstudio;
mod pac_nerf;
mod pose;
mod ranges;
mod real_capture;
mod spring_gaus;
mod standing;

use std::path::Path;

use crate::error::SceneError;
use crate::scene::Scene;
use crate::settings::SceneSettings;

use draft::Draft;

type Reader = fn(&Path, &SceneSettings) -> Result<Draft, SceneError>;

/// The file that gives a format away, relative to the scene's folder, and the reader. The first match wins: the more
/// specific formats come first.
const FORMATS: [(&str, Reader); 7] = [
    ("all_data.json", pac_nerf::read),
    ("camera.json", spring_gaus::read),
    ("dynamic/cameras_calib.json", real_capture::read),
    ("transforms_train.json", blender::read),
    ("transforms_val.json", blender::read),
    ("transforms_test.json", blender::read),
    ("transforms.json", nerfstudio::read),
];

impl Scene {
    /// Opens the scene in folder `path` (or whose main file `path` is), recognising the format by its files.
    ///
    /// # Errors
    /// [`SceneError::Invalid`] lists everything that is wrong with the data; the other errors stop at once.
    pub fn open(path: impl AsRef<Path>) -> Result<Scene, SceneError> {
        Scene::open_with(path, &SceneSettings::default())
    }

    /// Like [`Scene::open`], with settings.
    ///
    /// # Errors
    /// As [`Scene::open`].
    pub fn open_with(path: impl AsRef<Path>, settings: &SceneSettings) -> Result<Scene, SceneError> {
        let scene = open(path.as_ref(), settings)?;
        match &settings.cameras {
            Some(cameras) => scene.with_cameras(cameras),
            None => Ok(scene),
        }
    }
}

/// Opens the scene at `path`: a folder, or the file that gives the format away.
fn open(path: &Path, settings: &SceneSettings) -> Result<Scene, SceneError> {
    if !path.exists() {
        return Err(SceneError::NotFound { path: path.to_owned() });
    }
    if let Some(rate) = settings.frame_rate_hz.filter(|rate| !ranges::FRAME_RATE_HZ.contains(rate)) {
        let (low, high) = (ranges::FRAME_RATE_HZ.start(), ranges::FRAME_RATE_HZ.end());
        let reason = format!("must be a number of frames per second from {low} to {high}");
        return Err(SceneError::Setting { name: "frame_rate_hz", value: format!("{rate:?}"), reason });
    }
    let root = match path.parent() {
        Some(parent) if path.is_file() => parent,
        _ => path,
    };
    let reader = match FORMATS.iter().find(|(file, _)| root.join(file).exists()) {
        Some((_, reader)) => *reader,
        // A COLMAP model may lie in several places.
        None => colmap::read,
    };
    finish::finish(reader(root, settings)?, root, settings)
}
