//! What lies outside of a mask in any moment is empty: the hull of all moments.
//!
//! Places move along their normals to where they are wanted, which takes no limb away that is not there at all: its
//! outlines lie so far off that each counts as explained by something else. But matter stays matter in all moments.
//! What the motion carries out of a mask by more than it errs there belongs to no body.
//!
//! A thin part may move otherwise than the motion has it. It is in the masks of the flight, whose motion is known, and
//! nothing else covers them there: that stays.

use gic_geometry::Pose;
use glam::DVec3;
use rayon::prelude::*;

use super::tracked::{Anchors, deformation};
use super::{Observed, SeenMoment};
use crate::Filling;

/// What the motion carries out of a mask by so many standard deviations of its error is empty. Derived: of Gaussian
/// errors one in 700 is larger.
const CERTAIN_DEVIATIONS: f64 = 3.0;

/// Takes from a `body` what lies outside of the hull: its surface there lies where the motion errs by
/// [`CERTAIN_DEVIATIONS`].
pub(super) fn cut(body: &mut Filling, observed: &Observed, poses: &[Pose], seen: &[SeenMoment]) {
    let (field, th_min) = (&mut body.field, body.th_min);
    let full: Vec<usize> = (0..field.len()).filter(|i| field.values[*i] > 0.0).collect();
    let points: Vec<DVec3> = full.iter().map(|i| field.centre(field.voxel(*i))).collect();
    let anchors = Anchors::new(&points, observed.particles, observed.spacing);
    let mut within = vec![f64::INFINITY; points.len()];
    let mut flying = Vec::new();
    for (((moment, pose), outlines), seen) in observed.moments.iter().zip(poses).zip(&observed.outlines).zip(seen) {
        let moved: Vec<DVec3> = anchors.moved(&moment.positions).map(|(point, _)| point).collect();
        let errors = deformation(&points, &moved);
        let centre = seen.surface.centre - pose.shift;
        let moved: Vec<DVec3> = moved.into_iter().map(|point| pose.moved(point, centre)).collect();
        within.par_iter_mut().zip(&moved).zip(errors).for_each(|((within, point), deformation)| {
            let error = seen.miss.hypot(observed.tuning.across_time.deformation_error * deformation);
            *within = within.min(outlines.depth(*point) + CERTAIN_DEVIATIONS * error);
        });
        if moment.flies {
            flying.push((outlines, moved));
        }
    }
    let is_kept = |(i, within): (&usize, &f64)| f64::from(field.values[*i]) >= th_min && *within >= 0.0;
    let is_kept: Vec<bool> = full.iter().zip(&within).map(is_kept).collect();
    for (outlines, moved) in flying {
        let needed = outlines.uncovered(&moved, &is_kept, field.spacing);
        needed.into_iter().for_each(|i| within[i] = f64::INFINITY);
    }
    for (i, within) in full.into_iter().zip(within) {
        // The density falls over a voxel to each side.
        let density = th_min + 0.5 * within / field.spacing;
        field.values[i] = field.values[i].min(density.max(0.0) as f32);
    }
}
