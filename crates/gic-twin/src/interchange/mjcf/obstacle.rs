//! Obstacles as geoms.

use glam::{DQuat, DVec3};

use super::super::friction;
use super::triple;
use crate::twin::{Obstacle, ObstacleShape};

/// An obstacle as a geom with the time constant of its contact [s]; one that moves as a comment.
pub(super) fn geom(index: usize, obstacle: &Obstacle, contact_s: f64) -> String {
    let label = obstacle.label(index);
    if obstacle.moves() {
        return format!("    <!-- {label} moves and is left out -->\n");
    }
    let turn = crate::rotation(obstacle.rotation_deg.unwrap_or_default());
    let friction = friction(obstacle);
    // MuJoCo's cylinders and capsules stand along z, the twin's along y.
    let along_z = turn * DQuat::from_rotation_x(-std::f64::consts::FRAC_PI_2);
    let quaternion = |q: DQuat| format!("{} {} {} {}", q.w, q.x, q.y, q.z);
    let shape = match obstacle.shape {
        ObstacleShape::HalfSpace { point_m, normal } => {
            let normal = turn * DVec3::from(normal).normalize();
            format!("type=\"plane\" size=\"0 0 1\" pos=\"{}\" zaxis=\"{}\"", triple(point_m), triple(normal.to_array()))
        }
        ObstacleShape::Sphere { centre_m, radius_m } => {
            format!("type=\"sphere\" size=\"{radius_m}\" pos=\"{}\"", triple(centre_m))
        }
        ObstacleShape::Box { centre_m, size_m } => format!(
            "type=\"box\" size=\"{}\" pos=\"{}\" quat=\"{}\"",
            triple(size_m.map(|s| 0.5 * s)),
            triple(centre_m),
            quaternion(turn)
        ),
        ObstacleShape::Cylinder { centre_m, radius_m, height_m } => format!(
            "type=\"cylinder\" size=\"{radius_m} {}\" pos=\"{}\" quat=\"{}\"",
            0.5 * height_m,
            triple(centre_m),
            quaternion(along_z)
        ),
        ObstacleShape::Capsule { centre_m, radius_m, height_m } => format!(
            "type=\"capsule\" size=\"{radius_m} {}\" pos=\"{}\" quat=\"{}\"",
            0.5 * height_m,
            triple(centre_m),
            quaternion(along_z)
        ),
    };
    // MuJoCo's default contact gives way for 20 ms and takes energy; the obstacle's values stand before the body's.
    format!(
        "    <geom name=\"obstacle{index}\" {shape} friction=\"{friction} 0.005 0.0001\" solref=\"{contact_s:.4e} 1\" \
         priority=\"1\"/>\n"
    )
}
