//! What both engines can do: run segments of substeps, record them, and reverse them.

use gic_simd::Scalar;

use super::grid_update::Impulse;
use super::prepared_world::PreparedWorld;
use super::state::State;
use super::violation::Violation;
use crate::laws::law::MAX_COEFFICIENTS;

/// A run of substeps of equal length.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Segment {
    /// Time at its start [s].
    pub(crate) start: f64,
    /// Length of a substep [s].
    pub(crate) dt: f64,
    /// How many.
    pub(crate) substeps: usize,
}

impl Segment {
    /// Time at the start of a substep [s].
    pub(crate) fn time(&self, substep: usize) -> f64 {
        self.start + self.dt * substep as f64
    }
}

/// Derivatives of the loss with respect to what all particles of a body share.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct BodyBars {
    pub(crate) coefficients: [f64; MAX_COEFFICIENTS],
    /// With respect to the mass of a particle of factor 1.
    pub(crate) mass: f64,
    /// With respect to the rest volume of a particle of factor 1, at constant mass.
    pub(crate) volume: f64,
}

impl core::ops::AddAssign for BodyBars {
    fn add_assign(&mut self, other: Self) {
        for i in 0..MAX_COEFFICIENTS {
            self.coefficients[i] += other.coefficients[i];
        }
        self.mass += other.mass;
        self.volume += other.volume;
    }
}

/// Derivatives of the loss with respect to what does not change from substep to substep.
#[derive(Clone, Debug)]
pub(crate) struct Bars {
    /// One per body.
    pub(crate) bodies: Vec<BodyBars>,
    /// With respect to each particle's factor on mass and volume, shape [n].
    pub(crate) factors: Vec<f64>,
}

impl Bars {
    /// All zeros.
    pub(crate) fn zeros(world: &PreparedWorld) -> Self {
        Self { bodies: vec![BodyBars::default(); world.bodies.len()], factors: vec![0.0; world.particles()] }
    }
}

/// Something that computes substeps and their adjoint.
pub(crate) trait Engine: Sync {
    /// The number that states are kept in.
    type Number: Scalar;
    /// What the reverse pass needs to know about a segment.
    type Tape;

    /// Advances a state by a segment; what obstacles took is added to `impulses`.
    fn advance(
        &self,
        world: &PreparedWorld,
        state: &mut State<Self::Number>,
        segment: Segment,
        impulses: &mut [Impulse],
    ) -> Result<(), Violation>;

    /// Runs a segment from a state and keeps what the reverse pass needs.
    fn record(
        &self,
        world: &PreparedWorld,
        state: &State<Self::Number>,
        segment: Segment,
    ) -> Result<Self::Tape, Violation>;

    /// Turns the adjoint of a segment's end into that of its start, and adds to `bars`.
    fn reverse(&self, world: &PreparedWorld, tape: Self::Tape, adjoint: &mut State<Self::Number>, bars: &mut Bars);

    /// Whether it may use several threads.
    fn is_parallel(&self) -> bool;

    /// Bytes of a tape on a grid of `nodes` nodes.
    fn tape_bytes(&self, particles: usize, nodes: usize, substeps: usize) -> usize;
}
