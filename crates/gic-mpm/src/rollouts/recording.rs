//! A rollout that can be differentiated: one forward pass that keeps checkpoints, and one reverse pass that goes from
//! checkpoint to checkpoint, last first.
//!
//! The cost is that of two forward passes and the adjoint, for any number of unknowns. Checkpoints lie every `stride`
//! segments; the stride grows as the memory budget fills. The reverse pass recomputes the states at the segments'
//! starts from a checkpoint, then each segment in full.

use gic_simd::Scalar;
use glam::DVec3;

use super::advance::Rollout;
use super::checkpoints::Checkpoints;
use super::frame::Frame;
use super::gradient::{FrameAdjoint, Gradient, body_gradient};
use super::timing::Timing;
use crate::colliders::grid_frame::GridFrame;
use crate::error::{LossGradientError, SimulationError};
use crate::options::Options;
use crate::substep::engine::{Bars, Engine, Segment};
use crate::substep::prepared_world::PreparedWorld;
use crate::substep::state::{State, double, vector};
use crate::substep::with_engine;
use crate::{Forecast, World};

/// A rollout with what its reverse pass needs; it can be reversed any number of times.
pub struct Recording(Box<dyn Reversible>);

impl Recording {
    /// Simulates `frames` frames, frame 0 included, and hands each to `on_frame`.
    ///
    /// # Errors
    /// As [`crate::rollout`], and [`SimulationError::MemoryBudget`] when not even the sparsest checkpoints fit.
    pub fn new(
        world: &World,
        options: &Options,
        frames: usize,
        on_frame: &mut dyn FnMut(Frame),
    ) -> Result<Self, SimulationError> {
        Forecast::of(world, frames)?.check(&options.budget)?;
        let prepared = PreparedWorld::new(world, options.rules)?.within(options.domain);
        let timing = Timing::of(world);
        Ok(Self(with_engine!(options, engine => {
            Box::new(Recorded::forward((engine, prepared, timing), options, frames, on_frame)?)
        })))
    }

    /// Derivatives of a loss with respect to what the bodies start with. `adjoints` holds the loss's derivatives with
    /// respect to frame 0, 1, ...; it does not depend on frames beyond its end.
    ///
    /// # Errors
    /// [`SimulationError::LossGradient`] where an adjoint has the wrong length, is not finite, or belongs to a frame
    /// that was not simulated; [`SimulationError::Interrupted`].
    pub fn gradient(&self, adjoints: &[FrameAdjoint]) -> Result<Gradient, SimulationError> {
        self.0.gradient(adjoints)
    }
}

/// Simulates `frames` frames (frame 0 included) and differentiates a loss.
///
/// `loss` is called once per frame in ascending order and returns the derivative of the loss with respect to that
/// frame; a loss on positions alone may return an `Option` of their derivative [per m], shape [n].
///
/// # Errors
/// As [`Recording::new`] and [`Recording::gradient`].
pub fn gradient<A: Into<FrameAdjoint>>(
    world: &World,
    options: &Options,
    frames: usize,
    mut loss: impl FnMut(&Frame) -> A,
) -> Result<Gradient, SimulationError> {
    let mut adjoints = Vec::with_capacity(frames);
    let recording = Recording::new(world, options, frames, &mut |frame| adjoints.push(loss(&frame).into()))?;
    recording.gradient(&adjoints)
}

/// A recording whose engine is hidden.
trait Reversible: Send + Sync {
    fn gradient(&self, adjoints: &[FrameAdjoint]) -> Result<Gradient, SimulationError>;
}

struct Recorded<E: Engine> {
    engine: E,
    prepared: PreparedWorld,
    timing: Timing,
    options: Options,
    checkpoints: Checkpoints<E::Number>,
    segments: Vec<Segment>,
    /// For each frame, the index after its last segment; 0 for frame 0.
    frame_ends: Vec<usize>,
}

impl<E: Engine> Recorded<E> {
    fn forward(
        (engine, prepared, timing): (E, PreparedWorld, Timing),
        options: &Options,
        frames: usize,
        on_frame: &mut dyn FnMut(Frame),
    ) -> Result<Self, SimulationError> {
        let rollout = Rollout::new(&engine, &prepared, timing);
        let budget_bytes = options.gradient_memory_bytes;
        let mut state = prepared.initial_state::<E::Number>();
        let per_state = State::<E::Number>::bytes(state.len());
        let most = budget_bytes.saturating_sub(rollout.bytes_beside_checkpoints(&state)) / per_state;
        let mut checkpoints = Checkpoints::new(most);
        let (mut segments, mut frame_ends) = (Vec::new(), Vec::with_capacity(frames));
        for index in 0..frames {
            options.check_interrupt()?;
            let frame = if index == 0 {
                rollout.frame(0, &state, None)
            } else {
                let done = segments.len();
                let advanced =
                    rollout.advance_frame(&mut state, index, &mut |i, state| checkpoints.offer(done + i, state))?;
                segments.extend(&advanced.segments);
                // The grid may have grown since the checkpoints were planned.
                let needed_bytes = rollout.bytes_beside_checkpoints(&state) + checkpoints.held() * per_state;
                if needed_bytes > budget_bytes {
                    return Err(SimulationError::MemoryBudget { needed_bytes, budget_bytes });
                }
                rollout.frame(index, &state, Some(&advanced))
            };
            frame_ends.push(segments.len());
            on_frame(frame);
        }
        Ok(Self { engine, prepared, timing, options: options.clone(), checkpoints, segments, frame_ends })
    }

    /// Goes back from the last segment to the first, and adds to `bars`; returns the adjoint of the initial state.
    fn backward(&self, adjoints: &[FrameAdjoint], bars: &mut Bars) -> Result<State<E::Number>, SimulationError> {
        let rollout = Rollout::new(&self.engine, &self.prepared, self.timing);
        let mut adjoint = State::<E::Number>::zeros(self.prepared.particles());
        let stride = self.checkpoints.stride;
        for (index, checkpoint) in self.checkpoints.states.iter().enumerate().rev() {
            let first = index * stride;
            let last = (first + stride).min(self.segments.len());
            let later = self.later_starts(&rollout, checkpoint, first, last)?;
            for segment in (first..last).rev() {
                self.options.check_interrupt()?;
                self.add_losses(adjoints, segment + 1, &mut adjoint);
                let start = if segment == first { checkpoint } else { &later[segment - first - 1] };
                let tape = rollout.record(start, self.segments[segment])?;
                self.engine.reverse(&self.prepared, tape, &mut adjoint, bars);
            }
        }
        self.add_losses(adjoints, 0, &mut adjoint);
        Ok(adjoint)
    }

    /// The states at the starts of segments `first + 1 .. last`, from that at `first`.
    fn later_starts(
        &self,
        rollout: &Rollout<'_, E>,
        checkpoint: &State<E::Number>,
        first: usize,
        last: usize,
    ) -> Result<Vec<State<E::Number>>, SimulationError> {
        let mut starts: Vec<State<E::Number>> = Vec::with_capacity(last - first);
        for segment in first..last.saturating_sub(1) {
            let mut next = starts.last().unwrap_or(checkpoint).clone();
            rollout.replay(&mut next, self.segments[segment])?;
            starts.push(next);
        }
        Ok(starts)
    }

    /// Adds the loss's derivatives of the frames that end before segment `end`.
    fn add_losses(&self, adjoints: &[FrameAdjoint], end: usize, adjoint: &mut State<E::Number>) {
        for (_, bars) in self.frame_ends.iter().zip(adjoints).filter(|(frame_end, _)| **frame_end == end) {
            let frame = &self.prepared.frame;
            add(frame, &mut adjoint.position, bars.positions.as_deref());
            add(frame, &mut adjoint.velocity, bars.velocities.as_deref());
        }
    }
}

impl<E: Engine + Send> Reversible for Recorded<E>
where
    E::Number: Send + Sync,
{
    fn gradient(&self, adjoints: &[FrameAdjoint]) -> Result<Gradient, SimulationError> {
        let prepared = &self.prepared;
        check(adjoints, self.frame_ends.len(), prepared.particles())?;
        let mut bars = Bars::zeros(prepared);
        let adjoint = self.backward(adjoints, &mut bars)?;
        let pairs = prepared.bodies.iter().zip(&bars.bodies);
        let of_body = |(body, shared)| {
            body_gradient((body, prepared.mass_unit), (shared, &bars.factors), &adjoint).in_world(&prepared.frame)
        };
        Ok(Gradient { bodies: pairs.map(of_body).collect() })
    }
}

fn add<R: Scalar>(frame: &GridFrame, numbers: &mut [[R; 3]], bars: Option<&[DVec3]>) {
    for (number, &bar) in numbers.iter_mut().zip(bars.unwrap_or_default()) {
        *number = vector(double(*number) + frame.vector(bar));
    }
}

/// Refuses adjoints that cannot be such.
fn check(adjoints: &[FrameAdjoint], frames: usize, particles: usize) -> Result<(), SimulationError> {
    for (frame, adjoint) in adjoints.iter().enumerate() {
        for bars in [&adjoint.positions, &adjoint.velocities].into_iter().flatten() {
            let not_finite = || bars.iter().position(|bar| !bar.is_finite());
            let reason = if frame >= frames {
                LossGradientError::NoSuchFrame { frames }
            } else if bars.len() != particles {
                LossGradientError::Length { found: bars.len(), particles }
            } else if let Some(particle) = not_finite() {
                LossGradientError::NotFinite { particle }
            } else {
                continue;
            };
            return Err(SimulationError::LossGradient { frame, reason });
        }
    }
    Ok(())
}
