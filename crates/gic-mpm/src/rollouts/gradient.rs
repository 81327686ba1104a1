//! The derivative of a loss on the positions of any frames, by the adjoint: one forward pass that keeps checkpoints,
//! and one reverse pass that goes from checkpoint to checkpoint, last first.
//!
//! The cost is that of two forward passes and the adjoint, for any number of unknowns. Checkpoints lie every `stride`
//! segments; the stride grows as the memory budget fills. The reverse pass recomputes the states at the segments'
//! starts from a checkpoint, then each segment in full.

use gic_simd::Scalar;
use glam::DVec3;

use super::advance::Rollout;
use super::checkpoints::Checkpoints;
use super::frame::Frame;
use super::timestep_bound::Timing;
use crate::error::{LossGradientError, SimulationError};
use crate::laws::law::Coefficients;
use crate::options::Options;
use crate::substep::engine::{BodyBars, Engine, Segment};
use crate::substep::prepared_world::{PreparedBody, PreparedWorld};
use crate::substep::state::{State, double, vector};
use crate::substep::with_engine;
use crate::{Forecast, World};

/// Derivatives of a loss with respect to what a body starts with.
#[derive(Clone, Debug)]
pub struct BodyGradient {
    /// With respect to the material's parameters, in the order of [`crate::Material::parameters`].
    pub material: Vec<f64>,
    /// With respect to the density [per kg/m^3], at constant particle volume.
    pub density: f64,
    /// With respect to the rest volume of a particle of factor 1 [per m^3], at constant density and factors.
    pub particle_volume: f64,
    /// With respect to the initial velocity [per m/s].
    pub velocity: DVec3,
    /// With respect to the initial angular velocity [per rad/s].
    pub angular_velocity: DVec3,
    /// With respect to each initial position [per m], shape [n]; the initial velocity field of a spinning body moves
    /// along.
    pub positions: Vec<DVec3>,
    /// With respect to each particle's own initial velocity [per m/s], shape [n]; they sum to `velocity`.
    pub velocities: Vec<DVec3>,
}

/// Derivatives of a loss, and the frames on the way.
#[derive(Clone, Debug)]
pub struct Gradient {
    /// One per body.
    pub bodies: Vec<BodyGradient>,
}

/// Simulates `frames` frames (frame 0 included) and differentiates a loss.
///
/// `loss` is called once per frame in ascending order and returns the derivative of the loss with respect to that
/// frame's positions [per m], shape [n], or `None` where the loss does not depend on them.
///
/// # Errors
/// As [`crate::rollout`]; [`SimulationError::MemoryBudget`] when not even the sparsest checkpoints fit, and
/// [`SimulationError::LossGradient`] when `loss` returns something of the wrong length or not finite.
pub fn gradient(
    world: &World,
    options: &Options,
    frames: usize,
    mut loss: impl FnMut(&Frame) -> Option<Vec<DVec3>>,
) -> Result<Gradient, SimulationError> {
    gradient_of(world, options, frames, &mut loss)
}

/// Not generic over the loss, so that the engines are compiled here and not again in every crate that has one.
fn gradient_of(
    world: &World,
    options: &Options,
    frames: usize,
    loss: &mut dyn FnMut(&Frame) -> Option<Vec<DVec3>>,
) -> Result<Gradient, SimulationError> {
    Forecast::of(world, frames)?.check(&options.budget)?;
    let prepared = PreparedWorld::new(world, options.rules)?;
    with_engine!(options, engine => {
        let rollout = Rollout::new(&engine, &prepared, Timing::of(world));
        Reverse::forward(rollout, frames, options.gradient_memory_bytes, loss)?.backward()
    })
}

/// A rollout with what its reverse pass needs.
struct Reverse<'a, E: Engine> {
    rollout: Rollout<'a, E>,
    checkpoints: Checkpoints<E::Number>,
    segments: Vec<Segment>,
    /// For each frame, the index after its last segment; 0 for frame 0.
    frame_ends: Vec<usize>,
    /// For each frame, the derivative of the loss with respect to its positions.
    position_bars: Vec<Option<Vec<DVec3>>>,
}

impl<'a, E: Engine> Reverse<'a, E> {
    fn forward(
        rollout: Rollout<'a, E>,
        frames: usize,
        budget: usize,
        mut loss: impl FnMut(&Frame) -> Option<Vec<DVec3>>,
    ) -> Result<Self, SimulationError> {
        let mut state = rollout.world.initial_state::<E::Number>();
        let particles = state.len();
        let per_state = State::<E::Number>::bytes(particles);
        let most = budget.saturating_sub(rollout.bytes_beside_checkpoints(&state)) / per_state;
        let mut reverse = Self {
            rollout,
            checkpoints: Checkpoints::new(most),
            segments: Vec::new(),
            frame_ends: Vec::new(),
            position_bars: Vec::new(),
        };
        for index in 0..frames {
            let frame = if index == 0 {
                reverse.rollout.frame(0, &state, None)
            } else {
                let (done, checkpoints) = (reverse.segments.len(), &mut reverse.checkpoints);
                let advanced = reverse
                    .rollout
                    .advance_frame(&mut state, index, &mut |i, state| checkpoints.offer(done + i, state))?;
                reverse.segments.extend(&advanced.segments);
                // The grid may have grown since the checkpoints were planned.
                let held = reverse.checkpoints.held();
                let needed_bytes = reverse.rollout.bytes_beside_checkpoints(&state) + held * per_state;
                if needed_bytes > budget {
                    return Err(SimulationError::MemoryBudget { needed_bytes, budget_bytes: budget });
                }
                reverse.rollout.frame(index, &state, Some(&advanced))
            };
            reverse.frame_ends.push(reverse.segments.len());
            reverse.position_bars.push(checked(loss(&frame), index, particles)?);
        }
        Ok(reverse)
    }

    fn backward(mut self) -> Result<Gradient, SimulationError> {
        let prepared = self.rollout.world;
        let mut adjoint = State::<E::Number>::zeros(prepared.particles());
        let mut bars = vec![BodyBars::default(); prepared.bodies.len()];
        let stride = self.checkpoints.stride;
        while let Some(state) = self.checkpoints.states.pop() {
            let first = self.checkpoints.states.len() * stride;
            let last = (first + stride).min(self.segments.len());
            let starts = self.segment_starts(state, first, last)?;
            for (segment, start) in (first..last).zip(starts).rev() {
                self.add_losses(segment + 1, &mut adjoint);
                let tape = self.rollout.record(&start, self.segments[segment])?;
                self.rollout.engine.reverse(prepared, tape, &mut adjoint, &mut bars);
            }
        }
        self.add_losses(0, &mut adjoint);
        let bodies = prepared
            .bodies
            .iter()
            .zip(&bars)
            .map(|(body, bars)| body_gradient((body, prepared.mass_unit), bars, &adjoint))
            .collect();
        Ok(Gradient { bodies })
    }

    /// The states at the starts of segments `first .. last`, from that at the first.
    fn segment_starts(
        &self,
        state: State<E::Number>,
        first: usize,
        last: usize,
    ) -> Result<Vec<State<E::Number>>, SimulationError> {
        let mut starts = vec![state];
        for segment in first..last.saturating_sub(1) {
            let mut next = starts[segment - first].clone();
            self.rollout.replay(&mut next, self.segments[segment])?;
            starts.push(next);
        }
        Ok(starts)
    }

    /// Adds the loss's derivatives of the frames that end before segment `end`.
    fn add_losses(&self, end: usize, adjoint: &mut State<E::Number>) {
        for (frame_end, bars) in self.frame_ends.iter().zip(&self.position_bars) {
            let Some(bars) = bars.as_ref().filter(|_| *frame_end == end) else { continue };
            for (position, &bar) in adjoint.position.iter_mut().zip(bars) {
                *position = vector(double(*position) + bar);
            }
        }
    }
}

/// Refuses a loss gradient that cannot be one.
fn checked(bars: Option<Vec<DVec3>>, frame: usize, particles: usize) -> Result<Option<Vec<DVec3>>, SimulationError> {
    let error = |reason| Err(SimulationError::LossGradient { frame, reason });
    if let Some(bars) = &bars {
        if bars.len() != particles {
            return error(LossGradientError::Length { found: bars.len(), particles });
        }
        if let Some(particle) = bars.iter().position(|bar| !bar.is_finite()) {
            return error(LossGradientError::NotFinite { particle });
        }
    }
    Ok(bars)
}

/// From the adjoint of the initial state to the derivatives with respect to what a body starts with.
fn body_gradient<R: Scalar>(
    (body, mass_unit): (&PreparedBody, f64),
    bars: &BodyBars,
    adjoint: &State<R>,
) -> BodyGradient {
    let spin = body.angular_velocity;
    let (mut velocity, mut angular_velocity) = (DVec3::ZERO, DVec3::ZERO);
    let mut positions = Vec::with_capacity(body.positions.len());
    let mut velocities = Vec::with_capacity(body.positions.len());
    for (p, &x) in body.range.clone().zip(&body.positions) {
        let velocity_bar = double(adjoint.velocity[p]);
        let c = adjoint.affine[p].0.map(|x| x.lane(0));
        velocity += velocity_bar;
        // v = v0 + w x (x - centre), C = [w x].
        angular_velocity += (x - body.centre).cross(velocity_bar) + DVec3::new(c[7] - c[5], c[2] - c[6], c[3] - c[1]);
        positions.push(double(adjoint.position[p]) - spin.cross(velocity_bar));
        velocities.push(velocity_bar);
    }
    // The centre is the mean of the positions, weighted by the masses.
    let through_centre = spin.cross(velocity) / body.factors.iter().sum::<f64>();
    for (position, factor) in positions.iter_mut().zip(&body.factors) {
        *position += through_centre * *factor;
    }
    let density = body.mass / body.volume;
    BodyGradient {
        material: body.material.parameter_gradient(&Coefficients(bars.coefficients)),
        density: bars.mass * body.volume,
        particle_volume: (bars.volume + bars.mass * density) / mass_unit,
        velocity,
        angular_velocity,
        positions,
        velocities,
    }
}
