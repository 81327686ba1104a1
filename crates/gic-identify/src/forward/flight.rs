//! Rigid free flight: what moves before anything is touched.

use glam::{DQuat, DVec3};
use rayon::prelude::*;

use crate::forward::drawing::Drawing;
use crate::forward::shape::ShapeModes;
use crate::forward::trajectories::{ForwardModel, FrameSelection, Trajectories};
use crate::observe::video::ObservedVideo;
use crate::unknowns::state::State;
use crate::{FitError, Input};

/// Distance travelled after `time` by gravity alone, as symplectic Euler sums it with steps of `dt`: g t (t + dt) / 2.
///
/// The simulator's truth, not the closed form, is what has to agree with the rollout that follows.
pub(crate) fn fall(gravity: DVec3, time: f64, dt: f64) -> DVec3 {
    gravity * (0.5 * time * (time + dt))
}

/// Volumes of the particles of `input` as `state` shapes them, in units of the input's particle volume, shape [n].
pub(crate) fn volume_factors(input: &Input, shape: &ShapeModes, state: &State) -> Vec<f64> {
    let mut factors = input.volume_factors.clone();
    factors.resize(input.positions.len(), 1.0);
    shape.stretch(&mut factors, &state.shape);
    factors
}

/// Particles of `input` as `state` places and shapes them at time 0 [m], and the centre about which they turn.
pub(crate) fn placed(input: &Input, shape: &ShapeModes, state: &State) -> (Vec<DVec3>, DVec3) {
    let mut positions = input.positions.clone();
    shape.displace(&mut positions, &state.shape);
    positions.iter_mut().for_each(|p| *p += state.offset);
    (positions, input.centre() + state.offset)
}

/// Seconds of one substep.
pub(crate) fn substep(input: &Input) -> f64 {
    1.0 / (input.frame_rate_hz * input.substeps_per_frame as f64)
}

/// Free flight of a rigid body.
#[derive(Clone, Copy)]
pub(crate) struct Flight<'a> {
    pub input: &'a Input,
    pub video: &'a ObservedVideo,
    pub shape: &'a ShapeModes,
}

impl Flight<'_> {
    /// Positions at simulated frame `frame` [m], shape [n].
    pub(crate) fn positions(&self, state: &State, frame: usize) -> Vec<DVec3> {
        let (placed, centre) = placed(self.input, self.shape, state);
        let time = frame as f64 / self.input.frame_rate_hz;
        let rotation = DQuat::from_scaled_axis(state.angular * time);
        let shift = state.velocity * time + fall(self.input.gravity_m_s2, time, substep(self.input));
        placed.into_iter().map(|p| centre + rotation * (p - centre) + shift).collect()
    }
}

impl ForwardModel for Flight<'_> {
    fn trajectories(&self, state: &State, selection: &FrameSelection) -> Result<Trajectories, FitError> {
        let end = selection.end.min(self.video.frames.len());
        let positions: Vec<Vec<[f32; 3]>> = (0..self.video.frames.len())
            .into_par_iter()
            .map(|o| {
                if o < selection.first || o >= end {
                    return Vec::new();
                }
                let world = self.positions(state, self.video.frames[o].simulated_frame);
                world.iter().map(|p| p.as_vec3().to_array()).collect()
            })
            .collect();
        let scales = vec![self.input.scales.clone(); positions.len()];
        let outward_displacements = self.shape.outward_displacements(&state.shape);
        let drawing = Drawing::of(state);
        Ok(Trajectories { positions, velocities: Vec::new(), scales, drawing, outward_displacements })
    }
}
