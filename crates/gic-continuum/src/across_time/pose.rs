//! The pose of each moment, by its outlines.

use glam::{DMat3, DQuat, DVec3};
use nalgebra::{Matrix6, Vector6};
use rayon::prelude::*;

use super::Moment;
use super::contour::{MomentOutlines, deviation};
use super::tracked::CarriedSurface;

/// Steps of the first fit of a moment. Budget: a turn of twenty degrees is found in ten.
const FIRST_STEPS: usize = 12;
/// Steps of a fit in later rounds, when shape and poses are fitted in turns. Budget: the next round goes on.
const STEPS: usize = 2;
/// A fit ends where the body moves by less than this [pixels]. Budget.
const SETTLED_PX: f64 = 0.02;

/// A turn about the body's centre and a shift, on top of the motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pose {
    pub(super) turn: DMat3,
    pub(super) shift: DVec3,
}

impl Default for Pose {
    fn default() -> Pose {
        Pose { turn: DMat3::IDENTITY, shift: DVec3::ZERO }
    }
}

impl Pose {
    /// Where a point of a body around `centre` goes.
    pub(super) fn moved(&self, point: DVec3, centre: DVec3) -> DVec3 {
        self.turn * (point - centre) + centre + self.shift
    }
}

/// Fits the poses of all moments after the flight. At `first`, each starts from the one before it: errors of a motion
/// grow with time.
pub(super) fn follow(
    poses: &mut [Pose],
    carried: &[CarriedSurface],
    moments: &[Moment],
    outlines: &[MomentOutlines],
    first: bool,
) {
    if first {
        for m in 1..moments.len() {
            if !moments[m].flies {
                poses[m] = aligned(poses[m - 1], &carried[m], &outlines[m], FIRST_STEPS);
            }
        }
    } else {
        let touched = poses.par_iter_mut().enumerate().filter(|(m, _)| !moments[*m].flies);
        touched.for_each(|(m, pose)| *pose = aligned(*pose, &carried[m], &outlines[m], STEPS));
    }
}

/// Gauss-Newton's method on the gaps between contours and outlines: a turn `w` about the centre `c` and a shift `t`
/// move a contour by `direction . (t + w x (x - c))`.
fn aligned(start: Pose, carried: &CarriedSurface, outlines: &MomentOutlines, steps: usize) -> Pose {
    let mut pose = start;
    for _ in 0..steps {
        let moved = carried.moved(&pose);
        let contour = outlines.contour(&moved);
        let pixel = outlines.pixel(&moved);
        let deviation = deviation(&contour, pixel);
        // A body's size, so that turns and shifts are alike.
        let size = contour.iter().map(|point| point.point.distance(moved.centre)).fold(f64::MIN_POSITIVE, f64::max);
        let (mut normal, mut right) = (Matrix6::zeros(), Vector6::zeros());
        for point in &contour {
            let turn = (point.point - moved.centre).cross(point.direction) / size;
            let [x, y, z] = point.direction.to_array();
            let row = Vector6::new(x, y, z, turn.x, turn.y, turn.z);
            let weight = point.weight(deviation);
            normal += weight * row * row.transpose();
            right += weight * point.gap * row;
        }
        // What no outline tells, as the turn of a ball, stays.
        let damping = 1e-3 * normal.trace() / 6.0;
        let Some(step) = (normal + Matrix6::identity() * damping).cholesky().map(|factor| factor.solve(&right)) else {
            return pose;
        };
        if !step.iter().all(|s| s.is_finite()) {
            return pose;
        }
        pose.shift += DVec3::new(step[0], step[1], step[2]);
        let turn = DVec3::new(step[3], step[4], step[5]) / size;
        pose.turn = DMat3::from_quat(DQuat::from_scaled_axis(turn)) * pose.turn;
        if step.norm() <= SETTLED_PX * pixel {
            break;
        }
    }
    pose
}
