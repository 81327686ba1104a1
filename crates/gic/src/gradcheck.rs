//! `gic gradcheck`: the simulator's adjoint against finite differences in f64, per parameter.

use gic_mpm::{
    Body, Collider, Contact, Frame, Gradient, Material, Options, Precision, SimulationError, Stepping, Unknown, World,
    gradient, rollout,
};
use glam::{DQuat, DVec3};
use rayon::prelude::*;

use crate::error::{Error, Result};

/// Largest relative error that passes.
pub const TOLERANCE: f64 = 1e-3;

/// Frames of the checked rollout, the initial state included; 25 substeps each.
const FRAMES: usize = 3;
const SUBSTEPS_PER_FRAME: usize = 25;
const PARTICLE_SPACING_M: f64 = 0.01;

/// One derivative, computed twice.
#[derive(Clone, Debug, PartialEq)]
pub struct DerivativeCheck {
    /// Model of the material.
    pub model: &'static str,
    /// What the loss is differentiated with respect to.
    pub name: String,
    /// Its value.
    pub value: f64,
    /// The derivative by the adjoint.
    pub adjoint: f64,
    /// The derivative by finite differences.
    pub difference: f64,
    /// Their distance, relative to the finite difference.
    pub error: f64,
}

/// The materials that are checked: soft and weak enough to deform and yield within the rollout.
pub fn materials() -> [Material; 5] {
    [
        Material::Elastic { youngs_modulus_pa: 1.0e5, poisson_ratio: 0.3 },
        Material::Plasticine { youngs_modulus_pa: 2.0e5, poisson_ratio: 0.25, yield_stress_pa: 2.0e3 },
        Material::Sand { friction_angle_deg: 32.0, youngs_modulus_pa: 2.0e5, poisson_ratio: 0.3 },
        Material::Newtonian { viscosity_pa_s: 20.0, bulk_modulus_pa: 5.0e4 },
        Material::NonNewtonian {
            shear_modulus_pa: 3.0e4,
            bulk_modulus_pa: 1.0e5,
            yield_stress_pa: 500.0,
            plastic_viscosity_pa_s: 5.0,
        },
    ]
}

/// Differentiates a rollout of a small block that hits a sticky floor, both ways.
///
/// # Errors
/// Those of the simulator.
pub fn check(material: Material) -> Result<Vec<DerivativeCheck>> {
    let world = block(material);
    let failed = |source: SimulationError| Error::stage("gradient check")(source);
    let particles = world.bodies[0].positions.len();
    let options = Options { precision: Precision::F64, ..Options::default() };
    let analytic = gradient(&world, &options, FRAMES, |frame| {
        (frame.index > 0).then(|| (0..particles).map(|p| weight(frame.index, p)).collect())
    })
    .map_err(failed)?;
    quantities(material)
        .par_iter()
        .map(|quantity| quantity.row(&world, &options, &analytic))
        .collect::<std::result::Result<_, _>>()
        .map_err(failed)
}

/// Derivative of the loss with respect to a particle's position in a frame: all different, so that nothing cancels.
fn weight(frame: usize, particle: usize) -> DVec3 {
    let p = (particle + 1000 * frame) as f64;
    DVec3::new(1.0 + (1.3 * p).sin(), 0.5 + (2.1 * p).cos(), -0.7 + (0.7 * p).sin())
}

fn loss(world: &World, options: &Options) -> std::result::Result<f64, SimulationError> {
    let mut sum = 0.0;
    let mut add = |frame: Frame| {
        if frame.index > 0 {
            sum += frame.positions.iter().enumerate().map(|(p, x)| weight(frame.index, p).dot(*x)).sum::<f64>();
        }
    };
    rollout(world, options, FRAMES, &mut add)?;
    Ok(sum)
}

/// A tilted block of 6 x 5 x 4 particles about to hit the floor.
fn block(material: Material) -> World {
    let tilt = DQuat::from_rotation_z(0.4) * DQuat::from_rotation_x(0.3);
    let mut positions = Vec::new();
    for i in 0..6 {
        for j in 0..5 {
            for k in 0..4 {
                let lattice = DVec3::new(i as f64 - 2.5, j as f64 - 2.0, k as f64 - 1.5) * PARTICLE_SPACING_M;
                positions.push(DVec3::new(0.003, 0.062, -0.004) + tilt * lattice);
            }
        }
    }
    World {
        bodies: vec![Body {
            material,
            density_kg_m3: 1000.0,
            particle_volume_m3: PARTICLE_SPACING_M.powi(3),
            volume_factors: Vec::new(),
            positions,
            velocity_m_s: DVec3::new(0.5, -4.0, 0.25),
            angular_velocity_rad_s: DVec3::new(2.0, -1.0, 3.0),
        }],
        colliders: vec![Collider::plane(DVec3::ZERO, DVec3::Y, Contact::Sticky)],
        gravity_m_s2: DVec3::new(0.0, -9.8, 0.0),
        grid_spacing_m: 2.0 * PARTICLE_SPACING_M,
        frame_rate_hz: 200.0,
        stepping: Stepping::Fixed { substeps_per_frame: SUBSTEPS_PER_FRAME },
    }
}

/// Something that the loss is differentiated with respect to.
enum CheckedQuantity {
    Unknown { name: String, unknown: Unknown },
    Position { particle: usize, axis: usize },
}

const AXES: [&str; 3] = ["x", "y", "z"];

fn quantities(material: Material) -> Vec<CheckedQuantity> {
    let unknown = |name: &str, unknown| CheckedQuantity::Unknown { name: name.into(), unknown };
    let mut all = Vec::new();
    for (parameter, name) in material.parameter_names().iter().enumerate() {
        all.push(unknown(name, Unknown::Material { body: 0, parameter }));
    }
    all.push(unknown("density_kg_m3", Unknown::Density { body: 0 }));
    for (axis, letter) in AXES.iter().enumerate() {
        all.push(unknown(&format!("velocity_{letter}_m_s"), Unknown::Velocity { body: 0, axis }));
    }
    for (axis, letter) in AXES.iter().enumerate() {
        all.push(unknown(&format!("angular_velocity_{letter}_rad_s"), Unknown::AngularVelocity { body: 0, axis }));
    }
    for (particle, axis) in [(0, 0), (41, 1), (119, 2)] {
        all.push(CheckedQuantity::Position { particle, axis });
    }
    all
}

impl CheckedQuantity {
    fn row(
        &self,
        world: &World,
        options: &Options,
        gradient: &Gradient,
    ) -> std::result::Result<DerivativeCheck, SimulationError> {
        let body = &gradient.bodies[0];
        let (name, value, adjoint, step) = match self {
            Self::Unknown { name, unknown } => {
                let adjoint = match *unknown {
                    Unknown::Material { parameter, .. } => body.material[parameter],
                    Unknown::Density { .. } => body.density,
                    Unknown::Velocity { axis, .. } => body.velocity[axis],
                    Unknown::AngularVelocity { axis, .. } => body.angular_velocity[axis],
                };
                let value = unknown.get(world)?;
                (name.clone(), value, adjoint, 1e-5 * value.abs())
            }
            Self::Position { particle, axis } => {
                let value = world.bodies[0].positions[*particle][*axis];
                (
                    format!("position_{}_m of particle {particle}", AXES[*axis]),
                    value,
                    body.positions[*particle][*axis],
                    1e-7,
                )
            }
        };
        let at = |offset: f64| loss(&self.moved(world, value + offset)?, options);
        let difference = (at(step)? - at(-step)?) / (2.0 * step);
        let error = (adjoint - difference).abs() / difference.abs();
        Ok(DerivativeCheck { model: world.bodies[0].material.model(), name, value, adjoint, difference, error })
    }

    fn moved(&self, world: &World, value: f64) -> std::result::Result<World, SimulationError> {
        match self {
            Self::Unknown { unknown, .. } => unknown.set(world, value),
            Self::Position { particle, axis } => {
                let mut world = world.clone();
                world.bodies[0].positions[*particle][*axis] = value;
                Ok(world)
            }
        }
    }
}

impl DerivativeCheck {
    /// Whether the two derivatives agree; a NaN does not.
    pub fn passes(&self) -> bool {
        self.error <= TOLERANCE
    }
}
