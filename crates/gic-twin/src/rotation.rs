//! Rotations as twins write them.

use glam::DQuat;

/// Rotation about the world's x, then y, then z axis [degrees].
pub fn rotation(degrees: [f64; 3]) -> DQuat {
    let [x, y, z] = degrees.map(f64::to_radians);
    DQuat::from_rotation_z(z) * DQuat::from_rotation_y(y) * DQuat::from_rotation_x(x)
}
