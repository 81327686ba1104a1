//! A hypothesis, and the coordinates in which it is varied.

use gic_scene::CameraOffset;
use glam::DVec3;
use serde::{Deserialize, Serialize};

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
    /// What is unknown of the world, in the order of [`State::world`].
    World(usize),
    /// Logarithm of the factor on the side of the grid's cells.
    Cell,
    /// One of the numbers by which a device that takes pictures is off, by their places in [`State::devices`] (a
    /// nuisance).
    Device(usize, usize),
}

impl Unknown {
    /// Whether it changes how particles are drawn, and no motion.
    pub(crate) fn is_of_drawing(self) -> bool {
        matches!(self, Unknown::Splat | Unknown::Device(..))
    }

    /// Whether it changes what a device sees.
    pub(crate) fn concerns(self, device: usize) -> bool {
        !matches!(self, Unknown::Device(other, _) if other != device)
    }
}

/// Numbers that may be unknown of the world.
pub(crate) const WORLD_UNKNOWNS: usize = 7;

/// A point in the space of all unknowns.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct State {
    /// Search coordinates of the material parameters.
    pub material: Vec<f64>,
    /// Initial velocity of the centre of mass [m/s] if gravity is the given one; else the one with which it is as fast
    /// halfway through the flight, as the outlines say.
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
    /// How much the world differs from the given one: the ground higher [m], tilted about two axes in it [rad], the
    /// logarithm of the factor on its friction, that of the factor on gravity, and gravity's tilt about two axes at
    /// right angles to it [rad].
    pub world: [f64; WORLD_UNKNOWNS],
    /// Whether the ground, whose contact is in doubt, holds what touches it.
    pub sticks: bool,
    /// Logarithm of the factor on the side of the grid's cells.
    pub log_cell: f64,
    /// The numbers of each device's [`CameraOffset`] from the input's; those that are missing are zero.
    pub devices: Vec<[f64; CameraOffset::NUMBERS]>,
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
            world: [0.0; WORLD_UNKNOWNS],
            sticks: false,
            log_cell: 0.0,
            devices: Vec::new(),
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
            Unknown::World(k) => self.world[k],
            Unknown::Cell => self.log_cell,
            Unknown::Device(device, k) => self.devices.get(device).map_or(0.0, |numbers| numbers[k]),
        }
    }

    pub(crate) fn set(&mut self, unknown: Unknown, value: f64) {
        match unknown {
            Unknown::Material(i) => self.material[i] = value,
            Unknown::Velocity(a) => self.velocity[a] = value,
            Unknown::Angular(a) => self.angular[a] = value,
            Unknown::Offset(a) => self.offset[a] = value,
            Unknown::Splat => self.splat = value,
            Unknown::World(k) => self.world[k] = value,
            Unknown::Cell => self.log_cell = value,
            Unknown::Shape(k) => *entry(&mut self.shape, k) = value,
            Unknown::Device(device, k) => entry(&mut self.devices, device)[k] = value,
        }
    }
}

/// An entry of a list whose missing ones are zero.
pub(crate) fn entry<T: Clone + Default>(list: &mut Vec<T>, k: usize) -> &mut T {
    list.resize(list.len().max(k + 1), T::default());
    &mut list[k]
}
