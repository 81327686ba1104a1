//! Known cameras: what `gic calibrate` wrote, or another scene's, by name, as keys of nerfstudio's `transforms.json`.

use std::path::{Path, PathBuf};

use gic_files::FileError;
use gic_scene::{Camera, Scene};
use serde::Deserialize;
use serde_json::{Map, Value, json};

use crate::error::{FilmError, Result};

/// The schema of calibration files.
const SCHEMA: &str = "gic.calibration/1";
/// Keys of a picture in `transforms.json` that tell of its camera.
pub(crate) const CAMERA_KEYS: [&str; 17] = [
    "w",
    "h",
    "fl_x",
    "fl_y",
    "cx",
    "cy",
    "k1",
    "k2",
    "k3",
    "k4",
    "p1",
    "p2",
    "camera_model",
    "camera_angle_x",
    "camera_angle_y",
    "transform_matrix",
    "rolling_shutter_time",
];
/// Keys of `transforms.json` that tell of the world.
pub(crate) const WORLD_KEYS: [&str; 4] = ["up", "gravity_m_s2", "ground", "metric"];

/// Cameras by name, and what is known of their world.
#[derive(Clone, Debug)]
pub struct KnownCameras {
    path: PathBuf,
    cameras: Vec<(String, Map<String, Value>)>,
    pub(crate) world: Map<String, Value>,
}

#[derive(Deserialize)]
struct Calibration {
    schema: String,
    cameras: Vec<Calibrated>,
    #[serde(flatten)]
    world: Map<String, Value>,
}

#[derive(Deserialize)]
struct Calibrated {
    name: String,
    width_px: f64,
    height_px: f64,
    fx_px: f64,
    fy_px: f64,
    cx_px: f64,
    cy_px: f64,
    #[serde(default)]
    distortion: Distortion,
    world_from_camera: [[f64; 4]; 3],
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct Distortion {
    k1: f64,
    k2: f64,
    p1: f64,
    p2: f64,
}

impl KnownCameras {
    /// From a file of `gic calibrate`, a `transforms.json`, or the folder of any scene.
    ///
    /// # Errors
    /// A file that cannot be read or is neither.
    pub fn read(path: &Path) -> Result<KnownCameras> {
        let list = if path.is_dir() { path.join("transforms.json") } else { path.to_owned() };
        if path.is_dir() && !list.is_file() {
            return Ok(KnownCameras::of_scene(&Scene::open(path)?));
        }
        let text = gic_files::input::read_to_string(&list).map_err(FileError::read(&list))?;
        let unusable = |reason: String| {
            FilmError::content(&list, reason, "give a file of `gic calibrate`, a transforms.json, or a scene's folder")
        };
        let all: Value = serde_json::from_str(&text).map_err(|error| unusable(format!("is not JSON: {error}")))?;
        let (cameras, world) = match (all.get("schema"), all.get("frames").and_then(Value::as_array)) {
            (_, Some(frames)) => (of_frames(frames, &all), all.as_object().cloned().unwrap_or_default()),
            (Some(schema), _) if *schema == SCHEMA => {
                let found: Calibration =
                    serde_json::from_value(all.clone()).map_err(|error| unusable(format!("{SCHEMA}: {error}")))?;
                debug_assert_eq!(found.schema, SCHEMA);
                let named = found.cameras.iter().map(|camera| (camera.name.clone(), camera.keys()));
                (named.collect(), found.world)
            }
            _ => return Err(unusable(format!("has neither the schema {SCHEMA} nor a list `frames`"))),
        };
        if cameras.is_empty() {
            return Err(unusable("knows no camera's place".into()));
        }
        Ok(KnownCameras { path: path.to_owned(), cameras, world: of_world(world) })
    }

    fn of_scene(scene: &Scene) -> KnownCameras {
        let named = scene.camera_names.iter().cloned().zip(scene.cameras.iter().map(pinhole));
        let mut world = Map::from_iter([("metric".to_owned(), json!(scene.world.metric))]);
        world.extend(scene.world.up.map(|up| ("up".to_owned(), json!(up.to_array()))));
        world.extend(scene.world.gravity.map(|g| ("gravity_m_s2".to_owned(), json!(g.to_array()))));
        world.extend(scene.world.ground.map(|ground| {
            ("ground".to_owned(), json!({"point": ground.point.to_array(), "normal": ground.normal.to_array()}))
        }));
        KnownCameras { path: scene.root.clone(), cameras: named.collect(), world }
    }

    /// The keys of a camera, whose pictures have this size.
    ///
    /// # Errors
    /// No camera of this name, or one for pictures of another shape.
    pub(crate) fn keys_of(&self, name: &str, size: (usize, usize)) -> Result<&Map<String, Value>> {
        let known = self.cameras.iter().find(|(known, _)| known == name);
        let Some((_, keys)) = known else {
            let all: Vec<&str> = self.cameras.iter().map(|(known, _)| known.as_str()).collect();
            return Err(FilmError::content(
                &self.path,
                format!("knows no camera {name}; it knows {}", all.join(", ")),
                "give the films the names of the cameras",
            ));
        };
        let side = |key: &str| keys.get(key).and_then(Value::as_f64);
        if let (Some(width), Some(height)) = (side("w"), side("h")) {
            let (own_width, own_height) = (size.0 as f64, size.1 as f64);
            // Films smaller than the calibration's are fine: readers scale the focal lengths.
            let is_alike = (own_width * height / width - own_height).abs() <= 1.0;
            if !is_alike {
                return Err(FilmError::content(
                    &self.path,
                    format!(
                        "camera {name} was calibrated for {width} x {height} pixels, its film has {own_width} x \
                         {own_height}"
                    ),
                    "calibrate with films of the same shape, not cropped or turned",
                ));
            }
        }
        Ok(keys)
    }
}

impl Calibrated {
    fn keys(&self) -> Map<String, Value> {
        let Distortion { k1, k2, p1, p2 } = self.distortion;
        let lens = json!({
            "camera_model": "OPENCV",
            "w": self.width_px, "h": self.height_px,
            "fl_x": self.fx_px, "fl_y": self.fy_px, "cx": self.cx_px, "cy": self.cy_px,
            "k1": k1, "k2": k2, "p1": p1, "p2": p2,
            "transform_matrix": opengl(self.world_from_camera),
        });
        lens.as_object().cloned().unwrap_or_default()
    }
}

/// A camera-to-world matrix for OpenGL's axes, of one for OpenCV's: y and z point the other way.
fn opengl([x, y, z]: [[f64; 4]; 3]) -> [[f64; 4]; 4] {
    let flip = |row: [f64; 4]| [row[0], -row[1], -row[2], row[3]];
    [flip(x), flip(y), flip(z), [0.0, 0.0, 0.0, 1.0]]
}

fn pinhole(camera: &Camera) -> Map<String, Value> {
    let (right, down, forward) =
        (camera.world_from_camera.x_axis, camera.world_from_camera.y_axis, camera.world_from_camera.z_axis);
    let row = |axis: usize| [right[axis], down[axis], forward[axis], camera.centre[axis]];
    let keys = json!({
        "camera_model": "PINHOLE",
        "w": camera.width, "h": camera.height,
        "fl_x": camera.focal.x, "fl_y": camera.focal.y, "cx": camera.principal.x, "cy": camera.principal.y,
        "transform_matrix": opengl([row(0), row(1), row(2)]),
    });
    keys.as_object().cloned().unwrap_or_default()
}

/// One camera for each label of the pictures that have a place; without labels, the first picture's that bears a name.
fn of_frames(frames: &[Value], all: &Value) -> Vec<(String, Map<String, Value>)> {
    let mut cameras: Vec<(String, Map<String, Value>)> = Vec::new();
    for frame in frames.iter().filter(|frame| frame.get("transform_matrix").is_some()) {
        let Some(name) = camera_of(frame) else { continue };
        if cameras.iter().all(|(known, _)| *known != name) {
            let key = |key: &&str| Some(((*key).to_owned(), frame.get(key).or_else(|| all.get(key))?.clone()));
            cameras.push((name, CAMERA_KEYS.iter().filter_map(key).collect()));
        }
    }
    cameras
}

/// The camera of a picture: its label, or the name of its file without a number at its end.
fn camera_of(frame: &Value) -> Option<String> {
    if let Some(label) = frame.get("camera_label").and_then(Value::as_str) {
        return Some(label.to_owned());
    }
    let file = Path::new(frame.get("file_path")?.as_str()?);
    let stem = file.file_stem()?.to_str()?;
    let name = stem.trim_end_matches(|c: char| c.is_ascii_digit()).trim_end_matches(['_', '-', '.']);
    Some(if name.is_empty() { stem } else { name }.to_owned())
}

fn of_world(all: Map<String, Value>) -> Map<String, Value> {
    all.into_iter().filter(|(key, value)| WORLD_KEYS.contains(&key.as_str()) && !value.is_null()).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_calibration_becomes_keys_for_opengl_axes() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("calibration.json");
        let camera = |name: &str| {
            json!({"name": name, "width_px": 640, "height_px": 480, "fx_px": 500.0, "fy_px": 501.0, "cx_px": 320.0,
                "cy_px": 240.0, "distortion": {"k1": 0.1, "k2": 0.0, "p1": 0.0, "p2": 0.01},
                "world_from_camera": [[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0], [9.0, 10.0, 11.0, 12.0]]})
        };
        let text = json!({"schema": SCHEMA, "cameras": [camera("left"), camera("right")], "up": [0.0, 0.0, 1.0],
            "ground": {"point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}, "metric": true, "rms_px": 0.2});
        std::fs::write(&file, text.to_string()).unwrap();
        let known = KnownCameras::read(&file).unwrap();
        let keys = known.keys_of("right", (320, 240)).unwrap();
        assert_eq!(keys["transform_matrix"][1], json!([5.0, -6.0, -7.0, 8.0]));
        assert_eq!((&keys["fl_y"], &keys["p2"]), (&json!(501.0), &json!(0.01)));
        assert_eq!(known.world.keys().collect::<Vec<_>>(), ["ground", "metric", "up"]);
        let nobody = known.keys_of("middle", (640, 480)).unwrap_err();
        assert!(nobody.to_string().contains("left, right"), "{nobody}");
        assert!(known.keys_of("left", (480, 640)).is_err(), "a film on its side");
    }

    #[test]
    fn a_list_of_pictures_names_its_cameras() {
        let frames = [
            json!({"file_path": "images/c0_00.png", "transform_matrix": [], "fl_x": 1.0}),
            json!({"file_path": "images/c0_01.png", "transform_matrix": []}),
            json!({"file_path": "x.png", "camera_label": "top", "transform_matrix": []}),
            json!({"file_path": "y.png"}),
        ];
        let found = of_frames(&frames, &json!({"fl_y": 2.0}));
        assert_eq!(found.iter().map(|(name, _)| name.as_str()).collect::<Vec<_>>(), ["c0", "top"]);
        assert_eq!((&found[0].1["fl_x"], &found[0].1["fl_y"]), (&json!(1.0), &json!(2.0)));
    }
}
