//! Checks of a world before anything is computed.

use glam::DVec3;

use crate::colliders::collider::Collider;
use crate::colliders::contact::Contact;
use crate::colliders::path::ColliderPath;
use crate::colliders::shape::Primitive;
use crate::error::SimulationError;
use crate::rollouts::timestep_bound::MAX_SUBSTEPS;
use crate::world::{Body, MassRange, Stepping, World};

type Check = Result<(), SimulationError>;

/// Fewest cells across a body's largest side. Derived: a smaller body moves as one piece, whatever it is made of.
const FEWEST_CELLS: f64 = 1.0;
/// Least mass of a particle [kg]. Derived: f64 holds it and its inverse as normal numbers.
const MIN_PARTICLE_MASS_KG: f64 = 1e-300;
/// How many times the mass of the lightest particle the heaviest may have. Derived: it takes half of the exponents of
/// f32, and leaves the others to weights and velocities.
const MAX_MASS_RATIO: f64 = (1u64 << 63) as f64;

/// Depth, in cells, to which a collider may hold particles at the start: an object that rests on the ground touches it.
const MAX_INITIAL_DEPTH_CELLS: f64 = 0.5;

impl World {
    /// Checks that the world can be simulated.
    ///
    /// # Errors
    /// Names the first number that makes no sense, and what it must be.
    pub fn validate(&self) -> Check {
        positive("grid_spacing_m", self.grid_spacing_m)?;
        positive("frame_rate_hz", self.frame_rate_hz)?;
        finite("gravity_m_s2", self.gravity_m_s2)?;
        let Stepping { least_substeps_per_frame, courant } = self.stepping;
        if !(1..=MAX_SUBSTEPS).contains(&least_substeps_per_frame) {
            let field = "stepping.least_substeps_per_frame".into();
            return invalid(field, least_substeps_per_frame, "must be at least 1 and at most 200000");
        }
        if !(courant > 0.0 && courant < 1.0) {
            return invalid("stepping.courant".into(), courant, "must be above 0 and below 1");
        }
        for (index, collider) in self.colliders.iter().enumerate() {
            collider.validate(index)?;
        }
        for (index, body) in self.bodies.iter().enumerate() {
            body.validate(index)?;
        }
        if self.bodies.is_empty() {
            return Err(SimulationError::Empty);
        }
        self.check_masses()?;
        self.check_resolution()?;
        self.check_overlap()
    }

    fn check_resolution(&self) -> Check {
        let cells = |body: &Body| body.largest_side_m() / self.grid_spacing_m;
        match self.bodies.iter().map(cells).enumerate().find(|(_, cells)| *cells < FEWEST_CELLS) {
            None => Ok(()),
            Some((body, cells)) => Err(SimulationError::Unresolved { body, cells }),
        }
    }

    fn check_masses(&self) -> Check {
        let MassRange { lightest_kg, heaviest_kg } = MassRange::of(self);
        let can_be_computed = lightest_kg >= MIN_PARTICLE_MASS_KG
            && heaviest_kg.is_finite()
            && heaviest_kg <= MAX_MASS_RATIO * lightest_kg;
        if can_be_computed { Ok(()) } else { Err(SimulationError::Masses { lightest_kg, heaviest_kg }) }
    }

    fn check_overlap(&self) -> Check {
        let positions = self.bodies.iter().flat_map(|body| &body.positions);
        for (particle, &position) in positions.enumerate() {
            for (collider, shape) in self.colliders.iter().enumerate() {
                let depth_m = -shape.signed_distance(position, 0.0);
                if depth_m > MAX_INITIAL_DEPTH_CELLS * self.grid_spacing_m {
                    return Err(SimulationError::InsideCollider { particle, position, collider, depth_m });
                }
            }
        }
        Ok(())
    }
}

impl Body {
    fn validate(&self, index: usize) -> Check {
        let field = |name: &str| format!("bodies[{index}].{name}");
        self.material.validate().map_err(|source| SimulationError::Material { body: index, source })?;
        positive(&field("density_kg_m3"), self.density_kg_m3)?;
        positive(&field("particle_volume_m3"), self.particle_volume_m3)?;
        finite(&field("velocity_m_s"), self.velocity_m_s)?;
        finite(&field("angular_velocity_rad_s"), self.angular_velocity_rad_s)?;
        if self.positions.is_empty() {
            return invalid(field("positions"), "[]", "must hold at least one particle");
        }
        for (name, count) in
            [("volume_factors", self.volume_factors.len()), ("own_velocities_m_s", self.own_velocities_m_s.len())]
        {
            if count != 0 && count != self.positions.len() {
                return invalid(field(name), count, "must hold one for each particle, or none");
            }
        }
        for (particle, &factor) in self.volume_factors.iter().enumerate() {
            if !(factor > 0.0 && factor.is_finite()) {
                positive(&field(&format!("volume_factors[{particle}]")), factor)?;
            }
        }
        for (name, vectors) in [("positions", &self.positions), ("own_velocities_m_s", &self.own_velocities_m_s)] {
            if let Some((particle, vector)) = vectors.iter().enumerate().find(|(_, vector)| !vector.is_finite()) {
                finite(&field(&format!("{name}[{particle}]")), *vector)?;
            }
        }
        Ok(())
    }
}

impl Collider {
    fn validate(&self, index: usize) -> Check {
        let field = |name: &str| format!("colliders[{index}].{name}");
        match self.primitive {
            Primitive::HalfSpace { normal } => unit(&field("normal"), normal)?,
            Primitive::Sphere { radius_m } => positive(&field("radius_m"), radius_m)?,
            Primitive::Box { half_size_m } | Primitive::Pad { half_size_m } => {
                if !(half_size_m.min_element() > 0.0 && half_size_m.is_finite()) {
                    return invalid(field("half_size_m"), half_size_m, "must be positive and finite");
                }
            }
            Primitive::Cylinder { radius_m, half_height_m } | Primitive::Capsule { radius_m, half_height_m } => {
                positive(&field("radius_m"), radius_m)?;
                positive(&field("half_height_m"), half_height_m)?;
            }
        }
        match self.contact {
            Contact::Slip { friction } | Contact::Separating { friction }
                if !(friction >= 0.0 && friction.is_finite()) =>
            {
                return invalid(field("friction"), friction, "must be zero or positive");
            }
            _ => {}
        }
        match &self.path {
            ColliderPath::Uniform { position_m, world_from_collider, velocity_m_s, angular_velocity_rad_s } => {
                finite(&field("position_m"), *position_m)?;
                finite(&field("velocity_m_s"), *velocity_m_s)?;
                finite(&field("angular_velocity_rad_s"), *angular_velocity_rad_s)?;
                rotated(&field("world_from_collider"), *world_from_collider)
            }
            ColliderPath::Keyframed { keys, world_from_collider } => {
                rotated(&field("world_from_collider"), *world_from_collider)?;
                if keys.is_empty() {
                    return invalid(field("keys"), "[]", "must hold at least one key");
                }
                for (key, &(time, position)) in keys.iter().enumerate() {
                    let ascends = key == 0 || time > keys[key - 1].0;
                    if !(time.is_finite() && ascends) {
                        return invalid(field(&format!("keys[{key}]")), time, "times must be finite and ascend");
                    }
                    finite(&field(&format!("keys[{key}]")), position)?;
                }
                Ok(())
            }
        }
    }
}

fn invalid<T>(field: String, value: impl ToString, expected: &'static str) -> Result<T, SimulationError> {
    Err(SimulationError::Invalid { field, value: value.to_string(), expected })
}

fn positive(field: &str, value: f64) -> Check {
    if value > 0.0 && value.is_finite() { Ok(()) } else { invalid(field.into(), value, "must be positive and finite") }
}

fn finite(field: &str, value: DVec3) -> Check {
    if value.is_finite() { Ok(()) } else { invalid(field.into(), value, "must be finite") }
}

fn unit(field: &str, value: DVec3) -> Check {
    if (value.length() - 1.0).abs() < 1e-6 { Ok(()) } else { invalid(field.into(), value, "must have length 1") }
}

fn rotated(field: &str, value: glam::DQuat) -> Check {
    if (value.length() - 1.0).abs() < 1e-6 { Ok(()) } else { invalid(field.into(), value, "must be a unit quaternion") }
}
