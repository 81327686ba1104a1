//! Rigid obstacles: what they are, how they move, how they touch.

use glam::{DQuat, DVec3};

/// What happens to the grid velocity inside an obstacle, relative to the obstacle's own velocity.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Contact {
    /// No relative path.
    Sticky,
    /// No relative path along the normal in either direction; Coulomb friction along the surface.
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
    /// Axis-aligned box around the origin of which only the face towards +x acts: inside, the normal is always +x. A finger's pad presses
    /// with its face; a box pushes what has sunk in near an edge, or deep, out at the side.
    Pad {
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
pub enum ColliderPath {
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
    /// Where it is over time.
    pub path: ColliderPath,
    /// Its contact law.
    pub contact: Contact,
}

/// Nodes this far outside still count as inside [m], so that nodes on the surface do despite rounding (as in the reference).
const SKIN_M: f64 = 1e-6;

/// Where an obstacle is at one moment.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pose {
    pub(crate) position: DVec3,
    pub(crate) rotation: DQuat,
    pub(crate) velocity: DVec3,
    pub(crate) angular_velocity: DVec3,
}

impl ColliderPath {
    /// The pose at a time [s].
    pub(crate) fn pose(&self, time: f64) -> Pose {
        match self {
            Self::Uniform { position_m, rotation, velocity_m_s, angular_velocity_rad_s } => Pose {
                position: *position_m + *velocity_m_s * time,
                rotation: DQuat::from_scaled_axis(*angular_velocity_rad_s * time) * *rotation,
                velocity: *velocity_m_s,
                angular_velocity: *angular_velocity_rad_s,
            },
            Self::Keyframed { keys, rotation } => {
                let (position, velocity) = keyframed(keys, time);
                Pose { position, rotation: *rotation, velocity, angular_velocity: DVec3::ZERO }
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

impl Primitive {
    /// Signed distance [m] of a point in the shape's own frame (negative inside) and its gradient, the outward unit normal.
    fn signed_distance(&self, p: DVec3) -> (f64, DVec3) {
        match *self {
            Self::HalfSpace { normal } => (p.dot(normal), normal),
            Self::Sphere { radius_m } => {
                let length = p.length();
                (length - radius_m, unit(p, length))
            }
            Self::Box { half_size_m } => box_distance(p, half_size_m),
            Self::Pad { half_size_m } => match box_distance(p, half_size_m) {
                outside if outside.0 > SKIN_M => outside,
                _ => (p.x - half_size_m.x, DVec3::X),
            },
            Self::Cylinder { radius_m, half_height_m } => {
                let radial = DVec3::new(p.x, 0.0, p.z);
                let length = radial.length();
                profile_distance(
                    length - radius_m,
                    p.y.abs() - half_height_m,
                    unit(radial, length),
                    DVec3::Y * p.y.signum(),
                )
            }
            Self::Capsule { radius_m, half_height_m } => {
                let from_axis = p - DVec3::Y * p.y.clamp(-half_height_m, half_height_m);
                let length = from_axis.length();
                (length - radius_m, unit(from_axis, length))
            }
        }
    }
}

/// `v / length`, or up where the direction is undefined.
fn unit(v: DVec3, length: f64) -> DVec3 {
    if length > 1e-12 { v / length } else { DVec3::Y }
}

fn box_distance(p: DVec3, half_size: DVec3) -> (f64, DVec3) {
    let beyond = p.abs() - half_size;
    let outside = beyond.max(DVec3::ZERO);
    if outside != DVec3::ZERO {
        let length = outside.length();
        return (length, outside * p.signum() / length);
    }
    let axis = if beyond.x >= beyond.y && beyond.x >= beyond.z {
        DVec3::X
    } else if beyond.y >= beyond.z {
        DVec3::Y
    } else {
        DVec3::Z
    };
    (beyond.max_element(), axis * p.signum())
}

/// Distance to a region bounded by two perpendicular faces: `a` beyond the face with normal `a_normal`, `b` likewise.
fn profile_distance(a: f64, b: f64, a_normal: DVec3, b_normal: DVec3) -> (f64, DVec3) {
    if a > 0.0 && b > 0.0 {
        let length = a.hypot(b);
        (length, (a_normal * a + b_normal * b) / length)
    } else if a >= b {
        (a, a_normal)
    } else {
        (b, b_normal)
    }
}

impl Collider {
    /// The plane through a point [m] with a unit normal, at rest; solid behind it.
    pub fn plane(point: DVec3, normal: DVec3, contact: Contact) -> Self {
        let path = ColliderPath::Uniform {
            position_m: point,
            rotation: DQuat::IDENTITY,
            velocity_m_s: DVec3::ZERO,
            angular_velocity_rad_s: DVec3::ZERO,
        };
        Self { primitive: Primitive::HalfSpace { normal }, path, contact }
    }

    /// Signed distance [m] from a point of the world [m] at a time [s]; negative inside.
    pub fn signed_distance(&self, point: DVec3, time: f64) -> f64 {
        let pose = self.path.pose(time);
        self.primitive.signed_distance(pose.rotation.inverse() * (point - pose.position)).0
    }

    /// The obstacle as it is at a time [s].
    pub(crate) fn posed(&self, time: f64) -> PosedCollider<'_> {
        let pose = self.path.pose(time);
        PosedCollider { collider: self, pose, to_local: pose.rotation.inverse() }
    }
}

/// An obstacle at one moment.
pub(crate) struct PosedCollider<'a> {
    pub(crate) collider: &'a Collider,
    pub(crate) pose: Pose,
    to_local: DQuat,
}

/// The surface as a point inside an obstacle meets it.
pub(crate) struct Touch {
    /// Outward unit normal.
    pub(crate) normal: DVec3,
    /// Velocity of the obstacle at the point [m/s].
    pub(crate) wall_velocity: DVec3,
}

impl PosedCollider<'_> {
    /// Every point nearer than this [m] to a point of the world [m] is outside; zero or less where that may be inside itself.
    pub(crate) fn clearance(&self, point: DVec3) -> f64 {
        // Twice the skin: half of it for rounding.
        self.collider.primitive.signed_distance(self.to_local * (point - self.pose.position)).0 - 2.0 * SKIN_M
    }

    /// The contact of a point of the world [m], if it is inside.
    pub(crate) fn touch(&self, point: DVec3) -> Option<Touch> {
        let arm = point - self.pose.position;
        let (distance, normal) = self.collider.primitive.signed_distance(self.to_local * arm);
        (distance <= SKIN_M).then(|| Touch {
            normal: self.pose.rotation * normal,
            wall_velocity: self.pose.velocity + self.pose.angular_velocity.cross(arm),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn shapes() -> [Primitive; 6] {
        [
            Primitive::HalfSpace { normal: DVec3::new(0.6, 0.8, 0.0) },
            Primitive::Sphere { radius_m: 0.7 },
            Primitive::Box { half_size_m: DVec3::new(0.3, 0.5, 0.8) },
            Primitive::Cylinder { radius_m: 0.4, half_height_m: 0.6 },
            Primitive::Capsule { radius_m: 0.3, half_height_m: 0.5 },
            Primitive::Pad { half_size_m: DVec3::new(0.3, 0.5, 0.8) },
        ]
    }

    proptest! {
        #[test]
        fn normal_is_the_gradient_of_the_distance(p in proptest::array::uniform3(-1.5f64..1.5), shape in 0usize..6) {
            let (shape, p, h) = (shapes()[shape], DVec3::from(p), 1e-6);
            let (distance, normal) = shape.signed_distance(p);
            let gradient = DVec3::from_array(DVec3::AXES.map(|axis| {
                (shape.signed_distance(p + axis * h).0 - shape.signed_distance(p - axis * h).0) / (2.0 * h)
            }));
            // On a medial axis, where the nearest face changes, there is no gradient.
            prop_assume!((gradient.length() - 1.0).abs() < 1e-6);
            prop_assert!((gradient - normal).length() < 1e-5);
            // Walking the distance along the normal reaches the surface from outside.
            if distance > 0.0 {
                let landed = shape.signed_distance(p - normal * distance).0;
                // Inside a pad only the depth below its face counts, also behind its sides.
                let is_pad = matches!(shape, Primitive::Pad { .. });
                prop_assert!(landed.abs() < 1e-9 || (landed < 0.0 && is_pad));
            }
        }
    }

    proptest! {
        #[test]
        fn nothing_is_touched_within_the_clearance(
            p in proptest::array::uniform3(-1.5f64..1.5),
            way in proptest::array::uniform3(-1.0f64..1.0),
            shape in 0usize..6,
        ) {
            let path = ColliderPath::Uniform {
                position_m: DVec3::new(0.1, -0.2, 0.3),
                rotation: DQuat::from_rotation_z(0.4),
                velocity_m_s: DVec3::X,
                angular_velocity_rad_s: DVec3::Y,
            };
            let collider = Collider { primitive: shapes()[shape], path, contact: Contact::Sticky };
            let posed = collider.posed(0.5);
            let (p, way) = (DVec3::from(p), DVec3::from(way));
            let reach = posed.clearance(p);
            if reach > 0.0 {
                prop_assert!(posed.touch(p + way.normalize_or_zero() * reach * 0.999).is_none());
            } else {
                prop_assert!(posed.touch(p).is_some() || reach > -4.0 * SKIN_M);
            }
        }
    }

    #[test]
    fn keyframes_move_linearly_and_rest_outside() {
        let keys = vec![(1.0, DVec3::ZERO), (3.0, DVec3::X)];
        let path = ColliderPath::Keyframed { keys, rotation: DQuat::IDENTITY };
        assert_eq!(path.pose(0.0).velocity, DVec3::ZERO);
        assert_eq!(path.pose(2.0).position, DVec3::X * 0.5);
        assert_eq!(path.pose(2.0).velocity, DVec3::X * 0.5);
        assert_eq!(path.pose(9.0).position, DVec3::X);
        assert_eq!(path.pose(9.0).velocity, DVec3::ZERO);
    }

    #[test]
    fn a_spinning_obstacle_carries_its_surface() {
        let collider = Collider {
            primitive: Primitive::Sphere { radius_m: 1.0 },
            path: ColliderPath::Uniform {
                position_m: DVec3::ZERO,
                rotation: DQuat::IDENTITY,
                velocity_m_s: DVec3::X,
                angular_velocity_rad_s: DVec3::Z,
            },
            contact: Contact::Sticky,
        };
        let touch = collider.posed(0.5).touch(DVec3::new(0.5, 0.5, 0.0)).unwrap();
        assert!((touch.wall_velocity - DVec3::new(0.5, 0.0, 0.0)).length() < 1e-12);
        assert!(collider.posed(0.0).touch(DVec3::new(1.1, 0.0, 0.0)).is_none());
    }
}
