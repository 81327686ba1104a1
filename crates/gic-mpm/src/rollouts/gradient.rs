//! The derivative of a loss on the positions and velocities of any frames.

use gic_simd::Scalar;
use glam::DVec3;

use crate::colliders::grid_frame::GridFrame;
use crate::laws::law::Coefficients;
use crate::substep::engine::BodyBars;
use crate::substep::prepared_world::PreparedBody;
use crate::substep::state::{State, double};

/// Derivatives of a loss with respect to what a frame reports; the loss does not depend on what is `None`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameAdjoint {
    /// With respect to the positions [per m], shape [n].
    pub positions: Option<Vec<DVec3>>,
    /// With respect to the velocities [per m/s], shape [n].
    pub velocities: Option<Vec<DVec3>>,
}

impl From<Option<Vec<DVec3>>> for FrameAdjoint {
    /// Of a loss that looks at positions alone.
    fn from(positions: Option<Vec<DVec3>>) -> Self {
        Self { positions, velocities: None }
    }
}

/// Derivatives of a loss with respect to what a body starts with.
#[derive(Clone, Debug)]
pub struct BodyGradient {
    /// With respect to the material's parameters, in the order of [`crate::Material::parameters`].
    pub material: Vec<f64>,
    /// With respect to the density [per kg/m^3], at constant particle volume.
    pub density: f64,
    /// With respect to the rest volume of a particle of factor 1 [per m^3], at constant density and factors.
    pub particle_volume: f64,
    /// With respect to each particle's volume factor, shape [n], at constant density and particle volume.
    pub volume_factors: Vec<f64>,
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

impl BodyGradient {
    /// The same with respect to the world's vectors instead of those in the axes of the grid.
    pub(super) fn in_world(mut self, frame: &GridFrame) -> BodyGradient {
        let all = self.positions.iter_mut().chain(&mut self.velocities);
        for bar in all.chain([&mut self.velocity, &mut self.angular_velocity]) {
            *bar = frame.vector_in_world(*bar);
        }
        self
    }
}

/// Derivatives of a loss.
#[derive(Clone, Debug)]
pub struct Gradient {
    /// One per body.
    pub bodies: Vec<BodyGradient>,
}

/// From the adjoint of the initial state to the derivatives with respect to what a body starts with.
pub(super) fn body_gradient<R: Scalar>(
    (body, mass_unit): (&PreparedBody, f64),
    (bars, factor_bars): (&BodyBars, &[f64]),
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
    let mut volume_factors = factor_bars[body.range.clone()].to_vec();
    let particles = body.positions.iter().zip(&body.factors);
    for ((x, factor), (position, bar)) in particles.zip(positions.iter_mut().zip(&mut volume_factors)) {
        *position += through_centre * *factor;
        *bar += through_centre.dot(*x - body.centre);
    }
    let density = body.mass / body.volume;
    BodyGradient {
        material: body.material.parameter_gradient(&Coefficients(bars.coefficients)),
        density: bars.mass * body.volume,
        particle_volume: (bars.volume + bars.mass * density) / mass_unit,
        volume_factors,
        velocity,
        angular_velocity,
        positions,
        velocities,
    }
}
