//! Which way is up, and where the ground is.

use std::borrow::Cow;

use glam::DVec3;
use serde::Serialize;

use super::COARSE_HULL_SETTINGS;
use crate::camera::Camera;
use crate::hull::{Hull, HullView};
use crate::picture::Mask;
use crate::scene::Scene;

/// Where knowledge about up and the ground comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum GroundSource {
    /// The format fixes it.
    Format,
    /// A guess: the cameras' mean up, the lowest point of the hull over the frames.
    Guess,
}

pub(super) type Ground = ([f64; 3], [f64; 3], GroundSource);

/// The mean of the cameras' up directions, for people hold cameras upright; where the object falls about that way, the
/// way against its fall.
pub(super) fn guessed_up(scene: &Scene) -> Option<(DVec3, GroundSource)> {
    let sum: DVec3 = scene.cameras.iter().map(|camera| -camera.world_from_camera.y_axis).sum();
    let upright = sum.try_normalize()?;
    let against_fall = scene.flight.as_ref().and_then(|flight| (-flight.acceleration).try_normalize());
    let up = against_fall.filter(|up| up.dot(upright) > std::f64::consts::FRAC_1_SQRT_2).unwrap_or(upright);
    Some((up, GroundSource::Guess))
}

/// The format's ground, checked against the hull, or a guess: the lowest the object gets.
pub(super) fn find_ground(
    scene: &Scene,
    masks: &[Option<Mask>],
    frames: &[usize],
    first: Option<&Hull>,
    up: Option<(DVec3, GroundSource)>,
    warnings: &mut Vec<String>,
) -> Option<Ground> {
    let (up, _) = up?;
    let first = first?;
    if let Some(ground) = scene.world.ground {
        let (low, high) = first.bounds();
        let size = (high - low).max_element();
        let depth = -first.surface().iter().map(|point| ground.height(point.position)).fold(f64::INFINITY, f64::min);
        if depth > 0.1 * size {
            warnings.push(format!(
                "the object starts {depth:.3} m below the ground plane: check the ground, or the unit of length"
            ));
        }
        return Some((ground.point.to_array(), ground.normal.to_array(), GroundSource::Format));
    }
    let mut lowest = f64::INFINITY;
    for &frame in frames {
        let start = scene.views.partition_point(|view| view.frame < frame);
        let seen: Vec<(Cow<Camera>, &Mask)> = scene
            .views_at(frame)
            .iter()
            .enumerate()
            .filter_map(|(offset, view)| {
                let mask = masks[start + offset].as_ref().filter(|mask| mask.bounding_box().is_some())?;
                Some((scene.camera_at_frame(view), mask))
            })
            .collect();
        let views: Vec<HullView> = seen.iter().map(|(camera, mask)| HullView { camera, mask }).collect();
        let hull = if frame == 0 { Some(first.clone()) } else { Hull::carve(&views, &COARSE_HULL_SETTINGS) };
        let heights = hull.iter().flat_map(Hull::points).map(|x| up.dot(x)).fold(f64::INFINITY, f64::min);
        lowest = lowest.min(heights);
    }
    let (low, high) = first.bounds();
    let middle = (low + high) / 2.0;
    let point = middle + up * (lowest - up.dot(middle));
    lowest.is_finite().then(|| (point.to_array(), up.to_array(), GroundSource::Guess))
}
