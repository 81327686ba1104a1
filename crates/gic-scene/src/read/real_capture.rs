//! Spring-Gaus, real capture: a few synchronised video cameras in `dynamic/`, photographs of the object at rest with a
//! COLMAP model in `static/`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gic_files::FileError;
use gic_geometry::Plane;
use glam::{DMat3, DVec2, DVec3};
use serde::Deserialize;
use serde_json::Value;

use super::draft::{Draft, DraftCamera, DraftView, Intrinsics};
use super::mask_file::find_mask;
use super::pose::CameraError;
use super::{colmap, finish, json, pose};
use crate::error::{Problem, SceneError};
use crate::format::Format;
use crate::lens::Lens;
use crate::scene::Scene;
use crate::settings::SceneSettings;
use crate::view::{MaskSource, Split};
use crate::world::World;

/// The videos' frame rate [Hz] where the user gives none: no file of the format states it.
const FRAME_RATE: f64 = 30.0;

#[derive(Deserialize)]
struct Extrinsics {
    rvecs: Vec<Vec<f64>>,
    tvecs: Vec<Vec<f64>>,
}

pub(super) fn read(root: &Path, settings: &SceneSettings) -> Result<Draft, SceneError> {
    let set = choose_set(root, settings)?;
    let calibration_file = root.join("dynamic/cameras_calib.json");
    let calibration: BTreeMap<String, Value> = json::read(&calibration_file)?;
    let list = root.join("dynamic/sequences").join(&set).join("0.json");
    let sequence: BTreeMap<String, Value> = json::read(&list)?;
    // As in the released configurations: z points down, the ground is a horizontal plane.
    let world = World {
        up: Some(DVec3::NEG_Z),
        gravity: Some(DVec3::new(0.0, 0.0, 9.8)),
        ground: Some(Plane { point: DVec3::new(0.0, 0.0, -0.02), normal: DVec3::NEG_Z }),
        ground_deviation_m: 0.0,
        metric: true,
    };
    let mut draft = Draft::new(Format::SpringGausReal, list.clone(), world);
    let rate = settings.frame_rate_hz.unwrap_or(FRAME_RATE);
    draft.frame_rate = Some(rate);
    let (intrinsics, lens) = calibrated(&calibration, &calibration_file)?;
    for (name, files) in sequence.into_iter().filter(|(name, _)| name != "hit_frame") {
        let files: Vec<String> = match json::entry(files, &list, || name.clone()) {
            Ok(files) => files,
            Err(problem) => {
                draft.problems.push(problem);
                continue;
            }
        };
        let pose = pose_of(calibration.get(&name));
        let (world_from_camera, centre) = match pose {
            Ok(pose) => pose,
            Err(error) => {
                let reason = error.to_string();
                draft.problems.push(Problem::NoPose { path: calibration_file.clone(), camera: name, reason });
                continue;
            }
        };
        let (focal, principal) = intrinsics;
        let (pictures, masks) =
            (root.join("dynamic/videos_images").join(&name), root.join("dynamic/videos_masks").join(&name));
        for (frame, file) in files.iter().enumerate() {
            draft.views.push(DraftView {
                camera: draft.cameras.len(),
                // Equal positions in the lists are simultaneous; the file names are not.
                time: frame as f64 / rate,
                split: Split::Train,
                picture: pictures.join(file),
                mask: find_mask(&masks, Path::new(file)).map(MaskSource::File),
            });
        }
        draft.cameras.push(DraftCamera {
            name,
            // The principal point is in the middle of the video.
            intrinsics: Intrinsics::Pixels { focal, principal, size: whole_size(principal) },
            world_from_camera,
            centre,
            lens: lens.clone(),
            background: None,
        });
    }
    draft.rest = read_rest(root, &set, settings, &mut draft.problems)?.map(Box::new);
    Ok(draft)
}

/// The video size that a principal point in its middle implies.
fn whole_size(principal: DVec2) -> Option<(usize, usize)> {
    let size = principal * 2.0;
    ((size - size.round()).abs().max_element() < 1e-6).then(|| (size.x.round() as usize, size.y.round() as usize))
}

/// The name of the sequence to read: the user's, or the first.
fn choose_set(root: &Path, settings: &SceneSettings) -> Result<String, SceneError> {
    let folder = root.join("dynamic/sequences");
    let entries = std::fs::read_dir(&folder).map_err(FileError::read(&folder))?;
    let mut names: Vec<String> = entries
        .flatten()
        .filter(|entry| entry.path().join("0.json").is_file())
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    let chosen = match &settings.set {
        Some(set) => names.iter().find(|name| *name == set),
        None => names.first(),
    };
    chosen.cloned().ok_or_else(|| SceneError::Malformed {
        path: folder,
        reason: format!(
            "no sequence {}; there are: {}",
            settings.set.as_deref().unwrap_or("*/0.json"),
            names.join(", ")
        ),
    })
}

type Calibrated = ((DVec2, DVec2), Option<Lens>);

fn calibrated(calibration: &BTreeMap<String, Value>, path: &Path) -> Result<Calibrated, SceneError> {
    let malformed = |reason: String| SceneError::Malformed { path: path.to_owned(), reason };
    let matrix =
        calibration.get("camera_matrix").cloned().ok_or_else(|| malformed("camera_matrix is missing".into()))?;
    let rows: Vec<Vec<f64>> = serde_json::from_value(matrix).map_err(|error| malformed(error.to_string()))?;
    let pinhole = pose::from_intrinsic_matrix(&rows).map_err(|error| malformed(error.to_string()))?;
    let distortion: Vec<Vec<f64>> = match calibration.get("distortion_coefficient") {
        Some(value) => serde_json::from_value(value.clone()).map_err(|error| malformed(error.to_string()))?,
        None => Vec::new(),
    };
    let coefficients: Vec<f64> = distortion.into_iter().flatten().collect();
    let lens = pose::lens(&coefficients).map_err(|error| malformed(error.to_string()))?;
    Ok((pinhole, lens))
}

/// Rotation (columns: right, down, forward) and centre from OpenCV's world-to-camera vectors.
fn pose_of(entry: Option<&Value>) -> Result<(DMat3, DVec3), CameraError> {
    let entry = entry.ok_or(CameraError::Missing)?;
    let extrinsics: Extrinsics =
        serde_json::from_value(entry.clone()).map_err(|error| CameraError::Json(error.to_string()))?;
    let vector = |rows: &[Vec<f64>], name: &'static str| match rows.iter().flatten().copied().collect::<Vec<f64>>()[..]
    {
        [x, y, z] if x.is_finite() && y.is_finite() && z.is_finite() => Ok(DVec3::new(x, y, z)),
        _ => Err(CameraError::Vector(name)),
    };
    let (turn, shift) = (vector(&extrinsics.rvecs, "rvecs")?, vector(&extrinsics.tvecs, "tvecs")?);
    let camera_from_world = match turn.try_normalize() {
        Some(axis) => DMat3::from_axis_angle(axis, turn.length()),
        None => DMat3::IDENTITY,
    };
    let world_from_camera = camera_from_world.transpose();
    Ok((world_from_camera, -(world_from_camera * shift)))
}

/// The photographs of the object at rest, where there are any.
fn read_rest(
    root: &Path,
    set: &str,
    settings: &SceneSettings,
    problems: &mut Vec<Problem>,
) -> Result<Option<Scene>, SceneError> {
    let folder = |kind: &str| -> PathBuf { root.join("static").join(kind).join(set) };
    let Some(model) = colmap::model_folder(&folder("colmap")) else { return Ok(None) };
    let draft = colmap::read_model(&model, &folder("images"), &folder("masks"))?;
    let settings = SceneSettings { frame_rate_hz: None, ..settings.clone() };
    match finish::finish(draft, &root.join("static"), &settings) {
        Ok(scene) => Ok(Some(scene)),
        Err(SceneError::Invalid(found)) => {
            problems.extend(found);
            Ok(None)
        }
        Err(other) => Err(other),
    }
}
