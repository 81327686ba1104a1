//! A world made ready for the engines: numbered particles, coefficients, masses; and what engines have in common.

use core::ops::Range;

use gic_simd::Scalar;
use glam::DVec3;

use crate::error::SimulationError;
use crate::laws::law::{Coefficients, MAX_COEFFICIENTS, Rules};
use crate::substep::grid_update::{GridBox, GridUpdate, Impulse};
use crate::substep::state::State;
use crate::{Body, Collider, Material, World};

/// Most nodes of the grid, so that f32 holds their indices exactly; beyond, the particles are too far apart for a dense grid.
const MAX_NODES: usize = 1 << 24;
/// Farthest from the origin, in cells: beyond, f32 no longer resolves a position within its cell well.
const MAX_CELLS_FROM_ORIGIN: f64 = (1 << 16) as f64;

/// One body, ready to simulate.
pub(crate) struct PreparedBody {
    /// Its particles among all.
    pub(crate) range: Range<usize>,
    pub(crate) material: Material,
    pub(crate) coefficients: Coefficients,
    /// Mass of a particle [kg].
    pub(crate) mass: f64,
    /// Rest volume of a particle [m^3].
    pub(crate) volume: f64,
    /// Factors on both, one per particle.
    pub(crate) factors: Vec<f64>,
    pub(crate) positions: Vec<DVec3>,
    pub(crate) velocity: DVec3,
    pub(crate) angular_velocity: DVec3,
    /// Centre of mass at the start [m].
    pub(crate) centre: DVec3,
}

/// A world, ready to simulate.
pub(crate) struct PreparedWorld {
    pub(crate) bodies: Vec<PreparedBody>,
    pub(crate) colliders: Vec<Collider>,
    pub(crate) gravity: DVec3,
    /// Grid spacing [m].
    pub(crate) spacing: f64,
    pub(crate) rules: Rules,
}

impl PreparedWorld {
    /// Checks a world and makes it ready.
    pub(crate) fn new(world: &World, rules: Rules) -> Result<Self, SimulationError> {
        world.validate()?;
        let mut bodies = Vec::with_capacity(world.bodies.len());
        let mut start = 0;
        for body in &world.bodies {
            let range = start..start + body.positions.len();
            start = range.end;
            bodies.push(PreparedBody::new(body, range));
        }
        Ok(Self {
            bodies,
            colliders: world.colliders.clone(),
            gravity: world.gravity_m_s2,
            spacing: world.grid_spacing_m,
            rules,
        })
    }

    /// Number of particles.
    pub(crate) fn particles(&self) -> usize {
        self.bodies.last().map_or(0, |body| body.range.end)
    }

    /// The grid update of a substep.
    pub(crate) fn grid_update(&self, extent: GridBox, time: f64, dt: f64) -> GridUpdate<'_> {
        GridUpdate {
            extent,
            spacing: self.spacing,
            dt,
            gravity: self.gravity,
            colliders: self.colliders.iter().map(|collider| collider.posed(time)).collect(),
        }
    }

    /// The lowest and highest coordinates, in cells, that a particle reaches within `horizon` seconds at its present velocity, and
    /// `pad` cells more.
    pub(crate) fn reach<R: Scalar>(&self, state: &State<R>, particle: usize, horizon: f64, pad: f64) -> (DVec3, DVec3) {
        let inverse = 1.0 / self.spacing;
        let here = state.position_of(particle) * inverse;
        let there = here + state.velocity_of(particle) * (horizon * inverse);
        (here.min(there) - pad, here.max(there) + pad)
    }

    /// The smallest grid that holds all particles as far as they [`Self::reach`].
    pub(crate) fn extent<R: Scalar>(&self, state: &State<R>, horizon: f64, pad: f64) -> Result<GridBox, Violation> {
        let (mut lowest, mut highest) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for p in 0..state.len() {
            let (low, high) = self.reach(state, p, horizon, pad);
            let near =
                low.abs().max_element() < MAX_CELLS_FROM_ORIGIN && high.abs().max_element() < MAX_CELLS_FROM_ORIGIN;
            if !near {
                return Err(Violation::left_domain(state, p, "too far from the origin, or not a number"));
            }
            lowest = lowest.min(low);
            highest = highest.max(high);
        }
        let size = highest - lowest + 5.0;
        if size.element_product() > MAX_NODES as f64 {
            return Err(Violation::left_domain(state, farthest(state), "too far from the other particles"));
        }
        let base = |x: DVec3| (x - 0.5).floor().as_ivec3();
        Ok(GridBox::around(base(lowest), base(highest)))
    }
}

impl PreparedBody {
    fn new(body: &Body, range: Range<usize>) -> Self {
        let count = body.positions.len();
        let factors = if body.volume_factors.is_empty() { vec![1.0; count] } else { body.volume_factors.clone() };
        let moment = body.positions.iter().zip(&factors).map(|(x, w)| *x * *w).sum::<DVec3>();
        Self {
            range,
            material: body.material,
            coefficients: body.material.coefficients(),
            mass: body.density_kg_m3 * body.particle_volume_m3,
            volume: body.particle_volume_m3,
            positions: body.positions.clone(),
            velocity: body.velocity_m_s,
            angular_velocity: body.angular_velocity_rad_s,
            centre: moment / factors.iter().sum::<f64>(),
            factors,
        }
    }
}

/// The particle farthest from the mean position.
fn farthest<R: Scalar>(state: &State<R>) -> usize {
    let mean = (0..state.len()).map(|p| state.position_of(p)).sum::<DVec3>() / state.len() as f64;
    let distance = |p: &usize| state.position_of(*p).distance_squared(mean);
    (0..state.len()).max_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
}

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

/// Why a segment cannot be completed.
#[derive(Clone, Debug)]
pub(crate) struct Violation {
    pub(crate) kind: ViolationKind,
    pub(crate) particle: usize,
    pub(crate) position: DVec3,
    pub(crate) velocity: DVec3,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ViolationKind {
    /// |v| dt > dx or NaN: shorter substeps may help.
    TooFast,
    /// Outside of what a grid can hold: nothing helps.
    LeftDomain(&'static str),
}

impl Violation {
    pub(crate) fn too_fast<R: Scalar>(state: &State<R>, particle: usize) -> Self {
        Self::new(ViolationKind::TooFast, state, particle)
    }

    fn left_domain<R: Scalar>(state: &State<R>, particle: usize, reason: &'static str) -> Self {
        Self::new(ViolationKind::LeftDomain(reason), state, particle)
    }

    fn new<R: Scalar>(kind: ViolationKind, state: &State<R>, particle: usize) -> Self {
        Self { kind, particle, position: state.position_of(particle), velocity: state.velocity_of(particle) }
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

    /// Turns the adjoint of a segment's end into that of its start, and adds to `bars`, one per body.
    fn reverse(
        &self,
        world: &PreparedWorld,
        tape: Self::Tape,
        adjoint: &mut State<Self::Number>,
        bars: &mut [BodyBars],
    );

    /// Whether it may use several threads.
    fn is_parallel(&self) -> bool;

    /// Bytes of a tape on a grid of `nodes` nodes.
    fn tape_bytes(&self, particles: usize, nodes: usize, substeps: usize) -> usize;
}

/// Runs an expression with `$law` naming the generic law type of a material.
macro_rules! with_law {
    ($material:expr, $law:ident => $body:expr) => {
        match $material {
            crate::Material::Elastic { .. } => {
                type $law<R> = crate::laws::elastic::Elastic<R>;
                $body
            }
            crate::Material::Plasticine { .. } => {
                type $law<R> = crate::laws::plasticine::Plasticine<R>;
                $body
            }
            crate::Material::Sand { .. } => {
                type $law<R> = crate::laws::sand::Sand<R>;
                $body
            }
            crate::Material::Newtonian { .. } => {
                type $law<R> = crate::laws::newtonian::Newtonian<R>;
                $body
            }
            crate::Material::NonNewtonian { .. } => {
                type $law<R> = crate::laws::non_newtonian::NonNewtonian<R>;
                $body
            }
        }
    };
}
pub(crate) use with_law;
