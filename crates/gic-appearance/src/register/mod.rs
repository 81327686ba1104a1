//! Registration: where a scan of the object lies in the first frame of a video, from pictures and masks alone.
//!
//! Nobody gives a pose. From every rotation of a covering of SO(3) the scan is moved and grown until its outlines lie
//! on the masks; the best of them that differ are fitted to the pictures with the rasteriser's gradients, first small
//! pictures, then whole ones.

mod covering;
mod outline;
mod placement;
mod refine;

use std::ops::ControlFlow;

use gic_motion::LossWeights;
use gic_motion::pictures::{self, Ball, Target};
use gic_scene::{Scene, Similarity};
use gic_splat::Gaussians;
use glam::DVec3;
use rayon::prelude::*;

use crate::tuning::{
    COARSE_OBJECT_PX, COARSE_RATES, FINALISTS, FINE_RATES, FIRST_SIZE_SHARE, MAX_OUTLINE_POINTS, MIN_BASELINE_RAD,
    MIN_OPAQUE_GAUSSIANS, MIN_OUTLINE_OPACITY, SAME_PLACEMENT_RAD, START_SEPARATION_RAD,
};
use crate::{AppearanceError, RegisterSettings};
use covering::angle;
use outline::{Outline, align_outlines};
use placement::Placement;
use refine::{DescentSchedule, PlacementScore, refine, score_placement};

/// One way to place the scan.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// From the scan's frame to the world of the video [m].
    pub world_from_scan: Similarity,
    /// Overlap with the mask in each view, intersection over union, in the order of [`Registration::cameras`].
    pub iou: Vec<f64>,
    /// Mean loss over the views.
    pub loss: f64,
    /// Angle to the best one's rotation [rad].
    pub apart_rad: f64,
}

/// What registration found.
#[derive(Clone, Debug, PartialEq)]
pub struct Registration {
    /// Camera (index into the scene's list) of each view of the first frame that shows the object.
    pub cameras: Vec<usize>,
    /// The best first; the others are what else was tried, as far as it differs.
    pub candidates: Vec<Candidate>,
}

/// Finds where `scan`, Gaussians in a frame of their own, lies at the first frame of `video`.
///
/// Its colours must not depend on the direction (degree 0). `callback` hears how many of how many fits are done and may
/// end the search, with what was found until then.
///
/// # Errors
/// [`AppearanceError::Unregistrable`] where the views cannot tell; unreadable pictures.
pub fn register(
    scan: &Gaussians,
    video: &Scene,
    settings: &RegisterSettings,
    callback: &mut dyn FnMut(usize, usize) -> ControlFlow<()>,
) -> Result<Registration, AppearanceError> {
    if settings.starts == 0 || settings.candidates == 0 {
        let reason = "starts and candidates must be at least 1".into();
        return Err(AppearanceError::Setting { setting: "register", reason });
    }
    let mut views = pictures::first_frame(video)?;
    let ball = object(&views, video)?;
    views.retain(|view| view.area > 0.0);
    let body = ScanPoints::new(scan)?;
    let weights = LossWeights { color: settings.color, ssim: 0.0, mask: 1.0, ..LossWeights::default() };
    let starts = starts(&body, &views, &ball, settings);
    let small: Vec<Target> = views.iter().map(shrunk).collect();
    let (first, of) = (starts.len(), starts.len() + FINALISTS.min(starts.len()));
    let mut fits: Vec<(Placement, PlacementScore)> = Vec::new();
    for start in starts {
        let schedule = DescentSchedule { steps: settings.steps, rates: COARSE_RATES };
        let placement = refine((scan, body.radius), &small, start, schedule, &weights)?;
        fits.push((placement, score_placement(scan, &small, &placement, &weights)?));
        if callback(fits.len(), of).is_break() {
            break;
        }
    }
    let mut fits = distinct(fits);
    for (done, (placement, _)) in fits.iter_mut().enumerate().take(FINALISTS) {
        let schedule = DescentSchedule { steps: settings.final_steps, rates: FINE_RATES };
        *placement = refine((scan, body.radius), &views, *placement, schedule, &weights)?;
        if callback(first + done + 1, of).is_break() {
            break;
        }
    }
    for (placement, score) in &mut fits {
        *score = score_placement(scan, &views, placement, &weights)?;
    }
    let fits = distinct(fits);
    let best = fits[0].0.rotation;
    let candidate = |(placement, score): (Placement, PlacementScore)| Candidate {
        world_from_scan: placement.similarity(),
        iou: score.iou,
        loss: score.loss,
        apart_rad: angle(placement.rotation, best),
    };
    Ok(Registration {
        cameras: views.iter().map(|view| view.camera_index).collect(),
        candidates: fits.into_iter().map(candidate).collect(),
    })
}

/// Whether the first frame of `video` can tell where anything lies: cheap to ask before a scan is made.
///
/// # Errors
/// [`AppearanceError::Unregistrable`] where it cannot; unreadable pictures.
pub fn check_registrable(video: &Scene) -> Result<(), AppearanceError> {
    object(&pictures::first_frame(video)?, video).map(|_| ())
}

/// A scan moved into the world. Colours lose their dependence on direction (degrees above 0), which is not turned.
#[must_use]
pub fn place_scan(scan: &Gaussians, world_from_scan: &Similarity) -> Gaussians {
    let rotation = glam::DQuat::from_mat3(&world_from_scan.rotation);
    let placement =
        Placement { pivot: DVec3::ZERO, scale: world_from_scan.scale, rotation, place: world_from_scan.translation };
    let mut moved = placement.gaussians(scan);
    let per_gaussian = moved.sh_per_gaussian();
    moved.sh = moved.sh.into_iter().step_by(per_gaussian).collect();
    moved.sh_degree = 0;
    moved
}

/// Where the object is in the video's first frame.
fn object(views: &[Target], video: &Scene) -> Result<Ball, AppearanceError> {
    let unregistrable = |reason: String| Err(AppearanceError::Unregistrable(reason));
    let name = |view: &Target| &video.camera_names[view.camera_index];
    let seen: Vec<&Target> = views.iter().filter(|view| view.area > 0.0).collect();
    if seen.len() < 2 {
        let who = seen.first().map_or("no camera shows".into(), |view| format!("only camera {} shows", name(view)));
        return unregistrable(format!(
            "{who} the object in the first frame; one view cannot tell its size from its distance, at least \
             two are needed"
        ));
    }
    let Some(ball) = pictures::ball(&seen) else {
        return unregistrable(
            "the rays through the masks of the first frame do not meet in front of the cameras: a pose is \
             wrong or mirrored"
                .into(),
        );
    };
    let direction = |view: &Target| (ball.centre - view.camera.centre).normalize();
    let widest = seen.iter().map(|view| direction(view).angle_between(direction(seen[0]))).fold(0.0, f64::max);
    if widest < MIN_BASELINE_RAD {
        return unregistrable(format!(
            "the cameras look at the object from directions only {:.1} degrees apart, which cannot tell its \
             size from its distance",
            widest.to_degrees()
        ));
    }
    for view in &seen {
        let ray = view.camera.unproject(view.centre.into(), 1.0) - view.camera.centre;
        let miss = (ball.centre - view.camera.centre).reject_from(ray).length();
        if miss > ball.radius {
            return unregistrable(format!(
                "the ray through the mask of camera {} passes {miss:.3} m from where the cameras' rays meet, \
                 and the object's radius is {:.3} m: the pose of that camera or another is wrong or mirrored, or its \
                 mask shows another object",
                name(view),
                ball.radius
            ));
        }
    }
    Ok(ball)
}

/// The scan's body.
struct ScanPoints {
    centre: DVec3,
    /// Points about the centre.
    points: Vec<DVec3>,
    /// Root mean square distance of the points from the centre.
    radius: f64,
}

impl ScanPoints {
    fn new(scan: &Gaussians) -> Result<ScanPoints, AppearanceError> {
        let opaque: Vec<DVec3> = (0..scan.len())
            .filter(|&i| scan.opacities[i] >= MIN_OUTLINE_OPACITY)
            .map(|i| DVec3::from_array(scan.positions[i].map(f64::from)))
            .collect();
        if opaque.len() < MIN_OPAQUE_GAUSSIANS {
            let reason =
                format!("the scan has only {} opaque Gaussians: look at its masks with `gic inspect`", opaque.len());
            return Err(AppearanceError::Unregistrable(reason));
        }
        let centre = opaque.iter().sum::<DVec3>() / opaque.len() as f64;
        let stride = opaque.len().div_ceil(MAX_OUTLINE_POINTS);
        let points: Vec<DVec3> = opaque.iter().step_by(stride).map(|x| *x - centre).collect();
        let radius = (points.iter().map(|x| x.length_squared()).sum::<f64>() / points.len() as f64).sqrt();
        Ok(ScanPoints { centre, points, radius })
    }
}

/// The placements to fit to the pictures: the best outlines from all starting rotations, well apart.
fn starts(body: &ScanPoints, views: &[Target], ball: &Ball, settings: &RegisterSettings) -> Vec<Placement> {
    let outlines: Vec<Outline> = views.iter().map(Outline::new).collect();
    let mut scored: Vec<(Placement, f64)> = covering::super_fibonacci_rotations(settings.starts)
        .into_par_iter()
        .map(|rotation| {
            let scale = FIRST_SIZE_SHARE * ball.radius / body.radius;
            align_outlines(
                &body.points,
                &outlines,
                Placement { pivot: body.centre, scale, rotation, place: ball.centre },
            )
        })
        .collect();
    scored.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut chosen: Vec<Placement> = Vec::new();
    for (placement, _) in scored {
        if chosen.len() == settings.candidates {
            break;
        }
        if chosen.iter().all(|other| angle(other.rotation, placement.rotation) > START_SEPARATION_RAD) {
            chosen.push(placement);
        }
    }
    chosen
}

/// Fits by loss, without those that a better one is near to.
fn distinct(mut fits: Vec<(Placement, PlacementScore)>) -> Vec<(Placement, PlacementScore)> {
    fits.sort_by(|a, b| a.1.loss.total_cmp(&b.1.loss));
    let mut kept: Vec<(Placement, PlacementScore)> = Vec::new();
    for fit in fits {
        if kept.iter().all(|other| angle(other.0.rotation, fit.0.rotation) > SAME_PLACEMENT_RAD) {
            kept.push(fit);
        }
    }
    kept
}

/// The picture halved until the object is small.
fn shrunk(target: &Target) -> Target {
    let mut small = target.clone();
    while small.area.sqrt() > COARSE_OBJECT_PX {
        small = small.halved();
    }
    small
}
