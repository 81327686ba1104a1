//! The obstacles of a motion, with their poses over time.

use std::path::Path;

use gic_twin::simulate::Trajectory;
use gic_twin::twin::{Obstacle, ObstacleShape, Twin};
use serde::Serialize;

use crate::error::Result;

/// An obstacle as the script draws it.
#[derive(Serialize)]
pub(super) struct PageObstacle {
    name: String,
    /// `half_space`, `sphere`, `box`, `cylinder` or `capsule`.
    shape: &'static str,
    /// Outward normal of a half space in its own frame.
    normal: [f64; 3],
    /// Half of the sides of a box [m]; radius, half height and radius of a round shape.
    half_size_m: [f64; 3],
    /// Per frame position [m] and rotation (quaternion x, y, z, w); a single one where it rests.
    poses: Vec<[f64; 7]>,
}

/// All obstacles of a motion.
///
/// # Errors
/// Obstacles that are not valid.
pub(super) fn obstacles(trajectory: &Trajectory) -> Result<Vec<PageObstacle>> {
    let Some(list) = trajectory.twin.get("colliders") else { return Ok(Vec::new()) };
    let times: Vec<f64> = trajectory.frames.iter().map(|frame| frame.time_s).collect();
    let obstacles = Twin::obstacles_of(Path::new("trajectory.json"), list)?;
    Ok(obstacles.iter().enumerate().map(|(i, obstacle)| posed(obstacle, i, &times)).collect())
}

/// An obstacle with its poses at some times [s].
pub(super) fn posed(obstacle: &Obstacle, index: usize, times: &[f64]) -> PageObstacle {
    let mut normal = [0.0; 3];
    let (shape, half_size_m) = match obstacle.shape {
        ObstacleShape::HalfSpace { normal: outward, .. } => {
            normal = glam::DVec3::from(outward).normalize().to_array();
            ("half_space", [0.0; 3])
        }
        ObstacleShape::Sphere { radius_m, .. } => ("sphere", [radius_m; 3]),
        ObstacleShape::Box { size_m, .. } => ("box", size_m.map(|side| 0.5 * side)),
        ObstacleShape::Cylinder { radius_m, height_m, .. } => ("cylinder", [radius_m, 0.5 * height_m, radius_m]),
        ObstacleShape::Capsule { radius_m, height_m, .. } => ("capsule", [radius_m, 0.5 * height_m, radius_m]),
    };
    let collider = obstacle.to_collider();
    let pose = |&time_s: &f64| {
        let (position, rotation) = collider.path.placement(time_s);
        let [x, y, z] = position.to_array();
        [x, y, z, rotation.x, rotation.y, rotation.z, rotation.w]
    };
    let mut poses: Vec<[f64; 7]> = times.iter().map(pose).collect();
    if poses.windows(2).all(|pair| pair[0] == pair[1]) {
        poses.truncate(1);
    }
    PageObstacle { name: obstacle.label(index), shape, normal, half_size_m, poses }
}

#[cfg(test)]
mod tests {
    use gic_twin::twin::{ContactKind, Keyframe};

    use super::*;

    #[test]
    fn a_finger_moves_and_a_floor_rests() {
        let shape = ObstacleShape::Box { centre_m: [0.0; 3], size_m: [0.2, 0.4, 0.6] };
        let mut finger = Obstacle::new(shape, ContactKind::Sticky);
        finger.keyframes =
            [(0.0, 0.0), (1.0, 0.5)].map(|(time_s, x)| Keyframe { time_s, position_m: [x, 0.0, 0.0] }).into();
        let drawn = posed(&finger, 0, &[0.0, 0.5, 1.0]);
        assert_eq!(drawn.poses.iter().map(|pose| pose[0]).collect::<Vec<_>>(), [0.0, 0.25, 0.5]);
        assert_eq!((drawn.shape, drawn.half_size_m), ("box", [0.1, 0.2, 0.3]));
        let shape = ObstacleShape::HalfSpace { point_m: [0.0, 0.1, 0.0], normal: [0.0, 2.0, 0.0] };
        let floor = posed(&Obstacle::new(shape, ContactKind::Sticky), 1, &[0.0, 0.5]);
        assert_eq!((floor.poses, floor.normal), (vec![[0.0, 0.1, 0.0, 0.0, 0.0, 0.0, 1.0]], [0.0, 1.0, 0.0]));
    }
}
