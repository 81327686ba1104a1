//! Rigid free flight: what moves before anything is touched.

use glam::{DQuat, DVec3};
use rayon::prelude::*;

use crate::Input;
use crate::data::Data;
use crate::objective::{Forward, Level, Motion};
use crate::state::State;

/// Distance travelled after `time` by gravity alone, as symplectic Euler sums it with steps of `dt`: g t (t + dt) / 2.
///
/// The simulator's truth, not the closed form, is what has to agree with the rollout that follows.
pub(crate) fn fall(gravity: DVec3, time: f64, dt: f64) -> DVec3 {
    gravity * (0.5 * time * (time + dt))
}

/// Particles of `input` as `state` places them at time 0 [m], and their centre.
pub(crate) fn placed(input: &Input, state: &State) -> (Vec<DVec3>, DVec3) {
    let centre = input.centre();
    let factor = state.size.exp();
    let mut positions: Vec<DVec3> =
        input.positions.iter().map(|p| centre + state.offset + (*p - centre) * factor).collect();
    if state.underside != DVec3::ZERO {
        lift_underside(&mut positions, centre + state.offset, -input.gravity_m_s2.normalize_or_zero(), state.underside);
    }
    (positions, centre + state.offset)
}

/// Raises the lower parts by `lift` (mean [m]; more of it at one radius along two horizontal axes), growing with the square of the
/// depth below the top: undersides are what no camera shows, and they meet the ground first.
fn lift_underside(positions: &mut [DVec3], centre: DVec3, up: DVec3, lift: DVec3) {
    if up == DVec3::ZERO {
        return;
    }
    let across = up.any_orthonormal_pair();
    let (low, high) = positions
        .iter()
        .map(|p| (*p - centre).dot(up))
        .fold((f64::MAX, f64::MIN), |(low, high), h| (low.min(h), high.max(h)));
    let flat = |p: &DVec3| ((*p - centre).dot(across.0), (*p - centre).dot(across.1));
    let radius = positions.iter().map(flat).map(|(x, y)| x.hypot(y)).fold(f64::MIN_POSITIVE, f64::max);
    for p in positions {
        let (x, y) = flat(p);
        let depth = (high - (*p - centre).dot(up)) / (high - low).max(f64::MIN_POSITIVE);
        *p += up * depth * depth * (lift.x + lift.y * x / radius + lift.z * y / radius);
    }
}

/// Share of its volume that the body loses where its underside is raised by `lift` [m]: that of a column as high as the body.
pub(crate) fn lost_volume(input: &Input, lift: f64) -> f64 {
    let up = input.gravity_m_s2.normalize_or_zero();
    let heights = input.positions.iter().map(|p| p.dot(up));
    let (low, high) = heights.fold((f64::MAX, f64::MIN), |(low, high), h| (low.min(h), high.max(h)));
    lift / (high - low).max(f64::MIN_POSITIVE)
}

/// Seconds of one substep.
pub(crate) fn substep(input: &Input) -> f64 {
    1.0 / (input.frame_rate_hz * input.substeps_per_frame as f64)
}

/// Free flight of a rigid body.
pub(crate) struct Flight<'a> {
    pub input: &'a Input,
    pub data: &'a Data,
}

impl Flight<'_> {
    /// Positions at simulated frame `frame` [m], shape [n].
    pub(crate) fn positions(&self, state: &State, frame: usize) -> Vec<DVec3> {
        let (placed, centre) = placed(self.input, state);
        let time = frame as f64 / self.input.frame_rate_hz;
        let rotation = DQuat::from_scaled_axis(state.angular * time);
        let shift = state.velocity * time + fall(self.input.gravity_m_s2, time, substep(self.input));
        placed.into_iter().map(|p| centre + rotation * (p - centre) + shift).collect()
    }
}

impl Forward for Flight<'_> {
    fn motion(&self, state: &State, level: &Level) -> Result<Motion, String> {
        let end = level.end.min(self.data.moments.len());
        let positions: Vec<Vec<[f32; 3]>> = (0..self.data.moments.len())
            .into_par_iter()
            .map(|o| {
                if o < level.first || o >= end {
                    return Vec::new();
                }
                let world = self.positions(state, self.data.moments[o].frame);
                world.iter().map(|p| p.as_vec3().to_array()).collect()
            })
            .collect();
        let scales = vec![self.input.scales.clone(); positions.len()];
        Ok(Motion { positions, scales, splat_factor: state.splat.exp() as f32 })
    }
}
