//! A scene: cameras, times, and the pictures with masks that the cameras took at those times.

use std::path::PathBuf;

use crate::camera::Camera;
use crate::error::{Problem, SceneError};
use crate::flight::{CalibrationError, FreeFlight};
use crate::format::Format;
use crate::lens::Lens;
use crate::network::Network;
use crate::view::View;
use crate::world::{ColouredPoint, World};

/// A multi-view video, a monocular video with a moving camera, or a set of photographs, with masks.
///
/// * Fixed cameras: `cameras.len()` cameras times `times.len()` frames, one view for each pair at most. Each view has
///   its own time, for cameras may lag.
/// * A moving camera: every view has a camera of its own (`cameras.len() == views.len()`), several views may share a
///   time.
/// * A static scene: one time, 0.
///
/// Opening reads the lists and the headers of all picture files; pixels are decoded by [`Scene::load`] and its
/// relatives.
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
    /// By how much each camera's pictures are later than the first one's, as the free flight shows [s]; empty where
    /// none is. The times hold them.
    pub delays_s: Vec<f64>,
    /// What the free flight shows to be wrong with each camera's calibration; empty where nothing is. The cameras hold
    /// them.
    pub calibration_errors: Vec<CalibrationError>,
    /// Standard deviations of the cameras' errors.
    pub calibration_error_deviations: Vec<CalibrationError>,
    /// The free flight of the first frames, where [`Scene::corrected`] found one.
    pub flight: Option<FreeFlight>,
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

impl Scene {
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
            calibration_errors: chosen.iter().filter_map(|&c| self.calibration_errors.get(c).copied()).collect(),
            calibration_error_deviations: (chosen.iter())
                .filter_map(|&c| self.calibration_error_deviations.get(c).copied())
                .collect(),
            delays_s: chosen.iter().filter_map(|&c| self.delays_s.get(c).copied()).collect(),
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
}
