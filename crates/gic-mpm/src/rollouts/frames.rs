//! Frames from substeps: how many substeps a frame takes, what is done when they turn out too few, and what a frame reports.

use gic_simd::Scalar;
use glam::DVec3;

use crate::error::SimulationError;
use crate::laws::law::Law;
use crate::laws::with_law;
use crate::math::mat3::Mat3;
use crate::substep::engine::{Engine, Segment};
use crate::substep::grid_update::Impulse;
use crate::substep::prepared_world::{PreparedBody, PreparedWorld};
use crate::substep::state::{State, map_particles};
use crate::substep::violation::{Violation, ViolationKind};
use crate::{Material, Stepping, World};

/// Most substeps per frame that are tried.
pub(crate) const MAX_SUBSTEPS: usize = 200_000;
/// A frame is redone with at most this many times the planned substeps: if that does not help, the cause is another.
const MOST_REFINEMENT: usize = 64;
/// Substeps between two sorts of the particles, and the length of a piece that the reverse pass keeps in full.
const SEGMENT_SUBSTEPS: usize = 40;

/// Mean force [N] and torque [N m] on an obstacle over a frame, the torque about the obstacle's origin.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ContactForce {
    /// Mean force [N].
    pub force_n: DVec3,
    /// Mean torque [N m].
    pub torque_n_m: DVec3,
}

/// What is known at the end of a frame; particles in input order, one body after the other.
#[derive(Clone, Debug, PartialEq)]
pub struct Frame {
    /// Number of the frame; 0 is the initial state.
    pub index: usize,
    /// Positions [m], shape [n].
    pub positions: Vec<DVec3>,
    /// Velocities [m/s], shape [n].
    pub velocities: Vec<DVec3>,
    /// Von Mises (Cauchy) stress [Pa], shape [n].
    pub von_mises_pa: Vec<f32>,
    /// Volume ratio J, shape [n]: of the elastic deformation for plastic materials.
    pub jacobian: Vec<f32>,
    /// Mean force on each obstacle during the frame, shape [colliders]; zero for frame 0.
    pub contacts: Vec<ContactForce>,
    /// Substeps that the frame took; 0 for frame 0.
    pub substeps: usize,
}

/// A world on its way through an engine.
pub(crate) struct Rollout<'a, E: Engine> {
    pub(crate) engine: &'a E,
    pub(crate) world: &'a PreparedWorld,
    timing: Timing,
}

/// What of the world the frames need beside its bodies.
#[derive(Clone, Copy)]
pub(crate) struct Timing {
    frame_seconds: f64,
    stepping: Stepping,
}

impl Timing {
    pub(crate) fn of(world: &World) -> Self {
        Self { frame_seconds: 1.0 / world.frame_rate_hz, stepping: world.stepping }
    }
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

    /// Advances `state` from frame `frame - 1` to `frame`. `before_segment` sees the state before each segment; it starts over
    /// (with segment 0) when the frame is redone with more substeps.
    pub(crate) fn advance_frame(
        &self,
        state: &mut State<E::Number>,
        frame: usize,
        before_segment: &mut dyn FnMut(usize, &State<E::Number>),
    ) -> Result<Advanced, SimulationError> {
        let planned = self.substeps(state)?;
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
                    *state = trial;
                    return Ok(Advanced { segments, impulses });
                }
                Err(violation) => substeps = more_substeps(violation, frame, planned, substeps)?,
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

    /// Bytes that a reverse pass through a segment from `state` on needs: its tape, the current and the next state, the adjoint.
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

    /// Substeps of the next frame, from the stepping and from what stability asks for at least.
    fn substeps(&self, state: &State<E::Number>) -> Result<usize, SimulationError> {
        let (fixed, courant) = match self.timing.stepping {
            Stepping::Fixed { substeps_per_frame } => (substeps_per_frame, 1.0),
            Stepping::Bound { courant } => (1, courant),
        };
        let mut substeps = fixed;
        for (index, body) in self.world.bodies.iter().enumerate() {
            let speed = self.highest_speed(body, state);
            let wanted = self.timing.frame_seconds * self.highest_rate(body, speed) / courant;
            let possible = wanted <= MAX_SUBSTEPS as f64;
            if !possible {
                return Err(SimulationError::TooStiff {
                    body: index,
                    substeps: wanted,
                    wave_speed_m_s: body.wave_speed(),
                    speed_m_s: speed,
                    grid_spacing_m: self.world.spacing,
                    limit: MAX_SUBSTEPS,
                });
            }
            substeps = substeps.max(wanted.ceil() as usize);
        }
        Ok(substeps)
    }

    /// The highest speed [m/s] of a body's particles in the coming frame, to which gravity adds.
    fn highest_speed(&self, body: &PreparedBody, state: &State<E::Number>) -> f64 {
        let speed = body.range.clone().map(|p| state.velocity_of(p).length_squared()).fold(0.0, f64::max).sqrt();
        speed + self.world.gravity.length() * self.timing.frame_seconds
    }

    /// The rate [1/s] that bounds the substep: of waves and motion across a cell, and of viscous diffusion.
    fn highest_rate(&self, body: &PreparedBody, speed: f64) -> f64 {
        let diffusivity = body.material.viscous_diffusivity_m2_s(body.mass / body.volume);
        let dx = self.world.spacing;
        ((body.wave_speed() + speed) / dx).max(6.0 * diffusivity / (dx * dx))
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
        let parallel = self.engine.is_parallel();
        let (mut von_mises_pa, mut jacobian) = (Vec::with_capacity(state.len()), Vec::with_capacity(state.len()));
        for body in &self.world.bodies {
            let of = |p: usize| self.stress(body, &in_f64(&state.affine[p]), &in_f64(&state.deformation[p]));
            for (stress, j) in map_particles(parallel, body.range.clone(), of) {
                von_mises_pa.push(stress);
                jacobian.push(j);
            }
        }
        let contacts = match advanced {
            None => vec![ContactForce::default(); self.world.colliders.len()],
            Some(advanced) => advanced.impulses.iter().map(|i| self.mean_force(i)).collect(),
        };
        Frame {
            index,
            positions: map_particles(parallel, 0..state.len(), |p| state.position_of(p)),
            velocities: map_particles(parallel, 0..state.len(), |p| state.velocity_of(p)),
            von_mises_pa,
            jacobian,
            contacts,
            substeps: advanced.map_or(0, |a| a.segments.iter().map(|s| s.substeps).sum()),
        }
    }

    fn mean_force(&self, impulse: &Impulse) -> ContactForce {
        ContactForce {
            force_n: impulse.linear / self.timing.frame_seconds,
            torque_n_m: impulse.angular / self.timing.frame_seconds,
        }
    }

    /// Von Mises stress [Pa] and J of a particle.
    fn stress(&self, body: &PreparedBody, c: &Mat3<f64>, f: &Mat3<f64>) -> (f32, f32) {
        // The law of a substep so short that nothing moves: only the stress remains.
        let instant = 1e-12;
        let rules = self.world.rules;
        let tau = with_law!(body.material, L => L::<f64>::new(&body.coefficients, rules).update(instant, c, f).tau);
        let j = match body.material {
            Material::Newtonian { .. } => f.at(0, 0),
            _ => f.det(),
        };
        let deviator = tau.add_diagonal(-tau.trace() / 3.0);
        let von_mises = (1.5 * deviator.double_dot(&deviator)).sqrt() / j;
        (von_mises as f32, j as f32)
    }
}

impl PreparedBody {
    fn wave_speed(&self) -> f64 {
        self.material.wave_speed_m_s(self.mass / self.volume)
    }
}

/// The substeps of the next attempt at a frame, or the error if there is none.
fn more_substeps(
    violation: Violation,
    frame: usize,
    planned: usize,
    substeps: usize,
) -> Result<usize, SimulationError> {
    let Violation { kind, particle, position, velocity } = violation;
    match kind {
        ViolationKind::LeftDomain(reason) => {
            Err(SimulationError::LeftDomain { frame, particle, position, velocity, reason })
        }
        ViolationKind::TooFast if substeps >= planned * MOST_REFINEMENT || substeps * 2 > MAX_SUBSTEPS => {
            Err(SimulationError::Unstable { frame, substeps, particle, velocity })
        }
        ViolationKind::TooFast => Ok(substeps * 2),
    }
}

fn in_f64<R: Scalar>(m: &Mat3<R>) -> Mat3<f64> {
    Mat3(m.0.map(|x| x.lane(0)))
}
