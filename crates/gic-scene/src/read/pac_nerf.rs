//! PAC-NeRF: `all_data.json`, a list of `{file_path, time, c2w, intrinsic}`; frame -1 is the camera's empty background.
//! An entry may have `distortion`, too: OpenCV's coefficients.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use gic_geometry::Plane;
use glam::DVec3;
use serde::Deserialize;
use serde_json::Value;

use super::draft::{Draft, DraftCamera, DraftView, Intrinsics};
use super::json;
use super::pose::{self, CameraError};
use crate::error::{Problem, SceneError};
use crate::format::Format;
use crate::settings::SceneSettings;
use crate::view::{MaskSource, Split};
use crate::world::World;

#[derive(Deserialize)]
struct Entry {
    file_path: String,
    time: f64,
    c2w: Vec<Vec<f64>>,
    intrinsic: Vec<Vec<f64>>,
    #[serde(default)]
    distortion: Vec<f64>,
}

pub(super) fn read(root: &Path, _: &SceneSettings) -> Result<Draft, SceneError> {
    let list = root.join("all_data.json");
    let entries: Vec<Value> = json::read(&list)?;
    let world = World {
        up: Some(DVec3::Y),
        gravity: Some(DVec3::new(0.0, -9.8, 0.0)),
        ground: Some(Plane { point: DVec3::ZERO, normal: DVec3::Y }),
        ground_deviation_m: 0.0,
        metric: true,
    };
    let mut draft = Draft::new(Format::PacNerf, list.clone(), world);
    let mut found: BTreeMap<(u32, i32), (PathBuf, f64)> = BTreeMap::new();
    let mut cameras: BTreeMap<u32, Entry> = BTreeMap::new();
    for (index, value) in entries.into_iter().enumerate() {
        if let Err(problem) = take_entry(root, &list, index, value, &mut found, &mut cameras) {
            draft.problems.push(problem);
        }
    }
    check_times(&list, &found, &mut draft.problems);

    let mut numbers = BTreeMap::new();
    for (number, entry) in cameras {
        match draft_camera(number, &entry) {
            Ok(mut camera) => {
                camera.background = found.get(&(number, -1)).map(|(path, _)| path.clone());
                numbers.insert(number, draft.cameras.len());
                draft.cameras.push(camera);
            }
            Err(error) => {
                let reason = error.to_string();
                draft.problems.push(Problem::NoPose { path: list.clone(), camera: format!("camera {number}"), reason });
            }
        }
    }
    let start =
        found.iter().filter(|((_, frame), _)| *frame >= 0).map(|(_, (_, time))| *time).fold(f64::INFINITY, f64::min);
    for ((number, frame), (picture, time)) in found {
        let (Some(&camera), 0..) = (numbers.get(&number), frame) else { continue };
        let mask = mask_of(&picture, number, frame);
        draft.views.push(DraftView { camera, time: time - start, split: Split::Train, picture, mask });
    }
    Ok(draft)
}

/// Files one entry under its camera and frame; all entries of a camera must have one pose.
fn take_entry(
    root: &Path,
    list: &Path,
    index: usize,
    value: Value,
    found: &mut BTreeMap<(u32, i32), (PathBuf, f64)>,
    cameras: &mut BTreeMap<u32, Entry>,
) -> Result<(), Problem> {
    let name = value.get("file_path").and_then(Value::as_str).map_or(format!("entry {index}"), str::to_owned);
    let missing: Vec<&str> =
        ["c2w", "intrinsic"].into_iter().filter(|&key| value.get(key).is_none_or(Value::is_null)).collect();
    if !missing.is_empty() {
        let reason = format!("{} is missing", missing.join(" and "));
        return Err(Problem::NoPose { path: list.to_owned(), camera: name, reason });
    }
    let entry: Entry = json::entry(value, list, || name.clone())?;
    let bad =
        |reason: &str| Problem::BadEntry { path: list.to_owned(), entry: name.clone(), reason: reason.to_owned() };
    let (camera, frame) = numbers_of(&entry.file_path)
        .ok_or_else(|| bad("the file name must be r_{camera}_{frame} with an extension"))?;
    if !entry.time.is_finite() {
        return Err(bad("the time is not finite"));
    }
    let path = root.join(entry.file_path.trim_start_matches("./"));
    if let Some((other, _)) = found.get(&(camera, frame)) {
        return Err(Problem::Duplicate { path, other: other.clone() });
    }
    let known = cameras.entry(camera).or_insert_with(|| Entry {
        file_path: entry.file_path.clone(),
        time: entry.time,
        c2w: entry.c2w.clone(),
        intrinsic: entry.intrinsic.clone(),
        distortion: entry.distortion.clone(),
    });
    if (&known.c2w, &known.intrinsic, &known.distortion) != (&entry.c2w, &entry.intrinsic, &entry.distortion) {
        let reason = format!(
            "its pose or intrinsics differ from those of {}; the cameras of this format stand still",
            known.file_path
        );
        return Err(Problem::NoPose { path: list.to_owned(), camera: name, reason });
    }
    found.insert((camera, frame), (path, entry.time));
    Ok(())
}

/// Camera and frame from `.../r_{camera}_{frame}.png`.
fn numbers_of(file: &str) -> Option<(u32, i32)> {
    let stem = Path::new(file).file_stem()?.to_str()?;
    let (camera, frame) = stem.strip_prefix("r_")?.split_once('_')?;
    Some((camera.parse().ok()?, frame.parse().ok()?))
}

fn draft_camera(number: u32, entry: &Entry) -> Result<DraftCamera, CameraError> {
    let (world_from_camera, centre) = pose::from_opengl_c2w(&entry.c2w)?;
    let (focal, principal) = pose::from_intrinsic_matrix(&entry.intrinsic)?;
    let intrinsics = Intrinsics::Pixels { focal, principal, size: None };
    let lens = pose::lens(&entry.distortion)?;
    Ok(DraftCamera { name: number.to_string(), intrinsics, world_from_camera, centre, lens, background: None })
}

/// Times must increase with the frame number of each camera.
fn check_times(list: &Path, found: &BTreeMap<(u32, i32), (PathBuf, f64)>, problems: &mut Vec<Problem>) {
    for (((camera, _), (_, previous)), ((next, frame), (path, time))) in found.iter().zip(found.iter().skip(1)) {
        if camera == next && *frame > 0 && time <= previous {
            problems.push(Problem::TimesNotIncreasing {
                path: list.to_owned(),
                picture: path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned()),
                time: *time,
                previous: *previous,
            });
        }
    }
}

/// `a_*` (coverage, or RGBA with the mask as alpha) before `m_*` (the picture over white).
fn mask_of(picture: &Path, camera: u32, frame: i32) -> Option<MaskSource> {
    let sibling = |prefix: &str| picture.with_file_name(format!("{prefix}_{camera}_{frame}.png"));
    let (alpha, white) = (sibling("a"), sibling("m"));
    if alpha.is_file() {
        return Some(MaskSource::File(alpha));
    }
    white.is_file().then_some(MaskSource::OverWhite(white))
}
