//! Cameras of a rendering: those of the scene, or an orbit.

use std::f64::consts::{PI, TAU};
use std::str::FromStr;

use gic_scene::{Camera, Picture, Scene};
use glam::{DMat3, DVec2, DVec3};

use super::shade::{Backdrop, Environment};
use super::simulated_motion::SimulatedMotion;
use super::{Background, RenderRequest, STAGE};
use crate::error::{Result, ViewError};

/// Where the camera of a rendering is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Viewpoint {
    /// One turn around the motion, from a little above.
    Orbit,
    /// A camera of the scene, by its number.
    Camera(usize),
}

/// A text that is no [`Viewpoint`].
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("must be `orbit` or a camera's number")]
pub struct ViewpointError;

impl FromStr for Viewpoint {
    type Err = ViewpointError;

    fn from_str(text: &str) -> std::result::Result<Self, ViewpointError> {
        match text {
            "orbit" => Ok(Self::Orbit),
            number => number.parse().map(Self::Camera).map_err(|_| ViewpointError),
        }
    }
}

/// Height of the orbit's camera above the horizon [rad].
const ELEVATION: f64 = 0.35;
/// Half of the angle that the orbit's camera sees [rad].
const HALF_ANGLE: f64 = 0.35;
/// How much of the picture's half the motion fills at most; the rest is margin, and place for labels.
const FILLED: f64 = 0.86;
/// How much of the body's way the orbit's camera follows: the body stays large, and is still seen to move.
const FOLLOWED: f64 = 0.8;

/// The camera of every frame, and what does not move.
pub(super) enum CameraPath<'a> {
    Orbit { frames: Vec<Camera> },
    Fixed { number: usize, camera: Camera, backdrop: Option<Picture>, scene: &'a Scene },
}

impl<'a> CameraPath<'a> {
    pub(super) fn new(request: &RenderRequest, motion: &SimulatedMotion, scene: Option<&'a Scene>) -> Result<Self> {
        let needs_picture = request.background == Background::Picture;
        match request.viewpoint {
            Viewpoint::Orbit if request.beside_video => Err(ViewError::Usage {
                problem: "no video was taken from an orbit".into(),
                hint: Some("use a camera of the scene: --camera 0 --beside-video".into()),
            }),
            Viewpoint::Orbit if needs_picture => Err(ViewError::Usage {
                problem: "an orbit has no background picture".into(),
                hint: Some("use a camera of the scene (--camera 0), or --background floor, black or white".into()),
            }),
            Viewpoint::Orbit => Ok(Self::Orbit { frames: orbit_of(motion, request.size) }),
            Viewpoint::Camera(number) => {
                let Some(scene) = scene else {
                    return Err(ViewError::Usage {
                        problem: "these frames do not say which scene's cameras to use".into(),
                        hint: Some("add --scene SCENE, or use --camera orbit".into()),
                    });
                };
                let Some(camera) = scene.cameras.get(number) else {
                    return Err(ViewError::Usage {
                        problem: format!("the scene has no camera {number}"),
                        hint: Some(format!("its cameras are 0 to {}", scene.cameras.len().saturating_sub(1))),
                    });
                };
                let backdrop =
                    if needs_picture { scene.load_background(number).map_err(ViewError::stage(STAGE))? } else { None };
                if needs_picture && backdrop.is_none() {
                    return Err(ViewError::Usage {
                        problem: format!("camera {number} has no picture of the empty scene"),
                        hint: Some("use --background floor, black or white".into()),
                    });
                }
                Ok(Self::Fixed { number, camera: camera.clone(), backdrop, scene })
            }
        }
    }

    /// The camera of a frame.
    pub(super) fn camera(&self, index: usize) -> &Camera {
        match self {
            Self::Fixed { camera, .. } => camera,
            Self::Orbit { frames } => &frames[index],
        }
    }

    /// The video's picture at a time [s]; black where there is none.
    pub(super) fn video(&self, time_s: f64) -> Result<Picture> {
        let Self::Fixed { number, camera, scene, .. } = self else {
            unreachable!("an orbit beside the video is refused")
        };
        let half_frame = 0.5 / scene.frame_rate.unwrap_or(24.0);
        let frame = scene.times.iter().position(|t| (t - time_s).abs() < half_frame);
        match frame.and_then(|frame| scene.view(*number, frame)) {
            Some(view) => Ok(scene.load(view).map_err(ViewError::stage(STAGE))?.0),
            None => {
                let rgb = vec![0.0; 3 * camera.width * camera.height];
                Ok(Picture { width: camera.width, height: camera.height, rgb })
            }
        }
    }

    /// What the matter stands before.
    pub(super) fn environment(&self, motion: &SimulatedMotion, background: Background) -> Environment<'_> {
        let backdrop = match (background, self) {
            (Background::Picture, Self::Fixed { backdrop: Some(picture), .. }) => Backdrop::Picture(picture),
            (Background::White, _) => Backdrop::Plain([1.0; 3]),
            (Background::Floor, _) => Backdrop::Floor(motion.planes()),
            _ => Backdrop::Plain([0.0; 3]),
        };
        Environment { backdrop, up: motion.up() }
    }
}

/// One turn around a motion, as near as the bodies stay in the picture in every frame.
fn orbit_of(motion: &SimulatedMotion, size: [usize; 2]) -> Vec<Camera> {
    let (low, high) = motion.bounds();
    let middle = 0.5 * (low + high);
    let frames = &motion.trajectory.frames;
    let boxes: Vec<(DVec3, DVec3)> = frames.iter().map(|frame| (frame.low_m.into(), frame.high_m.into())).collect();
    let centre = |(low, high): &(DVec3, DVec3)| middle.lerp(0.5 * (*low + *high), FOLLOWED);
    let camera = |index: usize, distance: f64| {
        let turn = TAU * index as f64 / frames.len() as f64 + 0.25 * PI;
        orbit(centre(&boxes[index]), distance, motion.up(), turn, size)
    };
    let distance = (0..frames.len()).map(|i| distance_to(boxes[i], &camera(i, 0.0))).fold(1e-6, f64::max);
    (0..frames.len()).map(|index| camera(index, distance)).collect()
}

/// How far a camera that stands where it looks has to go back to see everything within the bounds [m].
fn distance_to((low, high): (DVec3, DVec3), camera: &Camera) -> f64 {
    let slopes = FILLED * camera.principal / camera.focal;
    let corner =
        |i: usize| DVec3::from_array([0, 1, 2].map(|axis| if i >> axis & 1 == 0 { low[axis] } else { high[axis] }));
    let needed = |p: DVec3| (p.x.abs() / slopes.x).max(p.y.abs() / slopes.y) - p.z;
    (0..8).map(|i| needed(camera.world_from_camera.transpose() * (corner(i) - camera.centre))).fold(0.0, f64::max)
}

/// A camera that sees everything within the bounds [m] from the side `from`, a little above.
pub(super) fn beside(bounds: (DVec3, DVec3), up: DVec3, from: DVec3, size: [usize; 2]) -> Camera {
    let horizontal = from.reject_from_normalized(up).try_normalize().unwrap_or_else(|| up.any_orthonormal_vector());
    let at = |distance: f64| looking(0.5 * (bounds.0 + bounds.1), distance, up, horizontal, size);
    at(distance_to(bounds, &at(0.0)))
}

/// A camera on an orbit around `centre`, `distance` metres away.
fn orbit(centre: DVec3, distance: f64, up: DVec3, turn: f64, size: [usize; 2]) -> Camera {
    let (side, other) = up.any_orthonormal_pair();
    looking(centre, distance, up, side * turn.cos() + other * turn.sin(), size)
}

/// A camera that looks at `centre` from `distance` metres away, from the side of the unit vector `horizontal` and a
/// little above.
fn looking(centre: DVec3, distance: f64, up: DVec3, horizontal: DVec3, [width, height]: [usize; 2]) -> Camera {
    let outward = horizontal * ELEVATION.cos() + up * ELEVATION.sin();
    let forward = -outward;
    let right = forward.cross(up).normalize();
    Camera {
        width,
        height,
        focal: DVec2::splat(0.5 * height as f64 / HALF_ANGLE.tan()),
        principal: DVec2::new(0.5 * width as f64, 0.5 * height as f64),
        world_from_camera: DMat3::from_cols(right, forward.cross(right), forward),
        centre: centre + outward * distance,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_orbit_keeps_the_centre_in_the_middle_and_up_up() {
        for turn in [0.0, 1.0, 4.0] {
            let centre = DVec3::new(0.3, 0.2, -0.1);
            let camera = orbit(centre, 2.0, DVec3::Y, turn, [320, 200]);
            let (pixel, depth) = camera.project(centre).unwrap();
            assert!((pixel - DVec2::new(160.0, 100.0)).length() < 1e-9 && (depth - 2.0).abs() < 1e-9);
            let (above, _) = camera.project(centre + DVec3::Y * 0.1).unwrap();
            assert!(above.y < pixel.y && (above.x - pixel.x).abs() < 1e-9);
            assert!((camera.world_from_camera.determinant() - 1.0).abs() < 1e-12);
        }
    }

    #[test]
    fn a_box_fills_the_picture_and_stays_inside() {
        let bounds = (DVec3::new(-0.1, 0.0, -0.3), DVec3::new(0.2, 0.5, 0.1));
        let camera = beside(bounds, DVec3::Y, DVec3::new(1.0, 0.0, 2.0), [640, 480]);
        let corner =
            |i: usize| DVec3::from_array([0, 1, 2].map(|a| if i >> a & 1 == 0 { bounds.0[a] } else { bounds.1[a] }));
        let places: Vec<DVec2> =
            (0..8).map(|i| (camera.project(corner(i)).unwrap().0 - camera.principal) / camera.principal).collect();
        let farthest = places.iter().map(|p| p.abs().max_element()).fold(0.0, f64::max);
        assert!((farthest - FILLED).abs() < 1e-9, "{farthest}");
    }

    #[test]
    fn viewpoints_are_orbit_or_a_number() {
        assert_eq!("orbit".parse(), Ok(Viewpoint::Orbit));
        assert_eq!("3".parse(), Ok(Viewpoint::Camera(3)));
        assert!("left".parse::<Viewpoint>().is_err());
    }
}
