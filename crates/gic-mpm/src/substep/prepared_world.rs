//! A world made ready for the engines: numbered particles, coefficients, masses.
//!
//! Masses, momenta and volumes are kept in a unit of mass in which the heaviest particle weighs about 1, so that f32
//! holds them however fine the matter is. The unit is a power of two: it changes no bit of what is computed.

use core::ops::Range;

use gic_simd::Scalar;
use glam::DVec3;

use super::grid::GridBox;
use super::grid_update::GridUpdate;
use super::state::{State, vector};
use super::violation::Violation;
use crate::colliders::collider::PosedCollider;
use crate::colliders::grid_frame::GridFrame;
use crate::colliders::shape::surface_tolerance;
use crate::error::SimulationError;
use crate::laws::law::{Coefficients, Rules};
use crate::math::mat3::Mat3;
use crate::world::MassRange;
use crate::{Ball, Body, Collider, Material, World};

/// Most nodes of the grid; beyond, the particles are too far apart for a dense one. Derived: f32 holds their indices
/// exactly.
pub(crate) const MAX_GRID_NODES: usize = 1 << 24;
/// Mass per cell [kg/m^3] below which a node stays at rest. Paper: the published simulator's gate of 1e-8 dx^3.
const MIN_NODE_DENSITY: f64 = 1e-8;
/// Most of a particle's mass that a node may hold and stay at rest. Derived: the resolution of f32, to which a
/// particle's weights sum to 1.
const MIN_NODE_SHARE: f64 = f32::EPSILON as f64;
/// Farthest that a particle may be from the origin, in cells. Derived: there f32 resolves a 128th of a cell.
const MAX_CELLS_FROM_ORIGIN: f64 = (1 << 16) as f64;

/// One body, ready to simulate.
pub(crate) struct PreparedBody {
    /// Its particles among all.
    pub(crate) range: Range<usize>,
    pub(crate) material: Material,
    pub(crate) coefficients: Coefficients,
    /// Mass of a particle [mass units].
    pub(crate) mass: f64,
    /// Rest volume of a particle [m^3 mass units / kg].
    pub(crate) volume: f64,
    /// Factors on both, one per particle.
    pub(crate) factors: Vec<f64>,
    pub(crate) positions: Vec<DVec3>,
    pub(crate) velocity: DVec3,
    pub(crate) angular_velocity: DVec3,
    /// Each particle's own part of its velocity [m/s]; empty where that is nothing.
    pub(crate) own_velocities: Vec<DVec3>,
    /// Centre of mass at the start [m], from the grid's origin as all positions.
    pub(crate) centre: DVec3,
}

/// A world, ready to simulate.
pub(crate) struct PreparedWorld {
    pub(crate) bodies: Vec<PreparedBody>,
    pub(crate) colliders: Vec<Collider>,
    pub(crate) gravity: DVec3,
    /// Grid spacing [m].
    pub(crate) spacing: f64,
    /// The frame in which everything in here is measured.
    pub(crate) frame: GridFrame,
    /// The unit of mass [kg].
    pub(crate) mass_unit: f64,
    /// Nodes with less mass than this [mass units] stay at rest.
    pub(crate) mass_gate: f64,
    pub(crate) rules: Rules,
    /// Where particles stay: a centre from the grid's origin, and a radius [m].
    domain: Option<(DVec3, f64)>,
}

impl PreparedWorld {
    /// Checks a world and makes it ready.
    pub(crate) fn new(world: &World, rules: Rules) -> Result<Self, SimulationError> {
        world.validate()?;
        let MassRange { lightest_kg, heaviest_kg } = MassRange::of(world);
        let mass_unit = power_of_two_near(heaviest_kg);
        let frame = GridFrame::new(&world.colliders, world.gravity_m_s2, world.grid_spacing_m);
        let mut bodies = Vec::with_capacity(world.bodies.len());
        let mut start = 0;
        for body in &world.bodies {
            let range = start..start + body.positions.len();
            start = range.end;
            bodies.push(PreparedBody::new(body, range, mass_unit, &frame));
        }
        Ok(Self {
            bodies,
            colliders: world.colliders.iter().map(|collider| frame.collider(collider)).collect(),
            gravity: frame.vector(world.gravity_m_s2),
            spacing: world.grid_spacing_m,
            frame,
            mass_unit,
            mass_gate: mass_gate_kg(lightest_kg, world.grid_spacing_m) / mass_unit,
            rules,
            domain: None,
        })
    }

    /// The same where all particles stay in a ball.
    pub(crate) fn within(self, domain: Option<Ball>) -> Self {
        Self { domain: domain.map(|ball| (self.frame.point(ball.centre_m), ball.radius_m)), ..self }
    }

    /// Number of particles.
    pub(crate) fn particles(&self) -> usize {
        self.bodies.last().map_or(0, |body| body.range.end)
    }

    /// The start of a rollout: undeformed, each body moving rigidly but for its particles' own velocities.
    pub(crate) fn initial_state<R: Scalar>(&self) -> State<R> {
        let mut state = State::zeros(self.particles());
        for body in &self.bodies {
            for (p, &x) in body.range.clone().zip(&body.positions) {
                state.position[p] = vector(x);
                let own = body.own_velocities.get(p - body.range.start).copied().unwrap_or_default();
                state.velocity[p] = vector(body.velocity + body.angular_velocity.cross(x - body.centre) + own);
                state.affine[p] = Mat3(skew(body.angular_velocity).map(R::splat));
                state.deformation[p] = Mat3::identity();
            }
        }
        state
    }

    /// The obstacles at a time [s].
    pub(crate) fn posed_colliders(&self, time: f64) -> Vec<PosedCollider<'_>> {
        let tolerance = surface_tolerance(self.spacing);
        self.colliders.iter().map(|collider| collider.posed(time, tolerance)).collect()
    }

    /// The grid update of a substep.
    pub(crate) fn grid_update(&self, extent: GridBox, time: f64, dt: f64) -> GridUpdate<'_> {
        GridUpdate {
            extent,
            spacing: self.spacing,
            dt,
            gravity: self.gravity,
            mass_unit: self.mass_unit,
            mass_gate: self.mass_gate,
            colliders: self.posed_colliders(time),
        }
    }

    /// The lowest and highest coordinates, in cells, that a particle reaches within `horizon` seconds at its present
    /// velocity, and `margin` cells more.
    pub(crate) fn swept_cells<R: Scalar>(
        &self,
        state: &State<R>,
        particle: usize,
        horizon: f64,
        margin: f64,
    ) -> (DVec3, DVec3) {
        let inverse = 1.0 / self.spacing;
        let here = state.position_of(particle) * inverse;
        let there = here + state.velocity_of(particle) * (horizon * inverse);
        (here.min(there) - margin, here.max(there) + margin)
    }

    /// Whether a particle leaves the domain within `horizon` seconds at its present velocity.
    fn leaves_domain<R: Scalar>(&self, state: &State<R>, particle: usize, horizon: f64) -> bool {
        let there = state.position_of(particle) + state.velocity_of(particle) * horizon;
        self.domain.is_some_and(|(centre, radius)| there.distance_squared(centre) > radius * radius)
    }

    /// The smallest grid that holds all particles, each with the cells that it sweeps ([`Self::swept_cells`]).
    pub(crate) fn extent<R: Scalar>(&self, state: &State<R>, horizon: f64, margin: f64) -> Result<GridBox, Violation> {
        let (mut lowest, mut highest) = (DVec3::INFINITY, DVec3::NEG_INFINITY);
        for p in 0..state.len() {
            let (low, high) = self.swept_cells(state, p, horizon, margin);
            let near =
                low.abs().max_element() < MAX_CELLS_FROM_ORIGIN && high.abs().max_element() < MAX_CELLS_FROM_ORIGIN;
            if !near {
                return Err(Violation::left_domain(state, p, "too far from the origin, or not a number"));
            }
            if self.leaves_domain(state, p, horizon) {
                return Err(Violation::left_domain(state, p, "outside of where the body may be"));
            }
            lowest = lowest.min(low);
            highest = highest.max(high);
        }
        let size = highest - lowest + 5.0;
        if size.element_product() > MAX_GRID_NODES as f64 {
            return Err(Violation::left_domain(state, farthest(state), "too far from the other particles"));
        }
        let base = |x: DVec3| (x - 0.5).floor().as_ivec3();
        Ok(GridBox::around(base(lowest), base(highest)))
    }
}

impl PreparedBody {
    fn new(body: &Body, range: Range<usize>, mass_unit: f64, frame: &GridFrame) -> Self {
        let count = body.positions.len();
        let factors = if body.volume_factors.is_empty() { vec![1.0; count] } else { body.volume_factors.clone() };
        let positions: Vec<DVec3> = body.positions.iter().map(|x| frame.point(*x)).collect();
        let moment = positions.iter().zip(&factors).map(|(x, w)| *x * *w).sum::<DVec3>();
        Self {
            range,
            material: body.material,
            coefficients: body.material.coefficients(),
            mass: body.density_kg_m3 * body.particle_volume_m3 / mass_unit,
            volume: body.particle_volume_m3 / mass_unit,
            positions,
            velocity: frame.vector(body.velocity_m_s),
            angular_velocity: frame.vector(body.angular_velocity_rad_s),
            own_velocities: body.own_velocities_m_s.iter().map(|v| frame.vector(*v)).collect(),
            centre: moment / factors.iter().sum::<f64>(),
            factors,
        }
    }
}

/// The power of two next to a positive number.
fn power_of_two_near(number: f64) -> f64 {
    2f64.powi(number.log2().round() as i32)
}

/// Mass [kg] below which a node stays at rest, so that none is divided by nothing. What falls below it is lost to
/// rounding, however light the particles are.
fn mass_gate_kg(lightest_particle_kg: f64, spacing_m: f64) -> f64 {
    (MIN_NODE_DENSITY * spacing_m.powi(3)).min(MIN_NODE_SHARE * lightest_particle_kg)
}

/// The matrix of `w x`.
fn skew(w: DVec3) -> [f64; 9] {
    [0.0, -w.z, w.y, w.z, 0.0, -w.x, -w.y, w.x, 0.0]
}

/// The particle farthest from the mean position.
fn farthest<R: Scalar>(state: &State<R>) -> usize {
    let mean = (0..state.len()).map(|p| state.position_of(p)).sum::<DVec3>() / state.len() as f64;
    let distance = |p: &usize| state.position_of(*p).distance_squared(mean);
    (0..state.len()).max_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap_or(0)
}
