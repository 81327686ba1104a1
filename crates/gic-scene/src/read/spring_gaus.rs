//! Spring-Gaus, synthetic: `camera.json`, `frame.json`, `camera_{c}/{frame}.png` with alpha. A camera may have
//! `distortion`, too: OpenCV's coefficients.

use std::path::Path;

use gic_geometry::Plane;
use glam::DVec3;
use serde::Deserialize;
use serde_json::{Map, Value};

use super::draft::{Draft, DraftCamera, DraftView, Intrinsics};
use super::{json, pose};
use crate::error::{Problem, SceneError};
use crate::format::Format;
use crate::settings::SceneSettings;
use crate::view::Split;
use crate::world::World;

#[derive(Deserialize)]
struct Entry {
    camera: String,
    c2w: Vec<Vec<f64>>,
    #[serde(rename = "K")]
    intrinsic: Vec<Vec<f64>>,
    #[serde(default)]
    distortion: Vec<f64>,
}

pub(super) fn read(root: &Path, _: &SceneSettings) -> Result<Draft, SceneError> {
    let list = root.join("camera.json");
    let entries: Vec<Value> = json::read(&list)?;
    let world = World {
        up: Some(DVec3::Y),
        gravity: Some(DVec3::new(0.0, -9.8, 0.0)),
        ground: Some(Plane { point: DVec3::new(0.0, 0.3, 0.0), normal: DVec3::Y }),
        ground_deviation_m: 0.0,
        metric: true,
    };
    let mut draft = Draft::new(Format::SpringGausSynthetic, list.clone(), world);
    let times = read_times(root, &mut draft.problems)?;
    for (index, value) in entries.into_iter().enumerate() {
        let camera = match draft_camera(&list, index, value) {
            Ok(camera) => camera,
            Err(problem) => {
                draft.problems.push(problem);
                continue;
            }
        };
        let folder = root.join(&camera.name);
        for (frame, &time) in times.iter().enumerate() {
            let picture = folder.join(format!("{frame:03}.png"));
            draft.views.push(DraftView { camera: draft.cameras.len(), time, split: Split::Train, picture, mask: None });
        }
        draft.cameras.push(camera);
    }
    Ok(draft)
}

/// Times [s] by frame number: `frame.json` is a list of objects with a single entry, whose key means nothing.
fn read_times(root: &Path, problems: &mut Vec<Problem>) -> Result<Vec<f64>, SceneError> {
    let path = root.join("frame.json");
    let entries: Vec<Map<String, Value>> = json::read(&path)?;
    let mut times: Vec<f64> = Vec::with_capacity(entries.len());
    for (frame, entry) in entries.iter().enumerate() {
        let Some(time) = entry.values().next().and_then(Value::as_f64) else {
            let reason = "expected an object with one time in seconds".into();
            problems.push(Problem::BadEntry { path: path.clone(), entry: format!("frame {frame}"), reason });
            continue;
        };
        if let Some(&previous) = times.last()
            && time <= previous
        {
            let picture = format!("frame {frame}");
            problems.push(Problem::TimesNotIncreasing { path: path.clone(), picture, time, previous });
        }
        times.push(time);
    }
    let start = times.first().copied().unwrap_or(0.0);
    Ok(times.into_iter().map(|time| time - start).collect())
}

fn draft_camera(list: &Path, index: usize, value: Value) -> Result<DraftCamera, Problem> {
    let name = value.get("camera").and_then(Value::as_str).map_or(format!("camera {index}"), str::to_owned);
    let no_pose = |reason: String| Problem::NoPose { path: list.to_owned(), camera: name.clone(), reason };
    let missing: Vec<&str> =
        ["c2w", "K"].into_iter().filter(|&key| value.get(key).is_none_or(Value::is_null)).collect();
    if !missing.is_empty() {
        return Err(no_pose(format!("{} is missing", missing.join(" and "))));
    }
    let entry: Entry = json::entry(value, list, || name.clone())?;
    let (world_from_camera, centre) = pose::from_opengl_c2w(&entry.c2w).map_err(|error| no_pose(error.to_string()))?;
    let (focal, principal) =
        pose::from_intrinsic_matrix(&entry.intrinsic).map_err(|error| no_pose(error.to_string()))?;
    let intrinsics = Intrinsics::Pixels { focal, principal, size: None };
    let lens = pose::lens(&entry.distortion).map_err(|error| no_pose(error.to_string()))?;
    Ok(DraftCamera { name: entry.camera, intrinsics, world_from_camera, centre, lens, background: None })
}
