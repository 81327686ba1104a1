//! The public simulator: frame after frame, with states that can be saved and restored.

use super::advance::{Advanced, Rollout};
use super::frame::{Deformation, Frame, deformation};
use super::snapshot::Snapshot;
use super::timing::Timing;
use crate::error::{SimulationError, StateMismatch};
use crate::options::{Options, Precision};
use crate::substep::engine::Engine;
use crate::substep::prepared_world::PreparedWorld;
use crate::substep::state::State;
use crate::substep::with_engine;
use crate::{Forecast, World};

/// A simulation in progress.
pub struct Simulator(Box<dyn Drive>);

impl Simulator {
    /// Sets up a world at frame 0.
    ///
    /// # Errors
    /// Where [`World::validate`] finds something wrong, and [`SimulationError::OverBudget`].
    pub fn new(world: &World, options: &Options) -> Result<Self, SimulationError> {
        Self::for_frames(world, options, 2)
    }

    /// Sets up a world of which `frames` frames, frame 0 included, are within the budget.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn for_frames(world: &World, options: &Options, frames: usize) -> Result<Self, SimulationError> {
        Forecast::of(world, frames)?.check(&options.budget)?;
        let prepared = PreparedWorld::new(world, options.rules)?.within(options.domain);
        Ok(Self(with_engine!(options, engine => Box::new(Running::new(engine, prepared, world, options.precision)))))
    }

    /// The current frame. Contact forces are those of the last [`Self::advance_frame`], zero right after a start or a
    /// restore.
    pub fn frame(&self) -> Frame {
        self.0.frame()
    }

    /// How the particles are deformed and loaded in the current frame.
    pub fn deformation(&self) -> Deformation {
        self.0.deformation()
    }

    /// Computes the next frame. After an error the state is that before the call.
    ///
    /// # Errors
    /// [`SimulationError::Unstable`], [`SimulationError::TooStiff`], [`SimulationError::ColliderTooFast`],
    /// [`SimulationError::LeftDomain`], [`SimulationError::MomentumLost`],
    /// [`SimulationError::Rounded`] or [`SimulationError::ThroughCollider`].
    pub fn advance_frame(&mut self) -> Result<Frame, SimulationError> {
        self.0.advance_frame()
    }

    /// The complete state: a simulator of the same world and options that restores it continues with the same bits.
    pub fn snapshot(&self) -> Snapshot {
        self.0.snapshot()
    }

    /// Continues from a saved state.
    ///
    /// # Errors
    /// [`SimulationError::StateMismatch`] when it has another number of particles, another precision, or numbers that
    /// are not finite.
    pub fn restore(&mut self, snapshot: &Snapshot) -> Result<(), SimulationError> {
        self.0.restore(snapshot)
    }
}

/// Simulates `frames` frames, frame 0 included, and hands each to `on_frame`.
///
/// # Errors
/// As [`Simulator::new`] and [`Simulator::advance_frame`], and [`SimulationError::Interrupted`].
pub fn rollout(
    world: &World,
    options: &Options,
    frames: usize,
    mut on_frame: impl FnMut(Frame),
) -> Result<(), SimulationError> {
    let mut simulator = Simulator::for_frames(world, options, frames)?;
    if frames > 0 {
        on_frame(simulator.frame());
    }
    for _ in 1..frames {
        options.check_interrupt()?;
        on_frame(simulator.advance_frame()?);
    }
    Ok(())
}

/// A simulator whose engine is hidden.
trait Drive: Send {
    fn frame(&self) -> Frame;
    fn deformation(&self) -> Deformation;
    fn advance_frame(&mut self) -> Result<Frame, SimulationError>;
    fn snapshot(&self) -> Snapshot;
    fn restore(&mut self, snapshot: &Snapshot) -> Result<(), SimulationError>;
}

struct Running<E: Engine> {
    engine: E,
    prepared: PreparedWorld,
    timing: Timing,
    precision: Precision,
    state: State<E::Number>,
    index: usize,
    last: Option<Advanced>,
}

impl<E: Engine> Running<E> {
    fn new(engine: E, prepared: PreparedWorld, world: &World, precision: Precision) -> Self {
        let state = prepared.initial_state();
        Self { engine, prepared, timing: Timing::of(world), precision, state, index: 0, last: None }
    }

    fn rollout(&self) -> Rollout<'_, E> {
        Rollout::new(&self.engine, &self.prepared, self.timing)
    }
}

impl<E: Engine + Send> Drive for Running<E> {
    fn frame(&self) -> Frame {
        self.rollout().frame(self.index, &self.state, self.last.as_ref())
    }

    fn deformation(&self) -> Deformation {
        deformation(&self.prepared, &self.state)
    }

    fn advance_frame(&mut self) -> Result<Frame, SimulationError> {
        let rollout = Rollout::new(&self.engine, &self.prepared, self.timing);
        // In case of an error the state remains that of the last frame.
        let advanced = rollout.advance_frame(&mut self.state, self.index + 1, &mut |_, _| {})?;
        self.index += 1;
        self.last = Some(advanced);
        Ok(self.frame())
    }

    fn snapshot(&self) -> Snapshot {
        let particles = (0..self.state.len()).map(|p| self.state.to_numbers(p)).collect();
        Snapshot { frame: self.index, precision: self.precision, particles }
    }

    fn restore(&mut self, snapshot: &Snapshot) -> Result<(), SimulationError> {
        let mismatch = |reason| Err(SimulationError::StateMismatch { reason });
        let (found, expected) = (snapshot.particles.len(), self.state.len());
        if found != expected {
            return mismatch(StateMismatch::Particles { found, expected });
        }
        if snapshot.precision != self.precision {
            let (found, expected) = (snapshot.precision, self.precision);
            return mismatch(StateMismatch::Precision { found, expected });
        }
        if let Some(particle) = snapshot.particles.iter().position(|p| !p.iter().all(|x| x.is_finite())) {
            return mismatch(StateMismatch::NotFinite { particle });
        }
        for (p, numbers) in snapshot.particles.iter().enumerate() {
            self.state.set_numbers(p, numbers);
        }
        self.index = snapshot.frame;
        self.last = None;
        Ok(())
    }
}
