//! Frames from substeps: a frame is cut into segments, and redone with more substeps where they turn out too few.

use super::frame::{Frame, report};
use super::invariants::{self, Momentum};
use super::timestep_bound::{more_substeps, substeps_of_frame};
use super::timing::Timing;
use crate::error::SimulationError;
use crate::substep::engine::{Engine, Segment};
use crate::substep::grid_update::Impulse;
use crate::substep::prepared_world::PreparedWorld;
use crate::substep::state::State;
use crate::substep::violation::Violation;

/// Substeps between two sorts of the particles, and the length of a piece that the reverse pass keeps in full.
const SEGMENT_SUBSTEPS: usize = 40;

/// A world on its way through an engine.
pub(crate) struct Rollout<'a, E: Engine> {
    pub(crate) engine: &'a E,
    pub(crate) world: &'a PreparedWorld,
    timing: Timing,
}

/// A frame that went well.
pub(crate) struct Advanced {
    pub(crate) segments: Vec<Segment>,
    pub(crate) impulses: Vec<Impulse>,
}

impl<'a, E: Engine> Rollout<'a, E> {
    pub(crate) fn new(engine: &'a E, world: &'a PreparedWorld, timing: Timing) -> Self {
        Self { engine, world, timing }
    }

    /// Advances `state` from frame `frame - 1` to `frame`. `before_segment` sees the state before each segment; it
    /// starts over (with segment 0) when the frame is redone with more substeps.
    pub(crate) fn advance_frame(
        &self,
        state: &mut State<E::Number>,
        frame: usize,
        before_segment: &mut dyn FnMut(usize, &State<E::Number>),
    ) -> Result<Advanced, SimulationError> {
        let planned = substeps_of_frame(self.world, self.timing, frame, state)?;
        let before = Momentum::of(self.world, state);
        let mut substeps = planned;
        loop {
            let segments = self.segments(frame, substeps);
            let mut impulses = vec![Impulse::default(); self.world.colliders.len()];
            let mut trial = state.clone();
            let outcome = segments.iter().enumerate().try_for_each(|(index, segment)| {
                before_segment(index, &trial);
                self.engine.advance(self.world, &mut trial, *segment, &mut impulses)
            });
            match outcome {
                Ok(()) => {
                    invariants::check(self.world, self.timing, frame, (before, &impulses, substeps), &trial)?;
                    *state = trial;
                    return Ok(Advanced { segments, impulses });
                }
                Err(violation) => {
                    let position = self.world.frame.point_in_world(violation.position);
                    substeps = more_substeps(Violation { position, ..violation }, frame, planned, substeps)?;
                }
            }
        }
    }

    /// Repeats a segment that has gone well before.
    pub(crate) fn replay(&self, state: &mut State<E::Number>, segment: Segment) -> Result<(), SimulationError> {
        let mut ignored = vec![Impulse::default(); self.world.colliders.len()];
        self.engine.advance(self.world, state, segment, &mut ignored).map_err(|v| self.unexpected(v, segment))
    }

    /// Repeats a segment that has gone well before, keeping what the reverse pass needs.
    pub(crate) fn record(&self, state: &State<E::Number>, segment: Segment) -> Result<E::Tape, SimulationError> {
        self.engine.record(self.world, state, segment).map_err(|v| self.unexpected(v, segment))
    }

    /// Bytes that a reverse pass through a segment from `state` on needs: its tape, the current and the next state, the
    /// adjoint.
    pub(crate) fn bytes_beside_checkpoints(&self, state: &State<E::Number>) -> usize {
        // A particle may move a cell within the segment.
        let nodes = self.world.extent(state, 0.0, 1.0).map_or(0, |extent| extent.nodes());
        self.engine.tape_bytes(state.len(), nodes, SEGMENT_SUBSTEPS) + 3 * State::<E::Number>::bytes(state.len())
    }

    fn unexpected(&self, violation: Violation, segment: Segment) -> SimulationError {
        SimulationError::Unstable {
            frame: (segment.start / self.timing.frame_seconds) as usize + 1,
            substeps: (self.timing.frame_seconds / segment.dt).round() as usize,
            particle: violation.particle,
            velocity: violation.velocity,
        }
    }

    /// Cuts a frame into segments of nearly equal length.
    fn segments(&self, frame: usize, substeps: usize) -> Vec<Segment> {
        let start = self.timing.frame_seconds * (frame - 1) as f64;
        let dt = self.timing.frame_seconds / substeps as f64;
        let count = substeps.div_ceil(SEGMENT_SUBSTEPS);
        (0..count)
            .map(|i| {
                let (first, last) = (substeps * i / count, substeps * (i + 1) / count);
                Segment { start: start + dt * first as f64, dt, substeps: last - first }
            })
            .collect()
    }

    /// What is reported at the end of a frame.
    pub(crate) fn frame(&self, index: usize, state: &State<E::Number>, advanced: Option<&Advanced>) -> Frame {
        let advanced = advanced.map(|a| (&a.impulses[..], a.segments.iter().map(|s| s.substeps).sum()));
        report(self.world, self.engine.is_parallel(), self.timing.frame_seconds, index, state, advanced)
    }
}
