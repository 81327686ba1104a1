//! Rigid obstacles: what they are, how they move, how they touch.

use glam::{DQuat, DVec3};

/// What happens to the grid velocity inside an obstacle, relative to the obstacle's own velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Contact {
    /// No relative motion.
    Sticky,
    /// No relative motion along the normal in either direction; Coulomb friction along the surface.
    Slip {
        /// Coulomb coefficient.
        friction: f64,
    },
    /// No approach along the normal, free to leave; Coulomb friction along the surface while it presses.
    Separating {
        /// Coulomb coefficient.
        friction: f64,
    },
}

/// A solid shape in its own frame; solid where the signed distance is negative.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Primitive {
    /// Everything below the plane through the origin whose outward normal is `normal`.
    HalfSpace {
        /// Outward unit normal.
        normal: DVec3,
    },
    /// Ball around the origin.
    Sphere {
        /// Radius [m].
        radius_m: f64,
    },
    /// Axis-aligned box around the origin.
    Box {
        /// Half of each side [m].
        half_size_m: DVec3,
    },
    /// Finite cylinder around the local y axis, centred at the origin.
    Cylinder {
        /// Radius [m].
        radius_m: f64,
        /// Half of its length [m].
        half_height_m: f64,
    },
    /// Cylinder with round ends around the local y axis, centred at the origin.
    Capsule {
        /// Radius [m].
        radius_m: f64,
        /// Half of the length between the centres of the round ends [m].
        half_height_m: f64,
    },
}

/// Where an obstacle is over time.
#[derive(Clone, Debug, PartialEq)]
pub enum Motion {
    /// Starts at a place and keeps a velocity.
    Uniform {
        /// Position of its origin at time 0 [m].
        position_m: DVec3,
        /// Rotation from its own frame to the world.
        rotation: DQuat,
        /// Velocity [m/s].
        velocity_m_s: DVec3,
        /// Angular velocity [rad/s] about its origin.
        angular_velocity_rad_s: DVec3,
    },
    /// Moves linearly between keys (time [s], position [m]), ascending in time; rests before the first and after the last.
    Keyframed {
        /// The keys.
        keys: Vec<(f64, DVec3)>,
        /// Rotation from its own frame to the world, constant.
        rotation: DQuat,
    },
}

/// A rigid obstacle.
#[derive(Clone, Debug, PartialEq)]
pub struct Collider {
    /// Its shape.
    pub primitive: Primitive,
    /// Its motion.
    pub motion: Motion,
    /// Its contact law.
    pub contact: Contact,
}
