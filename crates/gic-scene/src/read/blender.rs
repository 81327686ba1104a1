//! Blender / nerf_synthetic / D-NeRF: `transforms_{train,val,test}.json` with one picture, and perhaps a `time`, an
//! entry. A file may have `distortion`, too: OpenCV's coefficients.

use std::path::Path;

use glam::DVec3;
use serde::Deserialize;
use serde_json::Value;

use super::draft::{Draft, DraftCamera, DraftView, Intrinsics};
use super::{json, pose};
use crate::error::{Problem, SceneError};
use crate::format::Format;
use crate::settings::SceneSettings;
use crate::view::Split;
use crate::world::World;

#[derive(Deserialize)]
struct Transforms {
    camera_angle_x: f64,
    #[serde(default)]
    distortion: Vec<f64>,
    frames: Vec<Value>,
}

#[derive(Deserialize)]
struct Frame {
    file_path: String,
    time: Option<f64>,
    transform_matrix: Vec<Vec<f64>>,
}

pub(super) fn read(root: &Path, _: &SceneSettings) -> Result<Draft, SceneError> {
    // Blender's z points up; nothing else about the world is fixed.
    let world = World { up: Some(DVec3::Z), gravity: None, ground: None, ground_deviation_m: 0.0, metric: false };
    let splits = [("train", Split::Train), ("val", Split::Validation), ("test", Split::Test)];
    let mut draft: Option<Draft> = None;
    for (name, split) in splits {
        let list = root.join(format!("transforms_{name}.json"));
        if !list.exists() {
            continue;
        }
        let draft = draft.get_or_insert_with(|| Draft::new(Format::Blender, list.clone(), world));
        read_split(root, &list, split, draft)?;
    }
    draft.ok_or_else(|| SceneError::UnknownFormat { path: root.to_owned() })
}

fn read_split(root: &Path, list: &Path, split: Split, draft: &mut Draft) -> Result<(), SceneError> {
    let Transforms { camera_angle_x, distortion, frames } = json::read(list)?;
    let malformed = |reason: String| SceneError::Malformed { path: list.to_owned(), reason };
    let lens = pose::lens(&distortion).map_err(|error| malformed(error.to_string()))?;
    if !(camera_angle_x > 0.0 && camera_angle_x < std::f64::consts::PI) {
        let reason = format!("camera_angle_x = {camera_angle_x} is not an angle between 0 and pi");
        return Err(malformed(reason));
    }
    for (index, value) in frames.into_iter().enumerate() {
        match draft_frame(root, list, index, value) {
            Ok((name, picture, time, (world_from_camera, centre))) => {
                let intrinsics = Intrinsics::HorizontalAngle(camera_angle_x);
                draft.views.push(DraftView { camera: draft.cameras.len(), time, split, picture, mask: None });
                let lens = lens.clone();
                draft.cameras.push(DraftCamera { name, intrinsics, world_from_camera, centre, lens, background: None });
            }
            Err(problem) => draft.problems.push(problem),
        }
    }
    Ok(())
}

type ReadFrame = (String, std::path::PathBuf, f64, (glam::DMat3, DVec3));

fn draft_frame(root: &Path, list: &Path, index: usize, value: Value) -> Result<ReadFrame, Problem> {
    let name = value.get("file_path").and_then(Value::as_str).map_or(format!("frame {index}"), str::to_owned);
    let no_pose = |reason: String| Problem::NoPose { path: list.to_owned(), camera: name.clone(), reason };
    if value.get("transform_matrix").is_none_or(Value::is_null) {
        return Err(no_pose("transform_matrix is missing".into()));
    }
    let frame: Frame = json::entry(value, list, || name.clone())?;
    let time = frame.time.unwrap_or(0.0);
    if !time.is_finite() {
        let reason = "the time is not finite".into();
        return Err(Problem::BadEntry { path: list.to_owned(), entry: name, reason });
    }
    let pose = pose::from_opengl_c2w(&frame.transform_matrix).map_err(|error| no_pose(error.to_string()))?;
    let file = frame.file_path.trim_start_matches("./").to_owned();
    let mut picture = root.join(&file);
    if !picture.is_file() {
        // The original files leave the extension out.
        picture = root.join(format!("{file}.png"));
    }
    Ok((file, picture, time, pose))
}
