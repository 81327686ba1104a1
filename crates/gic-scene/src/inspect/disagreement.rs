//! Cameras that do not agree with each other: all of them misread in one way, one of them wrong, one mask too large.

use glam::{DMat3, DVec3};
use rayon::prelude::*;

use super::{COARSE_HULL_SETTINGS, mean};
use crate::camera::Camera;
use crate::hull::{Hull, HullView};

/// Below this overlap of silhouette and mask a camera is looked into.
const MIN_GOOD_IOU: f64 = 0.9;

/// What undoes a common mistake in reading a camera.
type Repair = fn(&Camera) -> Camera;

/// Warnings about cameras that do not agree: all of them flipped in one way, one of them wrong, one mask too large.
pub(super) fn diagnose(views: &[HullView], names: &[&str], overlaps: &[f64]) -> Vec<String> {
    let worst = overlaps.iter().copied().fold(1.0, f64::min);
    if worst >= MIN_GOOD_IOU || views.len() < 2 {
        return Vec::new();
    }
    let now = mean(overlaps);
    // All cameras misread in one way?
    let mistakes: [(&str, Repair); 3] = [
        ("negate the 2nd and 3rd column of the camera-to-world matrices (OpenGL against OpenCV axes)", flip_yz),
        ("the matrices are world-to-camera: invert them", invert),
        ("the pictures are upside down, or the 2nd column of the matrices is negated", flip_y),
    ];
    let tried = mistakes.map(|(advice, repair)| {
        let cameras: Vec<Camera> = views.iter().map(|view| repair(view.camera)).collect();
        let repaired: Vec<HullView> =
            cameras.iter().zip(views).map(|(camera, view)| HullView { camera, mask: view.mask }).collect();
        (mean_overlap(&repaired), advice)
    });
    let best = tried.into_iter().fold((0.0, ""), |best, tried| if tried.0 > best.0 { tried } else { best });
    if best.0 > MIN_GOOD_IOU - 0.05 && best.0 > now + 0.05 {
        return vec![format!(
            "the cameras' axes look flipped: silhouettes and masks overlap by {now:.2}, but by {:.2} after \
             this change: {}",
            best.0, best.1
        )];
    }
    // One camera wrong? Without it, the others agree.
    if views.len() >= 4 {
        let without: Vec<f64> = (0..views.len())
            .into_par_iter()
            .map(|index| {
                let others: Vec<HullView> =
                    views.iter().enumerate().filter(|(i, _)| *i != index).map(|(_, view)| *view).collect();
                mean_overlap(&others)
            })
            .collect();
        let outlier = (0..views.len()).max_by(|&a, &b| without[a].total_cmp(&without[b])).unwrap_or(0);
        if without[outlier] > now + 0.03 && without[outlier] > MIN_GOOD_IOU - 0.05 {
            return vec![format!(
                "camera {} disagrees with the others: without it, silhouettes and masks overlap by {:.2} \
                 instead of {now:.2}; \
                 check its pose (a flipped axis?) and its masks",
                names[outlier], without[outlier]
            )];
        }
    }
    let low = names.iter().zip(overlaps).filter(|(_, overlap)| **overlap < MIN_GOOD_IOU);
    let listed: Vec<String> = low.map(|(name, overlap)| format!("{name} ({overlap:.2})")).collect();
    vec![format!(
        "the hull's silhouettes and the masks overlap poorly for {} of {} cameras: {}; check poses, \
         intrinsics and masks",
        listed.len(),
        views.len(),
        listed.join(", ")
    )]
}

/// Mean overlap of silhouettes and masks of a coarse hull; 0 when nothing remains.
fn mean_overlap(views: &[HullView]) -> f64 {
    let Some(hull) = Hull::carve(views, &COARSE_HULL_SETTINGS) else { return 0.0 };
    mean(&views.par_iter().map(|view| hull.reprojection_iou(view)).collect::<Vec<f64>>())
}

fn flip_yz(camera: &Camera) -> Camera {
    Camera {
        world_from_camera: camera.world_from_camera * DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)),
        ..camera.clone()
    }
}

fn flip_y(camera: &Camera) -> Camera {
    Camera {
        world_from_camera: camera.world_from_camera * DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0)),
        ..camera.clone()
    }
}

/// The camera if its OpenGL camera-to-world matrix was in truth world-to-camera.
fn invert(camera: &Camera) -> Camera {
    let axes = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    let to_camera = (camera.world_from_camera * axes).transpose();
    Camera { world_from_camera: to_camera * axes, centre: -(to_camera * camera.centre), ..camera.clone() }
}
