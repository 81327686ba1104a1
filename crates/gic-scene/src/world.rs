//! What is known about the world frame of a scene.

use gic_geometry::Plane;
use glam::DVec3;

/// What the format fixes about the world frame; `None` where it says nothing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct World {
    /// The unit vector that points up.
    pub up: Option<DVec3>,
    /// Gravitational acceleration [m/s^2].
    pub gravity: Option<DVec3>,
    /// The ground, which the object sticks to.
    pub ground: Option<Plane>,
    /// Standard deviation of its height [m]; 0 where it is exact.
    pub ground_deviation_m: f64,
    /// Whether lengths are metres; otherwise the unit is arbitrary (COLMAP, Blender).
    pub metric: bool,
}

/// A coloured point of a sparse reconstruction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ColouredPoint {
    /// Position in the world frame.
    pub position: DVec3,
    /// Red, green, blue in [0, 1].
    pub rgb: [f32; 3],
}
