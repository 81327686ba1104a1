//! Where an obstacle is over time.

use glam::{DQuat, DVec3};

/// Where an obstacle is over time.
#[derive(Clone, Debug, PartialEq)]
pub enum ColliderPath {
    /// Starts at a place and keeps a velocity.
    Uniform {
        /// Position of its origin at time 0 [m].
        position_m: DVec3,
        /// Rotation from its own frame to the world.
        world_from_collider: DQuat,
        /// Velocity [m/s].
        velocity_m_s: DVec3,
        /// Angular velocity [rad/s] about its origin.
        angular_velocity_rad_s: DVec3,
    },
    /// Moves linearly between keys (time [s], position [m]), ascending in time; rests before the first and after the
    /// last.
    Keyframed {
        /// The keys.
        keys: Vec<(f64, DVec3)>,
        /// Rotation from its own frame to the world, constant.
        world_from_collider: DQuat,
    },
}

/// Where an obstacle is at one moment.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pose {
    pub(crate) position: DVec3,
    pub(crate) world_from_collider: DQuat,
    pub(crate) velocity: DVec3,
    pub(crate) angular_velocity: DVec3,
}

impl ColliderPath {
    /// The same path where another frame has other points, vectors and rotations.
    pub(crate) fn map(
        &self,
        point: &impl Fn(DVec3) -> DVec3,
        vector: &impl Fn(DVec3) -> DVec3,
        turned: &impl Fn(DQuat) -> DQuat,
    ) -> Self {
        match self {
            Self::Uniform { position_m, world_from_collider, velocity_m_s, angular_velocity_rad_s } => Self::Uniform {
                position_m: point(*position_m),
                world_from_collider: turned(*world_from_collider),
                velocity_m_s: vector(*velocity_m_s),
                angular_velocity_rad_s: vector(*angular_velocity_rad_s),
            },
            Self::Keyframed { keys, world_from_collider } => Self::Keyframed {
                keys: keys.iter().map(|(time, position)| (*time, point(*position))).collect(),
                world_from_collider: turned(*world_from_collider),
            },
        }
    }

    /// Whether it never moves.
    pub(crate) fn is_at_rest(&self) -> bool {
        match self {
            Self::Uniform { velocity_m_s, angular_velocity_rad_s, .. } => {
                *velocity_m_s == DVec3::ZERO && *angular_velocity_rad_s == DVec3::ZERO
            }
            Self::Keyframed { keys, .. } => keys.len() < 2,
        }
    }

    /// Whether it moves straight on without turning.
    pub(crate) fn is_straight(&self) -> bool {
        matches!(self, Self::Uniform { angular_velocity_rad_s: DVec3::ZERO, .. })
    }

    /// Highest speed of its origin [m/s] between two times [s].
    pub(crate) fn highest_speed(&self, start: f64, end: f64) -> f64 {
        match self {
            Self::Uniform { velocity_m_s, .. } => velocity_m_s.length(),
            Self::Keyframed { keys, .. } => {
                let pairs = keys.windows(2).filter(|pair| pair[0].0 < end && pair[1].0 > start);
                let speed = |pair: &[(f64, DVec3)]| (pair[1].1 - pair[0].1).length() / (pair[1].0 - pair[0].0);
                pairs.map(speed).fold(0.0, f64::max)
            }
        }
    }

    /// Where its origin is at a time [s] [m], and the rotation from its own frame to the world.
    pub fn placement(&self, time_s: f64) -> (DVec3, DQuat) {
        let pose = self.pose(time_s);
        (pose.position, pose.world_from_collider)
    }

    /// The pose at a time [s].
    pub(crate) fn pose(&self, time: f64) -> Pose {
        match self {
            Self::Uniform { position_m, world_from_collider, velocity_m_s, angular_velocity_rad_s } => Pose {
                position: *position_m + *velocity_m_s * time,
                world_from_collider: DQuat::from_scaled_axis(*angular_velocity_rad_s * time) * *world_from_collider,
                velocity: *velocity_m_s,
                angular_velocity: *angular_velocity_rad_s,
            },
            Self::Keyframed { keys, world_from_collider } => {
                let (position, velocity) = keyframed(keys, time);
                Pose { position, world_from_collider: *world_from_collider, velocity, angular_velocity: DVec3::ZERO }
            }
        }
    }
}

/// Position and velocity on a piecewise linear path; at rest outside of its keys.
fn keyframed(keys: &[(f64, DVec3)], time: f64) -> (DVec3, DVec3) {
    let next = keys.partition_point(|&(t, _)| t <= time);
    match (next.checked_sub(1).map(|i| keys[i]), keys.get(next)) {
        (Some((t0, p0)), Some(&(t1, p1))) => {
            let velocity = (p1 - p0) / (t1 - t0);
            (p0 + velocity * (time - t0), velocity)
        }
        (Some((_, p)), None) | (None, Some(&(_, p))) => (p, DVec3::ZERO),
        (None, None) => (DVec3::ZERO, DVec3::ZERO),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keyframes_move_linearly_and_rest_outside() {
        let keys = vec![(1.0, DVec3::ZERO), (3.0, DVec3::X)];
        let path = ColliderPath::Keyframed { keys, world_from_collider: DQuat::IDENTITY };
        assert_eq!(path.pose(0.0).velocity, DVec3::ZERO);
        assert_eq!(path.pose(2.0).position, DVec3::X * 0.5);
        assert_eq!(path.pose(2.0).velocity, DVec3::X * 0.5);
        assert_eq!(path.pose(9.0).position, DVec3::X);
        assert_eq!(path.pose(9.0).velocity, DVec3::ZERO);
    }
}
