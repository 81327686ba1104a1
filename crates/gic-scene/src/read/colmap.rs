//! COLMAP: a sparse model (`cameras`, `images`, `points3D`; `.bin` or `.txt`) with the photographs. Poses are
//! world-to-camera quaternions (w, x, y, z) and translations, x right, y down, z forward; lengths have no unit.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec2, DVec3};

use super::draft::{Draft, DraftCamera, DraftView, Intrinsics};
use super::mask_file::find_mask;
use super::pose::{self, UnsupportedModel};
use crate::error::{Problem, SceneError};
use crate::format::Format;
use crate::lens::Lens;
use crate::settings::SceneSettings;
use crate::view::{MaskSource, Split};
use crate::world::{ColouredPoint, World};

/// Folders, relative to the scene, in which a model may lie.
pub(super) const MODEL_FOLDERS: [&str; 5] = ["sparse/0", "sparse", "colmap/sparse/0", "colmap", "."];

/// COLMAP's camera models in the order of their ids, and the number of their parameters.
const MODELS: [(&str, usize); 13] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    ("SIMPLE_DIVISION", 4),
];

struct ModelCamera {
    model: String,
    width: usize,
    height: usize,
    parameters: Vec<f64>,
}

struct ModelImage {
    name: String,
    camera: u32,
    rotation: DQuat,
    translation: DVec3,
}

/// The folder of the model in a scene, if there is one.
pub(super) fn model_folder(root: &Path) -> Option<PathBuf> {
    let complete = |folder: &PathBuf| {
        ["bin", "txt"].iter().any(|kind| {
            folder.join(format!("cameras.{kind}")).is_file() && folder.join(format!("images.{kind}")).is_file()
        })
    };
    MODEL_FOLDERS.iter().map(|folder| root.join(folder)).find(complete)
}

pub(super) fn read(root: &Path, _: &SceneSettings) -> Result<Draft, SceneError> {
    let model = model_folder(root).ok_or_else(|| SceneError::UnknownFormat { path: root.to_owned() })?;
    read_model(&model, &root.join("images"), &root.join("masks"))
}

/// Reads the model in `folder`, with photographs in `pictures` and masks, if any, in `masks`.
pub(super) fn read_model(folder: &Path, pictures: &Path, masks: &Path) -> Result<Draft, SceneError> {
    let binary = folder.join("cameras.bin").is_file();
    let file = |name: &str| folder.join(format!("{name}.{}", if binary { "bin" } else { "txt" }));
    let (cameras_file, images_file, points_file) = (file("cameras"), file("images"), file("points3D"));
    let (cameras, mut images, points) = if binary {
        let points = if points_file.is_file() { binary::points(&points_file)? } else { Vec::new() };
        (binary::cameras(&cameras_file)?, binary::images(&images_file)?, points)
    } else {
        let points = if points_file.is_file() { text::points(&points_file)? } else { Vec::new() };
        (text::cameras(&cameras_file)?, text::images(&images_file)?, points)
    };
    images.sort_by(|a, b| a.name.cmp(&b.name));
    let world = World { up: None, gravity: None, ground: None, ground_deviation_m: 0.0, metric: false };
    let mut draft = Draft::new(Format::Colmap, images_file.clone(), world);
    draft.points = points;
    for image in images {
        match draft_camera(&image, &cameras, &cameras_file, &images_file) {
            Ok(camera) => {
                let mask = find_mask(masks, Path::new(&image.name)).map(MaskSource::File);
                let picture = pictures.join(&image.name);
                draft.views.push(DraftView {
                    camera: draft.cameras.len(),
                    time: 0.0,
                    split: Split::Train,
                    picture,
                    mask,
                });
                draft.cameras.push(camera);
            }
            Err(problem) => draft.problems.push(problem),
        }
    }
    Ok(draft)
}

fn draft_camera(
    image: &ModelImage,
    cameras: &BTreeMap<u32, ModelCamera>,
    cameras_file: &Path,
    images_file: &Path,
) -> Result<DraftCamera, Problem> {
    let no_pose = |reason: String| Problem::NoPose { path: images_file.to_owned(), camera: image.name.clone(), reason };
    let model = cameras.get(&image.camera).ok_or_else(|| no_pose(format!("camera {} does not exist", image.camera)))?;
    let ((focal, principal), lens) = lens_of(model).map_err(|UnsupportedModel(model)| Problem::UnsupportedCamera {
        path: cameras_file.to_owned(),
        camera: format!("camera {}", image.camera),
        model,
    })?;
    let norm = image.rotation.length();
    if !(norm > 0.5 && norm < 2.0 && image.translation.is_finite()) {
        return Err(no_pose("the quaternion or translation is not a pose".into()));
    }
    let camera_from_world = DMat3::from_quat(image.rotation.normalize());
    pose::check_rotation(camera_from_world).map_err(|error| no_pose(error.to_string()))?;
    let world_from_camera = camera_from_world.transpose();
    Ok(DraftCamera {
        name: image.name.clone(),
        intrinsics: Intrinsics::Pixels { focal, principal, size: Some((model.width, model.height)) },
        world_from_camera,
        centre: -(world_from_camera * image.translation),
        lens,
        background: None,
    })
}

type Pinhole = (DVec2, DVec2);

/// Focal lengths, principal point and lens of a camera whose model is supported.
fn lens_of(camera: &ModelCamera) -> Result<(Pinhole, Option<Lens>), UnsupportedModel> {
    let p = &camera.parameters;
    let expected = MODELS.iter().find(|(name, _)| *name == camera.model).map(|(_, count)| *count);
    if expected.is_some_and(|count| count != p.len()) {
        return Err(UnsupportedModel(format!("{} with {} parameters", camera.model, p.len())));
    }
    let one = |p: &[f64]| (DVec2::splat(p[0]), DVec2::new(p[1], p[2]));
    let two = |p: &[f64]| (DVec2::new(p[0], p[1]), DVec2::new(p[2], p[3]));
    let radial = |k1, k2| Lens::Perspective { k: [k1, k2, 0.0, 0.0, 0.0, 0.0], p: [0.0; 2] };
    let (pinhole, lens) = match camera.model.as_str() {
        "SIMPLE_PINHOLE" => (one(p), None),
        "PINHOLE" => (two(p), None),
        "SIMPLE_RADIAL" => (one(p), Some(radial(p[3], 0.0))),
        "RADIAL" => (one(p), Some(radial(p[3], p[4]))),
        "OPENCV" => (two(p), Some(Lens::Perspective { k: [p[4], p[5], 0.0, 0.0, 0.0, 0.0], p: [p[6], p[7]] })),
        "OPENCV_FISHEYE" => (two(p), Some(Lens::Fisheye { k: [p[4], p[5], p[6], p[7]] })),
        "FULL_OPENCV" => {
            (two(p), Some(Lens::Perspective { k: [p[4], p[5], p[8], p[9], p[10], p[11]], p: [p[6], p[7]] }))
        }
        "FOV" => (two(p), Some(Lens::FieldOfView { omega: p[4] })),
        "SIMPLE_RADIAL_FISHEYE" => (one(p), Some(Lens::Fisheye { k: [p[3], 0.0, 0.0, 0.0] })),
        "RADIAL_FISHEYE" => (one(p), Some(Lens::Fisheye { k: [p[3], p[4], 0.0, 0.0] })),
        other => return Err(UnsupportedModel(other.to_owned())),
    };
    let finite = p.iter().all(|value| value.is_finite());
    if !(finite && pinhole.0.x > 0.0 && pinhole.0.y > 0.0) {
        return Err(UnsupportedModel(format!("{} with focal lengths that are not positive", camera.model)));
    }
    Ok((pinhole, lens.and_then(Lens::unless_trivial)))
}

/// The binary files: little-endian, packed.
mod binary {
    use super::{BTreeMap, ColouredPoint, DQuat, DVec3, MODELS, ModelCamera, ModelImage, Path, SceneError};

    struct Bytes<'a> {
        data: &'a [u8],
        at: usize,
        path: &'a Path,
    }

    impl Bytes<'_> {
        fn take<const N: usize>(&mut self) -> Result<[u8; N], SceneError> {
            let end = self.at.checked_add(N).filter(|&end| end <= self.data.len()).ok_or_else(|| self.truncated())?;
            let bytes = self.data[self.at..end].try_into().map_err(|_| self.truncated())?;
            self.at = end;
            Ok(bytes)
        }

        fn u8(&mut self) -> Result<u8, SceneError> {
            Ok(u8::from_le_bytes(self.take()?))
        }

        fn u32(&mut self) -> Result<u32, SceneError> {
            Ok(u32::from_le_bytes(self.take()?))
        }

        fn u64(&mut self) -> Result<u64, SceneError> {
            Ok(u64::from_le_bytes(self.take()?))
        }

        fn f64(&mut self) -> Result<f64, SceneError> {
            Ok(f64::from_le_bytes(self.take()?))
        }

        fn vec3(&mut self) -> Result<DVec3, SceneError> {
            Ok(DVec3::new(self.f64()?, self.f64()?, self.f64()?))
        }

        fn skip(&mut self, count: u64, size: u64) -> Result<(), SceneError> {
            let end = count.checked_mul(size).and_then(|bytes| (self.at as u64).checked_add(bytes));
            let end = end.filter(|&end| end <= self.data.len() as u64).ok_or_else(|| self.truncated())?;
            self.at = end as usize;
            Ok(())
        }

        fn truncated(&self) -> SceneError {
            SceneError::Malformed {
                path: self.path.to_owned(),
                reason: format!("ends early, after {} bytes; export the model again", self.data.len()),
            }
        }
    }

    fn load(path: &Path) -> Result<Vec<u8>, SceneError> {
        Ok(gic_files::input::read(path).map_err(gic_files::FileError::read(path))?)
    }

    pub(super) fn cameras(path: &Path) -> Result<BTreeMap<u32, ModelCamera>, SceneError> {
        let data = load(path)?;
        let mut bytes = Bytes { data: &data, at: 0, path };
        let mut cameras = BTreeMap::new();
        for _ in 0..bytes.u64()? {
            let (id, model) = (bytes.u32()?, bytes.u32()?);
            let (width, height) = (bytes.u64()? as usize, bytes.u64()? as usize);
            let Some(&(name, count)) = MODELS.get(model as usize) else {
                // The number of its parameters is unknown, so nothing behind it can be read.
                let reason = format!(
                    "camera {id} uses the camera model number {model}, which is not supported; undistort the \
                     pictures first"
                );
                return Err(SceneError::Malformed { path: path.to_owned(), reason });
            };
            let parameters = (0..count).map(|_| bytes.f64()).collect::<Result<_, _>>()?;
            cameras.insert(id, ModelCamera { model: name.to_owned(), width, height, parameters });
        }
        Ok(cameras)
    }

    pub(super) fn images(path: &Path) -> Result<Vec<ModelImage>, SceneError> {
        let data = load(path)?;
        let mut bytes = Bytes { data: &data, at: 0, path };
        let mut images = Vec::new();
        for _ in 0..bytes.u64()? {
            bytes.u32()?;
            let w = bytes.f64()?;
            let (axis, translation) = (bytes.vec3()?, bytes.vec3()?);
            let camera = bytes.u32()?;
            let mut name = Vec::new();
            loop {
                match bytes.u8()? {
                    0 => break,
                    byte => name.push(byte),
                }
            }
            let observations = bytes.u64()?;
            bytes.skip(observations, 24)?;
            let rotation = DQuat::from_xyzw(axis.x, axis.y, axis.z, w);
            images.push(ModelImage {
                name: String::from_utf8_lossy(&name).into_owned(),
                camera,
                rotation,
                translation,
            });
        }
        Ok(images)
    }

    pub(super) fn points(path: &Path) -> Result<Vec<ColouredPoint>, SceneError> {
        let data = load(path)?;
        let mut bytes = Bytes { data: &data, at: 0, path };
        let mut points = Vec::new();
        for _ in 0..bytes.u64()? {
            bytes.u64()?;
            let position = bytes.vec3()?;
            let rgb = bytes.take::<3>()?.map(|value| f32::from(value) / 255.0);
            bytes.f64()?;
            let track = bytes.u64()?;
            bytes.skip(track, 8)?;
            points.push(ColouredPoint { position, rgb });
        }
        Ok(points)
    }
}

/// The text files: fields separated by spaces, comments behind `#`.
mod text {
    use std::str::FromStr;

    use super::{BTreeMap, ColouredPoint, DQuat, DVec3, ModelCamera, ModelImage, Path, SceneError};

    struct Line<'a> {
        number: usize,
        text: &'a str,
        path: &'a Path,
    }

    impl<'a> Line<'a> {
        fn bad(&self, reason: &str) -> SceneError {
            SceneError::Malformed { path: self.path.to_owned(), reason: format!("line {}: {reason}", self.number) }
        }

        fn field<T: FromStr>(&self, fields: &mut impl Iterator<Item = &'a str>, name: &str) -> Result<T, SceneError> {
            let field = fields.next().ok_or_else(|| self.bad(&format!("{name} is missing")))?;
            field.parse().map_err(|_| self.bad(&format!("{name} is `{field}`, which cannot be read")))
        }

        fn vec3(&self, fields: &mut impl Iterator<Item = &'a str>, name: &str) -> Result<DVec3, SceneError> {
            Ok(DVec3::new(self.field(fields, name)?, self.field(fields, name)?, self.field(fields, name)?))
        }
    }

    fn load(path: &Path) -> Result<String, SceneError> {
        Ok(gic_files::input::read_to_string(path).map_err(gic_files::FileError::read(path))?)
    }

    fn lines<'a>(text: &'a str, path: &'a Path) -> impl Iterator<Item = Line<'a>> {
        let lines = text.lines().enumerate().filter(|(_, text)| !text.trim_start().starts_with('#'));
        lines.map(move |(index, text)| Line { number: index + 1, text, path })
    }

    pub(super) fn cameras(path: &Path) -> Result<BTreeMap<u32, ModelCamera>, SceneError> {
        let text = load(path)?;
        let mut cameras = BTreeMap::new();
        for line in lines(&text, path).filter(|line| !line.text.trim().is_empty()) {
            let mut fields = line.text.split_whitespace();
            let id = line.field(&mut fields, "CAMERA_ID")?;
            let model = line.field(&mut fields, "MODEL")?;
            let (width, height) = (line.field(&mut fields, "WIDTH")?, line.field(&mut fields, "HEIGHT")?);
            let parameters =
                fields.map(|field| line.field(&mut std::iter::once(field), "PARAMS")).collect::<Result<_, _>>()?;
            cameras.insert(id, ModelCamera { model, width, height, parameters });
        }
        Ok(cameras)
    }

    pub(super) fn images(path: &Path) -> Result<Vec<ModelImage>, SceneError> {
        let text = load(path)?;
        let mut images = Vec::new();
        let mut lines = lines(&text, path);
        while let Some(line) = lines.next() {
            if line.text.trim().is_empty() {
                continue;
            }
            let mut fields = line.text.split_whitespace();
            line.field::<u32>(&mut fields, "IMAGE_ID")?;
            let w: f64 = line.field(&mut fields, "QW")?;
            let axis = line.vec3(&mut fields, "QX, QY, QZ")?;
            let translation = line.vec3(&mut fields, "TX, TY, TZ")?;
            let camera = line.field(&mut fields, "CAMERA_ID")?;
            // A name may hold spaces.
            let name = fields.collect::<Vec<_>>().join(" ");
            if name.is_empty() {
                return Err(line.bad("NAME is missing"));
            }
            images.push(ModelImage {
                name,
                camera,
                rotation: DQuat::from_xyzw(axis.x, axis.y, axis.z, w),
                translation,
            });
            // The second line of each image lists its observations, and may be empty.
            if let Some(second) = lines.next().filter(|second| !are_observations(second.text)) {
                return Err(second.bad(
                    "must list the observations (X, Y, POINT3D_ID, ...) of the image above it, or be an empty line",
                ));
            }
        }
        Ok(images)
    }

    /// Whether a line is a list of triples of numbers, perhaps empty.
    fn are_observations(text: &str) -> bool {
        text.split_whitespace().count().is_multiple_of(3)
            && text.split_whitespace().all(|field| field.parse::<f64>().is_ok())
    }

    pub(super) fn points(path: &Path) -> Result<Vec<ColouredPoint>, SceneError> {
        let text = load(path)?;
        let mut points = Vec::new();
        for line in lines(&text, path).filter(|line| !line.text.trim().is_empty()) {
            let mut fields = line.text.split_whitespace();
            line.field::<u64>(&mut fields, "POINT3D_ID")?;
            let position = line.vec3(&mut fields, "X, Y, Z")?;
            let rgb = line.vec3(&mut fields, "R, G, B")? / 255.0;
            points.push(ColouredPoint { position, rgb: rgb.as_vec3().to_array() });
        }
        Ok(points)
    }
}
