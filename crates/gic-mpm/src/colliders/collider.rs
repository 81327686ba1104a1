//! Rigid obstacles at one moment: what a point near them meets.

use glam::{DQuat, DVec3};

use super::contact::Contact;
use super::path::{ColliderPath, Pose};
use super::shape::Primitive;

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

impl Collider {
    /// The plane through a point [m] with a unit normal, at rest; solid behind it.
    pub fn plane(point: DVec3, normal: DVec3, contact: Contact) -> Self {
        let path = ColliderPath::Uniform {
            position_m: point,
            world_from_collider: DQuat::IDENTITY,
            velocity_m_s: DVec3::ZERO,
            angular_velocity_rad_s: DVec3::ZERO,
        };
        Self { primitive: Primitive::HalfSpace { normal }, path, contact }
    }

    /// Direction away from the solid side of a plane at time 0; `None` of other shapes.
    pub fn normal(&self) -> Option<DVec3> {
        let Primitive::HalfSpace { normal } = self.primitive else { return None };
        Some(self.path.pose(0.0).world_from_collider * normal)
    }

    /// Signed distance [m] from a point of the world [m] at a time [s]; negative inside.
    pub fn signed_distance(&self, point: DVec3, time: f64) -> f64 {
        let pose = self.path.pose(time);
        self.primitive.signed_distance(pose.world_from_collider.inverse() * (point - pose.position)).0
    }

    /// The obstacle as it is at a time [s]; points up to `tolerance` [m] outside count as inside.
    pub(crate) fn posed(&self, time: f64, tolerance: f64) -> PosedCollider<'_> {
        let pose = self.path.pose(time);
        PosedCollider { collider: self, pose, collider_from_world: pose.world_from_collider.inverse(), tolerance }
    }
}

/// An obstacle at one moment.
pub(crate) struct PosedCollider<'a> {
    pub(crate) collider: &'a Collider,
    pub(crate) pose: Pose,
    collider_from_world: DQuat,
    /// Points this far outside [m] count as inside.
    tolerance: f64,
}

/// The surface as a point inside an obstacle meets it.
pub(crate) struct Touch {
    /// Outward unit normal.
    pub(crate) normal: DVec3,
    /// Velocity of the obstacle at the point [m/s].
    pub(crate) wall_velocity: DVec3,
}

impl PosedCollider<'_> {
    /// Every point nearer than this [m] to a point of the world [m] is outside; zero or less where that may be inside
    /// itself.
    pub(crate) fn clearance(&self, point: DVec3) -> f64 {
        // Twice the tolerance: half of it for rounding.
        self.collider.primitive.signed_distance(self.collider_from_world * (point - self.pose.position)).0
            - 2.0 * self.tolerance
    }

    /// How deep [m] a point of the world [m] is inside; zero or less outside.
    pub(crate) fn depth(&self, point: DVec3) -> f64 {
        self.collider.primitive.depth(self.collider_from_world * (point - self.pose.position))
    }

    /// The contact of a point of the world [m], if it is inside.
    pub(crate) fn touch(&self, point: DVec3) -> Option<Touch> {
        let arm = point - self.pose.position;
        let (distance, normal) = self.collider.primitive.signed_distance(self.collider_from_world * arm);
        (distance <= self.tolerance).then(|| Touch {
            normal: self.pose.world_from_collider * normal,
            wall_velocity: self.pose.velocity + self.pose.angular_velocity.cross(arm),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::shape::one_of_each;
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn nothing_is_touched_within_the_clearance(
            p in proptest::array::uniform3(-1.5f64..1.5),
            way in proptest::array::uniform3(-1.0f64..1.0),
            shape in 0usize..6,
        ) {
            let path = ColliderPath::Uniform {
                position_m: DVec3::new(0.1, -0.2, 0.3),
                world_from_collider: DQuat::from_rotation_z(0.4),
                velocity_m_s: DVec3::X,
                angular_velocity_rad_s: DVec3::Y,
            };
            let collider = Collider { primitive: one_of_each()[shape], path, contact: Contact::Sticky };
            let tolerance = 1e-6;
            let posed = collider.posed(0.5, tolerance);
            let (p, way) = (DVec3::from(p), DVec3::from(way));
            let clearance = posed.clearance(p);
            if clearance > 0.0 {
                prop_assert!(posed.touch(p + way.normalize_or_zero() * clearance * 0.999).is_none());
            } else {
                prop_assert!(posed.touch(p).is_some() || clearance > -4.0 * tolerance);
            }
        }
    }

    #[test]
    fn a_spinning_obstacle_carries_its_surface() {
        let collider = Collider {
            primitive: Primitive::Sphere { radius_m: 1.0 },
            path: ColliderPath::Uniform {
                position_m: DVec3::ZERO,
                world_from_collider: DQuat::IDENTITY,
                velocity_m_s: DVec3::X,
                angular_velocity_rad_s: DVec3::Z,
            },
            contact: Contact::Sticky,
        };
        let touch = collider.posed(0.5, 0.0).touch(DVec3::new(0.5, 0.5, 0.0)).unwrap();
        assert!((touch.wall_velocity - DVec3::new(0.5, 0.0, 0.0)).length() < 1e-12);
        assert!(collider.posed(0.0, 0.0).touch(DVec3::new(1.1, 0.0, 0.0)).is_none());
    }
}
