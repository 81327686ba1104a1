//! What is read off the particles between the pads.

use std::collections::HashMap;

use glam::DVec3;

use super::pad_simulation::{GraspState, Pads};

/// A column counts as touched if the outermost particle in it is at most this far behind the face, in particle
/// spacings.
const CONTACT_DEPTH: f64 = 0.5;

/// The two faces of the matter under the pads.
///
/// They are where the outermost particles end, each of which is half a particle spacing times its stretch thick. The
/// distance of the pads is not quite that: grid nodes feel a pad a little before the matter meets it, or a little
/// behind its face.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct ContactFaces {
    /// Coordinates x of the faces [m], the lower one first.
    pub(super) x_m: [f64; 2],
}

impl ContactFaces {
    /// The faces within the pads' outline; `None` where there is no matter.
    pub(super) fn of(state: &GraspState, pads: &Pads, up: DVec3, spacing: f64) -> Option<Self> {
        let mut x_m = [f64::INFINITY, f64::NEG_INFINITY];
        for p in (0..state.len()).filter(|&p| under_pads(state, pads, up, p)) {
            let (x, half) = (state.position(p).x, 0.5 * spacing * state.stretch_x(p));
            x_m = [x_m[0].min(x - half), x_m[1].max(x + half)];
        }
        (x_m[0] < x_m[1]).then_some(Self { x_m })
    }

    pub(super) fn width(&self) -> f64 {
        self.x_m[1] - self.x_m[0]
    }
}

fn under_pads(state: &GraspState, pads: &Pads, up: DVec3, particle: usize) -> bool {
    let point = state.position(particle) - up * state.pose.lift_m;
    point.y.abs() <= 0.5 * pads.size_m[0] && point.z.abs() <= 0.5 * pads.size_m[1]
}

/// The particles that touch a pad, and the area that they cover.
#[derive(Clone, Debug)]
pub(super) struct ContactPatch {
    /// Numbers of the particles, ascending.
    pub(super) particles: Vec<usize>,
    /// Area [m^2].
    pub(super) area_m2: f64,
}

/// What touches the pad at negative and the one at positive x: the face is divided into squares of one particle
/// spacing; a square counts where the outermost particle is within half a spacing of the face.
pub(super) fn contact_patches(
    state: &GraspState,
    pads: &Pads,
    up: DVec3,
    spacing: f64,
    faces: &ContactFaces,
) -> [ContactPatch; 2] {
    let mut outermost: [HashMap<[i64; 2], (f64, usize)>; 2] = [HashMap::new(), HashMap::new()];
    for p in (0..state.len()).filter(|&p| under_pads(state, pads, up, p)) {
        let position = state.position(p);
        let column = [position.y, position.z].map(|c| (c / spacing).floor() as i64);
        let half = 0.5 * spacing * state.stretch_x(p);
        for (side, columns) in outermost.iter_mut().enumerate() {
            let sign = [-1.0, 1.0][side];
            let behind = sign * faces.x_m[side] - (sign * position.x + half);
            let best = columns.entry(column).or_insert((behind, p));
            if behind < best.0 {
                *best = (behind, p);
            }
        }
    }
    outermost.map(|columns| {
        let mut particles: Vec<usize> =
            columns.into_values().filter(|(behind, _)| *behind <= CONTACT_DEPTH * spacing).map(|(_, p)| p).collect();
        particles.sort_unstable();
        ContactPatch { area_m2: particles.len() as f64 * spacing * spacing, particles }
    })
}

/// Mean position of some particles [m].
pub(super) fn mean_position(state: &GraspState, particles: impl Iterator<Item = usize>) -> DVec3 {
    let (sum, count) = particles.fold((DVec3::ZERO, 0usize), |(sum, n), p| (sum + state.position(p), n + 1));
    sum / count.max(1) as f64
}
