//! What is simulated: bodies, obstacles, gravity, resolution.

use glam::DVec3;

use crate::{Collider, Material};

/// A set of particles of one material.
#[derive(Clone, Debug)]
pub struct Body {
    /// Constitutive law.
    pub material: Material,
    /// Density at rest [kg/m^3].
    pub density_kg_m3: f64,
    /// Rest volume of one particle [m^3].
    pub particle_volume_m3: f64,
    /// Rest volume, and so mass, of each particle in units of `particle_volume_m3`, positive, shape [n]; empty where
    /// all are 1.
    pub volume_factors: Vec<f64>,
    /// Initial positions [m], shape [n].
    pub positions: Vec<DVec3>,
    /// Initial linear velocity [m/s].
    pub velocity_m_s: DVec3,
    /// Initial angular velocity [rad/s] about the centre of mass.
    pub angular_velocity_rad_s: DVec3,
    /// What each particle's initial velocity has beyond the body's motion [m/s], shape [n]; empty for nothing.
    pub own_velocities_m_s: Vec<DVec3>,
}

impl Body {
    /// Largest side of the box around its matter [m].
    pub(crate) fn largest_side_m(&self) -> f64 {
        let low = self.positions.iter().fold(DVec3::INFINITY, |low, p| low.min(*p));
        let high = self.positions.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p));
        (high - low).max_element() + self.particle_volume_m3.cbrt()
    }

    /// Mass of each particle [kg], shape [n].
    pub fn masses_kg(&self) -> Vec<f64> {
        let of = |p: usize| self.volume_factors.get(p).copied().unwrap_or(1.0);
        let one = self.density_kg_m3 * self.particle_volume_m3;
        (0..self.positions.len()).map(|p| one * of(p)).collect()
    }
}

/// The lightest and the heaviest particle of a world.
#[derive(Clone, Copy, Debug)]
pub(crate) struct MassRange {
    pub(crate) lightest_kg: f64,
    pub(crate) heaviest_kg: f64,
}

impl MassRange {
    /// Of all bodies.
    pub(crate) fn of(world: &World) -> Self {
        let mut range = Self { lightest_kg: f64::INFINITY, heaviest_kg: 0.0 };
        for body in &world.bodies {
            let one = body.density_kg_m3 * body.particle_volume_m3;
            let [least, most] = match &body.volume_factors[..] {
                [] => [1.0; 2],
                factors => factors.iter().fold([f64::INFINITY, 0.0], |[l, m], &f| [l.min(f), m.max(f)]),
            };
            range.lightest_kg = range.lightest_kg.min(one * least);
            range.heaviest_kg = range.heaviest_kg.max(one * most);
        }
        range
    }
}

/// How many substeps a frame takes: the more of those that are wanted and those that stability asks for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stepping {
    /// Substeps per frame that are wanted at least (the published simulations take 200).
    pub least_substeps_per_frame: usize,
    /// The Courant number, in (0, 1): (wave speed of the stiffest material + |v|) dt <= courant * dx, and the viscous
    /// bound.
    pub courant: f64,
}

impl Stepping {
    /// As many as stability asks for. Budget: half of the largest Courant number at which no frame is redone.
    pub const STABLE: Stepping = Stepping { least_substeps_per_frame: 1, courant: 0.4 };

    /// As many as given, and more where a body that is pressed together would become unstable: frames that are redone
    /// put neighbouring worlds apart. Measured: of plasticine that hits the ground, none is redone up to this Courant
    /// number, some are at .9.
    pub fn at_least(substeps_per_frame: usize) -> Stepping {
        Stepping { least_substeps_per_frame: substeps_per_frame, courant: 0.8 }
    }
}

/// Everything that a rollout needs.
#[derive(Clone, Debug)]
pub struct World {
    /// Bodies; their particles are numbered one body after the other, in the order given.
    pub bodies: Vec<Body>,
    /// Obstacles, applied in order.
    pub colliders: Vec<Collider>,
    /// Gravity [m/s^2].
    pub gravity_m_s2: DVec3,
    /// Side of a grid cell [m]; nodes lie on multiples of it.
    pub grid_spacing_m: f64,
    /// Frames per second.
    pub frame_rate_hz: f64,
    /// Substeps.
    pub stepping: Stepping,
}
