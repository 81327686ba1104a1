//! Recognising a format by its files, and what all readers share: poses, masks, the final checks.

mod blender;
mod colmap;
mod draft;
mod json;
mod nerfstudio;
mod pac_nerf;
mod pose;
mod real_capture;
mod spring_gaus;

use std::path::Path;

use crate::error::SceneError;
use crate::scene::{OpenOptions, Scene};

pub(crate) use draft::MASK_HINT;
use draft::{Draft, DraftCamera, DraftView, Intrinsics};

type Reader = fn(&Path, &OpenOptions) -> Result<Draft, SceneError>;

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

/// Opens the scene at `path`: a folder, or the file that gives the format away.
pub(crate) fn open(path: &Path, options: &OpenOptions) -> Result<Scene, SceneError> {
    if !path.exists() {
        return Err(SceneError::NotFound { path: path.to_owned() });
    }
    if let Some(rate) = options.frame_rate.filter(|rate| !(rate.is_finite() && *rate > 0.0)) {
        let reason = "must be a positive number of frames per second".into();
        return Err(SceneError::Setting { name: "frame_rate", value: rate.to_string(), reason });
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
    draft::finish(reader(root, options)?, root, options)
}
