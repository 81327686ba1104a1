//! The pose of each moment, by its outlines.

use gic_geometry::Pose;
use glam::DVec3;
use nalgebra::{Matrix6, Vector6};

use super::contour::{ContourPoint, MomentOutlines, deviation};
use super::tracked::CarriedSurface;
use super::{Moment, SeenMoment};

/// Steps of the first fit of a moment. Budget: a turn of twenty degrees is found in ten.
const FIRST_STEPS: usize = 12;
/// A fit ends where the body moves by less than this [pixels]. Budget.
const SETTLED_PX: f64 = 0.02;

/// Fits the poses of all moments after the flight, each from the one before it: errors of a motion grow with time.
pub(super) fn first(poses: &mut [Pose], carried: &[CarriedSurface], moments: &[Moment], outlines: &[MomentOutlines]) {
    for m in 1..moments.len() {
        if !moments[m].flies {
            poses[m] = aligned(poses[m - 1], &carried[m], &outlines[m]);
        }
    }
}

/// Moves the poses of all moments after the flight nearer to their outlines, by what was seen in them. Shape and poses
/// are fitted in turns: the next round goes on.
pub(super) fn follow(poses: &mut [Pose], moments: &[Moment], seen: &[SeenMoment]) {
    for ((pose, moment), seen) in poses.iter_mut().zip(moments).zip(seen) {
        if !moment.flies {
            step(pose, &seen.contour, seen.miss, seen.surface.centre);
        }
    }
}

/// The pose at which a moment's contours lie in its outlines, sought from `start`.
fn aligned(start: Pose, carried: &CarriedSurface, outlines: &MomentOutlines) -> Pose {
    let mut pose = start;
    for _ in 0..FIRST_STEPS {
        let moved = carried.moved(&pose);
        let contour = outlines.contour(&moved);
        let pixel = outlines.pixel(&moved);
        if step(&mut pose, &contour, deviation(&contour, pixel), moved.centre) <= SETTLED_PX * pixel {
            break;
        }
    }
    pose
}

/// A step of Gauss-Newton's method on the gaps between contour and outlines, which have a standard deviation
/// `deviation` [m]: a turn `w` about the centre `c` and a shift `t` move a contour by
/// `direction . (t + w x (x - c))`. Returns how far it moves the body [m].
fn step(pose: &mut Pose, contour: &[ContourPoint], deviation: f64, centre: DVec3) -> f64 {
    // A body's size, so that turns and shifts are alike.
    let size = contour.iter().map(|point| point.point.distance(centre)).fold(f64::MIN_POSITIVE, f64::max);
    let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
    for point in contour {
        let turn = (point.point - centre).cross(point.direction) / size;
        let [x, y, z] = point.direction.to_array();
        let row = Vector6::new(x, y, z, turn.x, turn.y, turn.z);
        let weight = point.weight(deviation);
        normal += weight * row * row.transpose();
        right += weight * point.gap * row;
    }
    // What no outline tells, as the turn of a ball, stays.
    let damping = 1e-3 * normal.trace() / 6.0;
    let step = (normal + Matrix6::identity() * damping).cholesky().map(|factor| factor.solve(&right));
    let Some(step) = step.filter(|step| step.iter().all(|s| s.is_finite())) else { return 0.0 };
    *pose = pose.then(Pose::small(step.into(), size));
    step.norm()
}
