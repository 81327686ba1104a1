//! Numbers of a world that may be sought.

use crate::World;
use crate::error::SimulationError;

/// One number of a world that may be sought.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unknown {
    /// A material parameter.
    Material {
        /// Number of the body.
        body: usize,
        /// Its place in [`crate::Material::parameters`].
        parameter: usize,
    },
    /// Density [kg/m^3].
    Density {
        /// Number of the body.
        body: usize,
    },
    /// A component of the initial velocity [m/s].
    Velocity {
        /// Number of the body.
        body: usize,
        /// 0, 1, 2 for x, y, z.
        axis: usize,
    },
    /// A component of the initial angular velocity [rad/s].
    AngularVelocity {
        /// Number of the body.
        body: usize,
        /// 0, 1, 2 for x, y, z.
        axis: usize,
    },
}

impl Unknown {
    /// The number's value in a world.
    ///
    /// # Errors
    /// [`SimulationError::Invalid`] when the world has no such number.
    pub fn get(&self, world: &World) -> Result<f64, SimulationError> {
        let mut world = world.clone();
        self.with_number(&mut world, |number| *number)
    }

    /// A copy of a world with the number replaced.
    ///
    /// # Errors
    /// [`SimulationError::Invalid`] when the world has no such number, [`SimulationError::Material`] when the value is
    /// out of range.
    pub fn set(&self, world: &World, value: f64) -> Result<World, SimulationError> {
        let mut world = world.clone();
        self.with_number(&mut world, |number| *number = value)?;
        for (body, b) in world.bodies.iter().enumerate() {
            b.material.validate().map_err(|source| SimulationError::Material { body, source })?;
        }
        Ok(world)
    }

    /// The size of a considerable change at a value: the value's own, or 1 for velocities, which may be zero.
    pub(super) fn scale(&self, value: f64) -> f64 {
        match self {
            Self::Material { .. } | Self::Density { .. } if value != 0.0 => value.abs(),
            _ => 1.0,
        }
    }

    fn with_number<T>(&self, world: &mut World, f: impl FnOnce(&mut f64) -> T) -> Result<T, SimulationError> {
        let missing = || SimulationError::Invalid {
            field: "unknown".into(),
            value: format!("{self:?}"),
            expected: "must name a body, a parameter and an axis that the world has",
        };
        let (Self::Material { body, .. }
        | Self::Density { body }
        | Self::Velocity { body, .. }
        | Self::AngularVelocity { body, .. }) = *self;
        let body_index = body;
        let body = world.bodies.get_mut(body).ok_or_else(missing)?;
        match *self {
            Self::Density { .. } => Ok(f(&mut body.density_kg_m3)),
            Self::Velocity { axis, .. } if axis < 3 => Ok(f(&mut body.velocity_m_s[axis])),
            Self::AngularVelocity { axis, .. } if axis < 3 => Ok(f(&mut body.angular_velocity_rad_s[axis])),
            Self::Material { parameter, .. } => {
                let mut values = body.material.parameters();
                let result = f(values.get_mut(parameter).ok_or_else(missing)?);
                let material = body.material.with_parameters(&values);
                body.material = material.map_err(|source| SimulationError::Material { body: body_index, source })?;
                Ok(result)
            }
            _ => Err(missing()),
        }
    }
}
