//! nerfstudio: `transforms.json`, with intrinsics and lens distortion for all pictures or for each.

use std::path::Path;

use serde_json::Value;

use super::draft::{Draft, DraftCamera, DraftView, Intrinsics};
use super::json;
use super::mask_file::find_mask;
use super::pose::{self, CameraError, UnsupportedModel};
use crate::error::{Problem, SceneError};
use crate::format::Format;
use crate::lens::Lens;
use crate::settings::SceneSettings;
use crate::view::{MaskSource, Split};
use crate::world::World;
use gic_geometry::Plane;
use glam::{DVec2, DVec3};

pub(super) fn read(root: &Path, _: &SceneSettings) -> Result<Draft, SceneError> {
    let list = root.join("transforms.json");
    let all: Value = json::read(&list)?;
    let world = world_of(&all).map_err(|reason| SceneError::Malformed { path: list.clone(), reason })?;
    let mut draft = Draft::new(Format::Nerfstudio, list.clone(), world);
    let Some(frames) = all.get("frames").and_then(Value::as_array) else {
        return Err(SceneError::Malformed { path: list, reason: "the list `frames` is missing".into() });
    };
    for (index, frame) in frames.iter().enumerate() {
        let keys = Keys { frame, all: &all };
        if let Err(problem) = draft_view(root, &list, index, &keys, &mut draft) {
            draft.problems.push(problem);
        }
    }
    Ok(draft)
}

/// What the file says of the world beyond nerfstudio's own keys: `up`, `gravity_m_s2`, `ground` with `point`, `normal`
/// and the standard deviation `sd_m` of its height, and whether lengths are `metric`. nerfstudio's own tools turn the
/// world so that z points up.
fn world_of(all: &Value) -> Result<World, String> {
    let up = direction(all, "up")?.or(Some(DVec3::Z));
    let ground_deviation_m = match all.get("ground").and_then(|ground| ground.get("sd_m")) {
        None | Some(Value::Null) => 0.0,
        Some(value) => value.as_f64().filter(|sd| *sd >= 0.0).ok_or("`ground.sd_m` must be a number from 0 on")?,
    };
    let ground = match all.get("ground") {
        None | Some(Value::Null) => None,
        Some(ground) => {
            let both = vector(ground, "point")?.zip(direction(ground, "normal")?);
            let (point, normal) = both.ok_or("`ground` must have a `point` and a `normal`")?;
            Some(Plane { point, normal })
        }
    };
    let metric = match all.get("metric") {
        None | Some(Value::Null) => false,
        Some(value) => value.as_bool().ok_or("`metric` must be true or false")?,
    };
    Ok(World { up, gravity: vector(all, "gravity_m_s2")?, ground, ground_deviation_m, metric })
}

/// The unit vector along three numbers, where there are any.
fn direction(of: &Value, key: &str) -> Result<Option<DVec3>, String> {
    let unit = |vector: DVec3| vector.try_normalize().ok_or(format!("`{key}` must not be zero"));
    vector(of, key)?.map(unit).transpose()
}

/// Three numbers, where there are any.
fn vector(of: &Value, key: &str) -> Result<Option<DVec3>, String> {
    let Some(value) = of.get(key).filter(|value| !value.is_null()) else { return Ok(None) };
    let numbers: Option<Vec<f64>> = value.as_array().and_then(|list| list.iter().map(Value::as_f64).collect());
    match numbers.as_deref() {
        Some(&[x, y, z]) => Ok(Some(DVec3::new(x, y, z))),
        _ => Err(format!("`{key}` must be three numbers")),
    }
}

/// Looks keys up in a frame first, then in the whole file: nerfstudio allows both places.
struct Keys<'a> {
    frame: &'a Value,
    all: &'a Value,
}

impl Keys<'_> {
    fn get(&self, key: &str) -> Option<&Value> {
        self.frame.get(key).or_else(|| self.all.get(key))
    }

    fn number(&self, key: &str) -> Option<f64> {
        self.get(key).and_then(Value::as_f64)
    }

    /// A coefficient of the lens; 0 where there is none.
    fn coefficient(&self, key: &str) -> Result<f64, LensError> {
        match self.get(key) {
            None | Some(Value::Null) => Ok(0.0),
            Some(value) => value.as_f64().ok_or_else(|| LensError::Coefficient { key: key.to_owned() }),
        }
    }
}

fn draft_view(root: &Path, list: &Path, index: usize, keys: &Keys, draft: &mut Draft) -> Result<(), Problem> {
    let file = keys.frame.get("file_path").and_then(Value::as_str);
    let name = file.map_or(format!("frame {index}"), |file| file.trim_start_matches("./").to_owned());
    let bad =
        |reason: &str| Problem::BadEntry { path: list.to_owned(), entry: name.clone(), reason: reason.to_owned() };
    let no_pose = |reason: String| Problem::NoPose { path: list.to_owned(), camera: name.clone(), reason };
    if file.is_none() {
        return Err(bad("file_path is missing"));
    }
    let matrix = keys.frame.get("transform_matrix").ok_or_else(|| no_pose("transform_matrix is missing".into()))?;
    let rows: Vec<Vec<f64>> = json::entry(matrix.clone(), list, || name.clone())?;
    let (world_from_camera, centre) = pose::from_opengl_c2w(&rows).map_err(|error| no_pose(error.to_string()))?;
    let intrinsics = intrinsics_of(keys).map_err(|error| no_pose(error.to_string()))?;
    let lens = lens_of(keys).map_err(|error| match error {
        LensError::Unsupported(UnsupportedModel(model)) => {
            Problem::UnsupportedCamera { path: list.to_owned(), camera: name.clone(), model }
        }
        LensError::Coefficient { .. } => bad(&error.to_string()),
    })?;
    let time = keys.frame.get("time").map_or(Some(0.0), Value::as_f64).filter(|time| time.is_finite());
    let time = time.ok_or_else(|| bad("the time is not a finite number"))?;
    let picture = root.join(&name);
    let mask = match keys.frame.get("mask_path").and_then(Value::as_str) {
        Some(path) => Some(MaskSource::File(root.join(path.trim_start_matches("./")))),
        None => mask_beside(root, &name),
    };
    draft.views.push(DraftView { camera: draft.cameras.len(), time, split: split_of(&name), picture, mask });
    let background =
        keys.get("background_path").and_then(Value::as_str).map(|path| root.join(path.trim_start_matches("./")));
    let name = keys.frame.get("camera_label").and_then(Value::as_str).map_or(name, str::to_owned);
    draft.cameras.push(DraftCamera { name, intrinsics, world_from_camera, centre, lens, background });
    Ok(())
}

fn intrinsics_of(keys: &Keys) -> Result<Intrinsics, CameraError> {
    let size = match (keys.number("w"), keys.number("h")) {
        (Some(w), Some(h)) if w >= 1.0 && h >= 1.0 => Some((w as usize, h as usize)),
        (None, None) => None,
        _ => return Err(CameraError::Keys("w and h must both be given, as positive numbers")),
    };
    let Some(fx) = keys.number("fl_x") else {
        let angle =
            keys.number("camera_angle_x").ok_or(CameraError::Keys("neither fl_x nor camera_angle_x is given"))?;
        let possible = angle > 0.0 && angle < std::f64::consts::PI;
        let wrong = CameraError::Keys("camera_angle_x is not an angle");
        return possible.then_some(Intrinsics::HorizontalAngle(angle)).ok_or(wrong);
    };
    let focal = DVec2::new(fx, keys.number("fl_y").unwrap_or(fx));
    let middle = size.map(|(w, h)| DVec2::new(w as f64 / 2.0, h as f64 / 2.0));
    let principal = match (keys.number("cx"), keys.number("cy"), middle) {
        (Some(cx), Some(cy), _) => DVec2::new(cx, cy),
        (_, _, Some(middle)) => middle,
        _ => return Err(CameraError::Keys("neither cx and cy nor w and h are given")),
    };
    if !(focal.x > 0.0 && focal.y > 0.0 && focal.is_finite() && principal.is_finite()) {
        return Err(CameraError::Keys("fl_x and fl_y must be positive, cx and cy finite"));
    }
    Ok(Intrinsics::Pixels { focal, principal, size })
}

/// Why a lens cannot be used.
#[derive(Debug, thiserror::Error)]
enum LensError {
    #[error(transparent)]
    Unsupported(#[from] UnsupportedModel),
    #[error("`{key}` must be a number; correct it, or leave it out where it is 0")]
    Coefficient { key: String },
}

/// The lens, if the model is supported.
fn lens_of(keys: &Keys) -> Result<Option<Lens>, LensError> {
    let k = |number: usize| keys.coefficient(&format!("k{number}"));
    let model = keys.get("camera_model").and_then(Value::as_str).unwrap_or("OPENCV");
    let lens = match model {
        "PINHOLE" | "SIMPLE_PINHOLE" => return Ok(None),
        "OPENCV" | "SIMPLE_RADIAL" | "RADIAL" | "FULL_OPENCV" => {
            // nerfstudio's k4 is the r^8 coefficient of a polynomial, OpenCV's full model divides by it: only zero is
            // clear.
            if k(4)? != 0.0 {
                return Err(UnsupportedModel(format!("{model} with k4 = {}", k(4)?)).into());
            }
            Lens::Perspective {
                k: [k(1)?, k(2)?, k(3)?, 0.0, 0.0, 0.0],
                p: [keys.coefficient("p1")?, keys.coefficient("p2")?],
            }
        }
        "OPENCV_FISHEYE" => Lens::Fisheye { k: [k(1)?, k(2)?, k(3)?, k(4)?] },
        other => return Err(UnsupportedModel(other.to_owned()).into()),
    };
    Ok(lens.unless_trivial())
}

/// A mask in `masks/` under the name of the picture.
fn mask_beside(root: &Path, picture: &str) -> Option<MaskSource> {
    let name = Path::new(picture).file_name()?;
    find_mask(&root.join("masks"), Path::new(name)).map(MaskSource::File)
}

/// nerfstudio marks pictures for evaluation by their names.
fn split_of(name: &str) -> Split {
    let stem = Path::new(name).file_stem().and_then(|stem| stem.to_str()).unwrap_or_default();
    if stem.contains("eval") || stem.contains("test") { Split::Test } else { Split::Train }
}
