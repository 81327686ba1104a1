//! A hypothesis, and the coordinates in which it is varied.

use glam::DVec3;
use serde::{Deserialize, Serialize};

use crate::unknowns::parameter::Parameter;

/// One coordinate of the search.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Unknown {
    /// A material parameter, by its place in [`crate::sought`].
    Material(usize),
    /// A component of the initial velocity.
    Velocity(usize),
    /// A component of the initial angular velocity.
    Angular(usize),
    /// A component of a common translation of all particles (a nuisance of stage 1).
    Offset(usize),
    /// Logarithm of the factor on the Gaussians' standard deviations (a nuisance).
    Splat,
    /// How far the body differs from its reconstruction along a component of the shape (a nuisance).
    Shape(usize),
}

/// A point in the space of all unknowns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct State {
    /// Search coordinates of the material parameters.
    pub material: Vec<f64>,
    /// Initial velocity of the centre of mass [m/s].
    #[serde(with = "crate::vector")]
    pub velocity: DVec3,
    /// Initial angular velocity about the centre of mass [rad/s].
    #[serde(with = "crate::vector")]
    pub angular: DVec3,
    /// Translation of all particles [m].
    #[serde(with = "crate::vector")]
    pub offset: DVec3,
    /// Logarithm of the factor on the Gaussians' standard deviations.
    pub splat: f64,
    /// Standard deviations along each component of the shape; those that are missing are zero.
    pub shape: Vec<f64>,
}

impl State {
    /// Everything at rest and as given.
    pub(crate) fn new(material: Vec<f64>) -> State {
        State {
            material,
            velocity: DVec3::ZERO,
            angular: DVec3::ZERO,
            offset: DVec3::ZERO,
            splat: 0.0,
            shape: Vec::new(),
        }
    }

    pub(crate) fn get(&self, unknown: Unknown) -> f64 {
        match unknown {
            Unknown::Material(i) => self.material[i],
            Unknown::Velocity(a) => self.velocity[a],
            Unknown::Angular(a) => self.angular[a],
            Unknown::Offset(a) => self.offset[a],
            Unknown::Splat => self.splat,
            Unknown::Shape(k) => self.shape.get(k).copied().unwrap_or(0.0),
        }
    }

    fn set(&mut self, unknown: Unknown, value: f64) {
        match unknown {
            Unknown::Material(i) => self.material[i] = value,
            Unknown::Velocity(a) => self.velocity[a] = value,
            Unknown::Angular(a) => self.angular[a] = value,
            Unknown::Offset(a) => self.offset[a] = value,
            Unknown::Splat => self.splat = value,
            Unknown::Shape(k) => {
                if self.shape.len() <= k {
                    self.shape.resize(k + 1, 0.0);
                }
                self.shape[k] = value;
            }
        }
    }

    /// The state displaced by `delta` along `unknowns`, kept inside the limits.
    pub(crate) fn moved(&self, unknowns: &[Unknown], delta: &[f64], parameters: &[Parameter]) -> State {
        let mut next = self.clone();
        for (&unknown, d) in unknowns.iter().zip(delta) {
            let (low, high) = unknown.limits(parameters);
            next.set(unknown, (self.get(unknown) + d).clamp(low, high));
        }
        next
    }
}

impl Unknown {
    /// Limits of the coordinate.
    pub(crate) fn limits(self, parameters: &[Parameter]) -> (f64, f64) {
        match self {
            Unknown::Material(i) => parameters[i].limits(),
            Unknown::Velocity(_) => (-100.0, 100.0),
            Unknown::Angular(_) => (-200.0, 200.0),
            Unknown::Offset(_) => (-1.0, 1.0),
            Unknown::Splat => (-1.0, 1.0),
            Unknown::Shape(_) => (-4.0, 4.0),
        }
    }

    /// Step of the finite differences.
    pub(crate) fn difference_step(self, parameters: &[Parameter]) -> f64 {
        match self {
            Unknown::Material(i) => parameters[i].difference_step(),
            Unknown::Velocity(_) => 2e-3,
            Unknown::Angular(_) => 1e-2,
            Unknown::Offset(_) => 2e-4,
            Unknown::Splat => 1e-2,
            Unknown::Shape(_) => 0.15,
        }
    }

    /// Largest step of one Gauss-Newton iteration.
    pub(crate) fn largest_step(self, parameters: &[Parameter]) -> f64 {
        match self {
            Unknown::Material(i) => parameters[i].largest_step(),
            Unknown::Velocity(_) => 2.0,
            Unknown::Angular(_) => 3.0,
            Unknown::Offset(_) => 0.05,
            Unknown::Splat => 0.2,
            Unknown::Shape(_) => 1.0,
        }
    }
}
