//! A scene: cameras, times, and the pictures with masks that the cameras took at those times.

use std::path::{Path, PathBuf};

use glam::DVec3;
use rayon::prelude::*;

use crate::camera::Camera;
use crate::error::{Problem, SceneError};
use crate::lens::Lens;
use crate::network::Network;
use crate::picture::{self, Decoded, Mask, Picture};
use crate::{matting, read};

/// The on-disk format a scene was read from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// `all_data.json`: fixed, synchronised cameras.
    PacNerf,
    /// `transforms_train.json` and its siblings: nerf_synthetic (static) and D-NeRF (one moving camera, with `time`).
    Blender,
    /// `camera.json` and `frame.json`: fixed, synchronised cameras, pictures with alpha.
    SpringGausSynthetic,
    /// `dynamic/cameras_calib.json`: a few video cameras, and photographs of the object at rest.
    SpringGausReal,
    /// `transforms.json`: nerfstudio, with lens distortion.
    Nerfstudio,
    /// A COLMAP sparse model, binary or text.
    Colmap,
}

impl std::fmt::Display for Format {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Format::PacNerf => "PAC-NeRF",
            Format::Blender => "Blender / D-NeRF",
            Format::SpringGausSynthetic => "Spring-Gaus, synthetic",
            Format::SpringGausReal => "Spring-Gaus, real capture",
            Format::Nerfstudio => "nerfstudio",
            Format::Colmap => "COLMAP",
        })
    }
}

/// What a view is meant for, where the format says so; everything is [`Split::Train`] otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Split {
    /// To reconstruct from.
    Train,
    /// To tune with.
    Validation,
    /// To measure on.
    Test,
}

/// Where the mask of a view comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MaskSource {
    /// The alpha channel of the picture.
    Alpha,
    /// A mask file: 8 or 16-bit grey coverage, or the alpha channel of an RGBA file.
    File(PathBuf),
    /// A copy of the picture composited over white; the coverage follows from comparing both.
    OverWhite(PathBuf),
    /// Made by comparing the picture with the empty background picture of its camera ([`crate::difference_matte`]).
    Difference,
    /// Made by the matting network given in [`OpenOptions::masks`].
    Network,
}

/// One picture: which camera took it, and when.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// Index into [`Scene::cameras`].
    pub camera: usize,
    /// Index into [`Scene::times`].
    pub frame: usize,
    /// What the view is meant for.
    pub split: Split,
    /// The picture's file.
    pub picture: PathBuf,
    /// Where its mask comes from.
    pub mask: MaskSource,
}

impl View {
    /// The file that the mask is in or made from.
    pub fn mask_path(&self) -> &Path {
        match &self.mask {
            MaskSource::File(path) | MaskSource::OverWhite(path) => path,
            MaskSource::Alpha | MaskSource::Difference | MaskSource::Network => &self.picture,
        }
    }
}

/// A plane in the world frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// A point on the plane [m].
    pub point: DVec3,
    /// The unit normal, pointing to the free side.
    pub normal: DVec3,
}

impl Plane {
    /// Signed distance [m] of a point; positive on the free side.
    pub fn height(&self, x: DVec3) -> f64 {
        self.normal.dot(x - self.point)
    }
}

/// What the format fixes about the world frame; `None` where it says nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct World {
    /// The unit vector that points up.
    pub up: Option<DVec3>,
    /// Gravitational acceleration [m/s^2].
    pub gravity: Option<DVec3>,
    /// The ground, which the object sticks to.
    pub ground: Option<Plane>,
    /// Whether lengths are metres; otherwise the unit is arbitrary (COLMAP, Blender).
    pub metric: bool,
}

/// A coloured point of a sparse reconstruction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColouredPoint {
    /// Position in the world frame.
    pub position: DVec3,
    /// Red, green, blue in [0, 1].
    pub rgb: [f32; 3],
}

/// A multi-view video, a monocular video with a moving camera, or a set of photographs, with masks.
///
/// * Fixed synchronised cameras: `cameras.len()` cameras times `times.len()` frames, one view for each pair.
/// * A moving camera: every view has a camera of its own (`cameras.len() == views.len()`), several views may share a time.
/// * A static scene: one time, 0.
///
/// Opening reads the lists and the headers of all picture files; pixels are decoded by [`Scene::load`] and its relatives.
#[derive(Clone, Debug)]
pub struct Scene {
    /// The folder.
    pub root: PathBuf,
    /// The format it was recognised as.
    pub format: Format,
    /// The cameras, pinholes in the scene's world frame.
    pub cameras: Vec<Camera>,
    /// A name for each camera, as the format calls it.
    pub camera_names: Vec<String>,
    /// Time of each frame [s], increasing; D-NeRF's times have no unit and run from 0 to 1.
    pub times: Vec<f64>,
    /// Frames per second, where the times are evenly spaced (within 1 %).
    pub frame_rate: Option<f64>,
    /// All pictures, sorted by frame, then camera.
    pub views: Vec<View>,
    /// The picture of the empty background, for each camera.
    pub backgrounds: Vec<Option<PathBuf>>,
    /// What is known about the world frame.
    pub world: World,
    /// Sparse points (COLMAP), for initialisation; empty for the other formats.
    pub points: Vec<ColouredPoint>,
    /// Photographs of the undeformed object (Spring-Gaus real capture), in a world frame of their own.
    pub rest: Option<Box<Scene>>,
    /// Problems that do not prevent the use of the scene.
    pub warnings: Vec<Problem>,
    /// Lens distortion of each camera, removed on loading.
    pub(crate) lenses: Vec<Option<Lens>>,
    pub(crate) network: Option<Network>,
}

/// Which masks to use.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Masks {
    /// Alpha channels or mask files where the scene has them, else matting against the empty background.
    #[default]
    Auto,
    /// Matting against the empty background, even where the scene has masks.
    Difference,
    /// The matting network in this ONNX file (needs the cargo feature `onnx`).
    Network(PathBuf),
}

/// Settings for opening a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenOptions {
    /// Which masks to use.
    pub masks: Masks,
    /// Frames per second, in place of what the format says; the times of the frames become frame / rate.
    pub frame_rate: Option<f64>,
    /// Which of several sets in the folder to read (an object of a Spring-Gaus real capture); the first by name if `None`.
    pub set: Option<String>,
}

impl Scene {
    /// Opens the scene in folder `path` (or whose main file `path` is), recognising the format by its files.
    ///
    /// # Errors
    /// [`SceneError::Invalid`] lists everything that is wrong with the data; the other errors stop at once.
    pub fn open(path: impl AsRef<Path>) -> Result<Scene, SceneError> {
        Scene::open_with(path, &OpenOptions::default())
    }

    /// Like [`Scene::open`], with settings.
    ///
    /// # Errors
    /// As [`Scene::open`].
    pub fn open_with(path: impl AsRef<Path>, options: &OpenOptions) -> Result<Scene, SceneError> {
        read::open(path.as_ref(), options)
    }

    /// The view of `camera` at `frame`, if there is one.
    pub fn view(&self, camera: usize, frame: usize) -> Option<&View> {
        self.views_at(frame).iter().find(|view| view.camera == camera)
    }

    /// All views at `frame`, sorted by camera.
    pub fn views_at(&self, frame: usize) -> &[View] {
        let start = self.views.partition_point(|view| view.frame < frame);
        let end = self.views.partition_point(|view| view.frame <= frame);
        &self.views[start..end]
    }

    /// The same scene as if filming had ended after `count` frames.
    #[must_use]
    pub fn first_frames(&self, count: usize) -> Scene {
        let mut scene = self.clone();
        scene.times.truncate(count);
        scene.views.retain(|view| view.frame < count);
        scene
    }

    /// The same scene as if only some cameras had filmed, which become cameras 0, 1, ... in the order given.
    ///
    /// # Errors
    /// [`SceneError::Setting`] where a number is no camera's or comes twice, or where none is given.
    pub fn with_cameras(&self, chosen: &[usize]) -> Result<Scene, SceneError> {
        let wrong = |value: String, reason| SceneError::Setting { name: "cameras", value, reason };
        if chosen.is_empty() {
            return Err(wrong(String::new(), "names no camera".into()));
        }
        for (i, camera) in chosen.iter().enumerate() {
            if *camera >= self.cameras.len() {
                let named = |(i, name): (usize, &String)| format!("{i} ({name})");
                let all: Vec<String> = self.camera_names.iter().enumerate().map(named).collect();
                return Err(wrong(
                    camera.to_string(),
                    format!("is no camera of the scene; there are {}", all.join(", ")),
                ));
            }
            if chosen[..i].contains(camera) {
                return Err(wrong(camera.to_string(), "is named twice".into()));
            }
        }
        let place = |view: &View| chosen.iter().position(|camera| *camera == view.camera);
        let mut views: Vec<View> =
            self.views.iter().filter_map(|view| Some(View { camera: place(view)?, ..view.clone() })).collect();
        views.sort_by_key(|view| (view.frame, view.camera));
        Ok(Scene {
            cameras: chosen.iter().map(|&c| self.cameras[c].clone()).collect(),
            camera_names: chosen.iter().map(|&c| self.camera_names[c].clone()).collect(),
            backgrounds: chosen.iter().map(|&c| self.backgrounds[c].clone()).collect(),
            lenses: chosen.iter().map(|&c| self.lenses[c].clone()).collect(),
            views,
            ..self.clone()
        })
    }

    /// The camera that took a view.
    pub fn camera_of(&self, view: &View) -> &Camera {
        &self.cameras[view.camera]
    }

    /// Whether the object is photographed at one time only.
    pub fn is_static(&self) -> bool {
        self.times.len() <= 1
    }

    /// Whether cameras take many pictures each, from fixed positions.
    pub fn has_fixed_cameras(&self) -> bool {
        self.cameras.len() < self.views.len()
    }

    /// Picture and mask of `camera` at `frame`.
    ///
    /// # Errors
    /// [`SceneError::NoSuchView`]; otherwise as [`Scene::load`].
    pub fn load_view(&self, camera: usize, frame: usize) -> Result<(Picture, Mask), SceneError> {
        self.load(self.view(camera, frame).ok_or(SceneError::NoSuchView { camera, frame })?)
    }

    /// Picture and mask of a view, undistorted, both of the camera's size.
    ///
    /// # Errors
    /// [`SceneError::Invalid`] naming a file that cannot be decoded, or whose size is wrong.
    pub fn load(&self, view: &View) -> Result<(Picture, Mask), SceneError> {
        let Decoded { picture, alpha } = picture::decode(&view.picture)?;
        let mask = match &view.mask {
            MaskSource::Alpha => {
                let coverage = alpha.ok_or_else(|| without_mask(&view.picture))?;
                Mask { width: picture.width, height: picture.height, coverage }
            }
            MaskSource::File(path) => picture::decode_mask(path)?,
            MaskSource::OverWhite(path) => matting::from_white(&picture, &picture::decode(path)?.picture),
            MaskSource::Difference => {
                let background = self.backgrounds[view.camera].as_ref().ok_or_else(|| without_mask(&view.picture))?;
                matting::difference_matte(&picture, &picture::decode(background)?.picture)
            }
            MaskSource::Network => self.network.as_ref().ok_or_else(|| without_mask(&view.picture))?.matte(&picture)?,
        };
        let expected = (picture.width, picture.height);
        if (mask.width, mask.height) != expected {
            return Err(Problem::WrongSize {
                path: view.mask_path().to_owned(),
                found: (mask.width, mask.height),
                expected,
                reference: view.picture.clone(),
            }
            .into());
        }
        self.check_size(view.camera, &picture, &view.picture)?;
        Ok(match &self.lenses[view.camera] {
            Some(lens) => lens.undistort(&self.cameras[view.camera], &picture, &mask),
            None => (picture, mask),
        })
    }

    /// The mask of a view; cheaper than [`Scene::load`] where the mask is a file of its own.
    ///
    /// # Errors
    /// As [`Scene::load`].
    pub fn load_mask(&self, view: &View) -> Result<Mask, SceneError> {
        match (&view.mask, &self.lenses[view.camera]) {
            (MaskSource::File(path), None) => {
                let mask = picture::decode_mask(path)?;
                let camera = &self.cameras[view.camera];
                let expected = (camera.width, camera.height);
                if (mask.width, mask.height) != expected {
                    let found = (mask.width, mask.height);
                    let reference = view.picture.clone();
                    return Err(Problem::WrongSize { path: path.clone(), found, expected, reference }.into());
                }
                Ok(mask)
            }
            _ => Ok(self.load(view)?.1),
        }
    }

    /// The masks of several views, loaded in parallel, in their order.
    ///
    /// # Errors
    /// As [`Scene::load`]; problems of all views are listed together.
    pub fn load_masks(&self, views: &[View]) -> Result<Vec<Mask>, SceneError> {
        gather(views.par_iter().map(|view| self.load_mask(view)).collect())
    }

    /// Pictures and masks of several views, loaded in parallel, in their order.
    ///
    /// # Errors
    /// As [`Scene::load`]; problems of all views are listed together.
    pub fn load_all(&self, views: &[View]) -> Result<Vec<(Picture, Mask)>, SceneError> {
        gather(views.par_iter().map(|view| self.load(view)).collect())
    }

    /// The picture of the empty background of `camera`, undistorted, if the scene has one.
    ///
    /// # Errors
    /// As [`Scene::load`].
    pub fn load_background(&self, camera: usize) -> Result<Option<Picture>, SceneError> {
        let Some(path) = &self.backgrounds[camera] else { return Ok(None) };
        let picture = picture::decode(path)?.picture;
        self.check_size(camera, &picture, path)?;
        let Some(lens) = &self.lenses[camera] else { return Ok(Some(picture)) };
        let everywhere =
            Mask { width: picture.width, height: picture.height, coverage: vec![1.0; picture.width * picture.height] };
        Ok(Some(lens.undistort(&self.cameras[camera], &picture, &everywhere).0))
    }

    /// Decodes every picture and mask and lists what is wrong: files that cannot be decoded, empty masks. Opening has
    /// already checked everything that does not need pixels.
    pub fn check_pixels(&self) -> Vec<Problem> {
        let areas: Vec<Result<f64, SceneError>> =
            self.views.par_iter().map(|view| self.load(view).map(|(_, mask)| mask.area())).collect();
        self.judge_areas(&areas)
    }

    /// Problems found in the masks' areas [pixels], one entry for each view.
    pub(crate) fn judge_areas(&self, areas: &[Result<f64, SceneError>]) -> Vec<Problem> {
        let mut problems = Vec::new();
        let mut filled = vec![false; self.times.len()];
        for (view, area) in self.views.iter().zip(areas) {
            match area {
                Err(SceneError::Invalid(found)) => {
                    problems.extend(found.iter().cloned());
                    filled[view.frame] = true;
                }
                Err(other) => {
                    problems.push(Problem::Unreadable { path: view.picture.clone(), reason: other.to_string() });
                    filled[view.frame] = true;
                }
                Ok(area) if *area > 0.0 => filled[view.frame] = true,
                Ok(_) => {
                    problems.push(Problem::EmptyMask { path: view.mask_path().to_owned() });
                }
            }
        }
        let empty = (0..self.times.len()).filter(|&frame| !filled[frame]);
        problems.extend(empty.map(|frame| Problem::EmptyFrame {
            path: self.root.clone(),
            frame,
            time: self.times[frame],
        }));
        problems
    }

    fn check_size(&self, camera: usize, picture: &Picture, path: &Path) -> Result<(), SceneError> {
        let camera = &self.cameras[camera];
        if (picture.width, picture.height) == (camera.width, camera.height) {
            return Ok(());
        }
        Err(Problem::WrongSize {
            path: path.to_owned(),
            found: (picture.width, picture.height),
            expected: (camera.width, camera.height),
            reference: self.root.clone(),
        }
        .into())
    }
}

fn without_mask(picture: &Path) -> Problem {
    Problem::MissingMask { picture: picture.to_owned(), hint: read::MASK_HINT.to_owned() }
}

/// All values, or all problems together; an error that is no list of problems wins.
fn gather<T>(results: Vec<Result<T, SceneError>>) -> Result<Vec<T>, SceneError> {
    let mut values = Vec::with_capacity(results.len());
    let mut problems = Vec::new();
    for result in results {
        match result {
            Ok(value) => values.push(value),
            Err(SceneError::Invalid(found)) => problems.extend(found),
            Err(other) => return Err(other),
        }
    }
    if problems.is_empty() { Ok(values) } else { Err(SceneError::Invalid(problems)) }
}
