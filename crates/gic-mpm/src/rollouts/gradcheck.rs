//! The adjoint against central differences, as a table.

use glam::{DQuat, DVec3};

use super::gradient::{BodyGradient, FrameAdjoint};
use super::recording::gradient;
use super::simulator::rollout;
use super::unknown::Unknown;
use crate::error::SimulationError;
use crate::options::{Options, Precision};
use crate::{Body, Collider, ColliderPath, Contact, Frame, Material, Primitive, Rules, Stepping, World};

/// Step of the central differences, relative to the scale of the unknown.
const RELATIVE_STEP: f64 = 1e-6;
/// Derivatives below this fraction of the largest (both per relative change) are compared with that largest one: they
/// are rounding.
const NEGLIGIBLE_FRACTION: f64 = 1e-5;

/// The time [s] for which velocities count in the loss as ways.
const TIME_OF_VELOCITIES_S: f64 = 0.01;

/// Largest [`GradcheckRow::relative_error`] of an adjoint that is right.
pub const GRADCHECK_TOLERANCE: f64 = 1e-3;

/// One derivative, computed in two ways.
#[derive(Clone, Debug, PartialEq)]
pub struct GradcheckRow {
    /// What the loss is differentiated by.
    pub name: String,
    /// Its value; 0 for a displacement.
    pub value: f64,
    /// The adjoint's answer.
    pub adjoint: f64,
    /// The answer of central differences in f64.
    pub finite_difference: f64,
    /// Their difference relative to the derivative (or to a floor, where the loss hardly depends on it).
    pub relative_error: f64,
}

impl GradcheckRow {
    /// Whether the two answers agree; a NaN does not.
    pub fn passes(&self) -> bool {
        self.relative_error <= GRADCHECK_TOLERANCE
    }
}

/// Differentiates a fixed smooth loss on all frames' positions and velocities by everything that body 0 starts with, in
/// f64: by the adjoint and by central differences. `frames` includes frame 0.
///
/// # Errors
/// As [`crate::gradient`].
pub fn gradcheck(world: &World, rules: Rules, frames: usize) -> Result<Vec<GradcheckRow>, SimulationError> {
    let options = Options { precision: Precision::F64, rules, ..Options::default() };
    let by_adjoint = gradient(world, &options, frames, loss_gradient)?;
    let probes = probes(world, &by_adjoint.bodies[0])?;
    let loss = |world: &World| -> Result<f64, SimulationError> {
        let mut sum = 0.0;
        rollout(world, &options, frames, |frame| sum += loss_of(&frame))?;
        Ok(sum)
    };
    let central = |probe: &Probe<'_>| -> Result<f64, SimulationError> {
        let step = RELATIVE_STEP * probe.scale;
        Ok((loss(&(probe.moved)(step)?)? - loss(&(probe.moved)(-step)?)?) / (2.0 * step))
    };
    let differences: Vec<f64> = probes.iter().map(central).collect::<Result<_, _>>()?;
    let sizes = probes.iter().zip(&differences).map(|(probe, difference)| (probe.scale * difference).abs());
    let largest = sizes.fold(0.0, f64::max);
    Ok(probes.into_iter().zip(differences).map(|(probe, difference)| probe.row(difference, largest)).collect())
}

/// Something that body 0 starts with, and the adjoint's derivative with respect to it.
struct Probe<'a> {
    name: String,
    value: f64,
    /// The size of a considerable change.
    scale: f64,
    adjoint: f64,
    /// The world with it changed by so much.
    moved: Box<dyn Fn(f64) -> Result<World, SimulationError> + 'a>,
}

impl Probe<'_> {
    /// `largest` is the largest derivative per considerable change.
    fn row(self, finite_difference: f64, largest: f64) -> GradcheckRow {
        let Self { name, value, scale, adjoint, .. } = self;
        let size = finite_difference.abs().max(NEGLIGIBLE_FRACTION * largest / scale);
        let relative_error = (adjoint - finite_difference).abs() / size;
        GradcheckRow { name, value, adjoint, finite_difference, relative_error }
    }
}

fn probes<'a>(world: &'a World, body: &BodyGradient) -> Result<Vec<Probe<'a>>, SimulationError> {
    let mut probes = Vec::new();
    for (name, unknown, adjoint) in unknowns(world, body) {
        let value = unknown.get(world)?;
        let scale = unknown.scale(value);
        let moved = Box::new(move |step| unknown.set(world, value + step));
        probes.push(Probe { name, value, scale, adjoint, moved });
    }
    probes.push(particle_volume(world, body));
    probes.push(displacement(world, body));
    probes.push(own_velocities(world, body));
    probes.push(volume_factors(world, body));
    Ok(probes)
}

fn particle_volume<'a>(world: &'a World, body: &BodyGradient) -> Probe<'a> {
    let value = world.bodies[0].particle_volume_m3;
    let moved = Box::new(move |step| {
        let mut world = world.clone();
        world.bodies[0].particle_volume_m3 = value + step;
        Ok(world)
    });
    Probe { name: "particle_volume_m3".into(), value, scale: value, adjoint: body.particle_volume, moved }
}

/// All positions at once, each along its own [`direction`].
fn displacement<'a>(world: &'a World, body: &BodyGradient) -> Probe<'a> {
    let moved = Box::new(|step| {
        let mut world = world.clone();
        for (p, x) in world.bodies[0].positions.iter_mut().enumerate() {
            *x += direction(p) * step;
        }
        Ok(world)
    });
    let adjoint = body.positions.iter().enumerate().map(|(p, bar)| bar.dot(direction(p))).sum();
    Probe { name: "positions_m (one direction)".into(), value: 0.0, scale: world.grid_spacing_m, adjoint, moved }
}

/// All velocities at once, each along its own [`direction`].
fn own_velocities<'a>(world: &'a World, body: &BodyGradient) -> Probe<'a> {
    let moved = Box::new(|step| {
        let mut world = world.clone();
        let body = &mut world.bodies[0];
        body.own_velocities_m_s.resize(body.positions.len(), DVec3::ZERO);
        for (p, v) in body.own_velocities_m_s.iter_mut().enumerate() {
            *v += direction(p) * step;
        }
        Ok(world)
    });
    let adjoint = body.velocities.iter().enumerate().map(|(p, bar)| bar.dot(direction(p))).sum();
    Probe { name: "own_velocities_m_s (one direction)".into(), value: 0.0, scale: 1.0, adjoint, moved }
}

/// All volume factors at once, each at its own rate.
fn volume_factors<'a>(world: &'a World, body: &BodyGradient) -> Probe<'a> {
    let moved = Box::new(|step| {
        let mut world = world.clone();
        let body = &mut world.bodies[0];
        body.volume_factors.resize(body.positions.len(), 1.0);
        for (p, factor) in body.volume_factors.iter_mut().enumerate() {
            *factor += direction(p).y * step;
        }
        Ok(world)
    });
    let adjoint = body.volume_factors.iter().enumerate().map(|(p, bar)| bar * direction(p).y).sum();
    Probe { name: "volume_factors (one direction)".into(), value: 0.0, scale: 1.0, adjoint, moved }
}

/// One material of each kind, soft and weak enough to deform and yield in [`gradcheck_world`].
pub fn gradcheck_materials() -> [Material; 6] {
    [
        Material::Elastic { youngs_modulus_pa: 2e5, poisson_ratio: 0.3 },
        Material::Plasticine { youngs_modulus_pa: 3e5, poisson_ratio: 0.25, yield_stress_pa: 2e3 },
        Material::Sand { friction_angle_deg: 32.0, youngs_modulus_pa: 3e5, poisson_ratio: 0.3 },
        Material::Newtonian { viscosity_pa_s: 50.0, bulk_modulus_pa: 5e4 },
        Material::NonNewtonian {
            shear_modulus_pa: 2.1e4,
            bulk_modulus_pa: 1e5,
            yield_stress_pa: 500.0,
            plastic_viscosity_pa_s: 10.0,
        },
        Material::Viscoelastic { youngs_modulus_pa: 2e5, poisson_ratio: 0.3, retardation_time_s: 1e-4 },
    ]
}

/// A small world in which a spinning block of the material hits a slanted sticky floor and a moving ball with friction
/// in its first frame of 50 substeps, hard enough to yield; its particles have different volumes.
pub fn gradcheck_world(material: Material) -> World {
    let spacing = 0.01;
    let count = DVec3::new(7.0, 6.0, 5.0);
    let mut positions = Vec::new();
    for i in 0..(count.x * count.y * count.z) as usize {
        let (x, y, z) = (i % 7, i / 7 % 6, i / 42);
        let jitter = direction(i) * 0.1;
        positions.push((DVec3::new(x as f64, y as f64, z as f64) + jitter) * spacing + DVec3::new(0.0, 0.021, 0.0));
    }
    let still = |position_m: DVec3, velocity_m_s: DVec3| ColliderPath::Uniform {
        position_m,
        world_from_collider: DQuat::IDENTITY,
        velocity_m_s,
        angular_velocity_rad_s: DVec3::ZERO,
    };
    World {
        bodies: vec![Body {
            material,
            density_kg_m3: 1000.0,
            particle_volume_m3: spacing.powi(3),
            volume_factors: (0..positions.len()).map(|p| 1.0 + 0.3 * direction(p).x).collect(),
            positions,
            velocity_m_s: DVec3::new(0.4, -3.0, 0.2),
            angular_velocity_rad_s: DVec3::new(1.0, -2.0, 3.0),
            own_velocities_m_s: Vec::new(),
        }],
        colliders: vec![
            Collider {
                primitive: Primitive::HalfSpace { normal: DVec3::new(0.1, 1.0, 0.05).normalize() },
                path: still(DVec3::ZERO, DVec3::ZERO),
                contact: Contact::Sticky,
            },
            Collider {
                primitive: Primitive::Sphere { radius_m: 0.05 },
                path: still(DVec3::new(0.13, 0.06, 0.03), DVec3::new(-1.5, 0.0, 0.0)),
                contact: Contact::Separating { friction: 0.3 },
            },
        ],
        gravity_m_s2: DVec3::new(0.0, -9.8, 0.0),
        grid_spacing_m: 0.02,
        frame_rate_hz: 100.0,
        stepping: Stepping::at_least(50),
    }
}

fn unknowns(world: &World, body: &BodyGradient) -> Vec<(String, Unknown, f64)> {
    let names = world.bodies[0].material.parameter_names();
    let mut all: Vec<(String, Unknown, f64)> = (0..names.len())
        .map(|parameter| (names[parameter].into(), Unknown::Material { body: 0, parameter }, body.material[parameter]))
        .collect();
    all.push(("density_kg_m3".into(), Unknown::Density { body: 0 }, body.density));
    for (axis, letter) in ["x", "y", "z"].into_iter().enumerate() {
        all.push((format!("velocity_m_s.{letter}"), Unknown::Velocity { body: 0, axis }, body.velocity[axis]));
        let unknown = Unknown::AngularVelocity { body: 0, axis };
        all.push((format!("angular_velocity_rad_s.{letter}"), unknown, body.angular_velocity[axis]));
    }
    all
}

/// A fixed vector for each particle, without pattern.
fn direction(particle: usize) -> DVec3 {
    let p = particle as f64;
    DVec3::new((1.3 * p + 0.2).sin(), (2.7 * p + 1.1).sin(), (4.1 * p + 2.3).sin())
}

/// Sum over particles of d . (x + T v) + |x|^2 / 2 + |T v|^2 / 2, mean over particles, heavier for later frames.
fn loss_of(frame: &Frame) -> f64 {
    let of_particle = |p: usize| {
        let (x, v) = (frame.positions[p], frame.velocities[p] * TIME_OF_VELOCITIES_S);
        direction(p).dot(x + v) + 0.5 * (x.length_squared() + v.length_squared())
    };
    weight(frame) * (0..frame.positions.len()).map(of_particle).sum::<f64>()
}

fn loss_gradient(frame: &Frame) -> FrameAdjoint {
    let weight = weight(frame);
    let by_position = |(p, x): (usize, &DVec3)| (direction(p) + *x) * weight;
    let by_velocity =
        |(p, v): (usize, &DVec3)| (direction(p) + *v * TIME_OF_VELOCITIES_S) * (weight * TIME_OF_VELOCITIES_S);
    FrameAdjoint {
        positions: Some(frame.positions.iter().enumerate().map(by_position).collect()),
        velocities: Some(frame.velocities.iter().enumerate().map(by_velocity).collect()),
    }
}

fn weight(frame: &Frame) -> f64 {
    (frame.index + 1) as f64 / frame.positions.len() as f64
}
