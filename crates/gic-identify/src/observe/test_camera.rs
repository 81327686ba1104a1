//! A camera for tests.

use gic_scene::Camera;
use glam::{DMat3, DVec2, DVec3};

/// A square pinhole that looks along the third axis of `world_from_camera` through its middle; sizes [pixels].
pub(crate) fn test_camera(size: usize, focal: f64, world_from_camera: DMat3, centre: DVec3) -> Camera {
    Camera {
        width: size,
        height: size,
        focal: DVec2::splat(focal),
        principal: DVec2::splat(0.5 * size as f64),
        world_from_camera,
        centre,
    }
}
