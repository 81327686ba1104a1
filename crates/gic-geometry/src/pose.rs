//! Where a body lies beside where its motion takes it.

use glam::{DMat3, DQuat, DVec3};

/// A turn about a body's centre and a shift, on top of its motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pose {
    /// The turn.
    pub turn: DMat3,
    /// The shift [m].
    pub shift: DVec3,
}

impl Default for Pose {
    fn default() -> Pose {
        Pose { turn: DMat3::IDENTITY, shift: DVec3::ZERO }
    }
}

impl Pose {
    /// A small one: a shift along x, y, z [m], and a turn about these axes that moves places `size` [m] from the centre
    /// by as much as it says [m], so that all six are alike.
    pub fn small([x, y, z, about_x, about_y, about_z]: [f64; 6], size: f64) -> Pose {
        let turn = DVec3::new(about_x, about_y, about_z) / size;
        Pose { turn: DMat3::from_quat(DQuat::from_scaled_axis(turn)), shift: DVec3::new(x, y, z) }
    }

    /// This one first, then `next`.
    pub fn then(self, next: Pose) -> Pose {
        Pose { turn: next.turn * self.turn, shift: self.shift + next.shift }
    }

    /// Where a point of a body around `centre` goes.
    pub fn moved(&self, point: DVec3, centre: DVec3) -> DVec3 {
        self.turn * (point - centre) + centre + self.shift
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// One after the other moves a point as both do.
        #[test]
        fn poses_follow_each_other(
            first in prop::array::uniform6(-0.3f64..0.3),
            next in prop::array::uniform6(-0.3f64..0.3),
            point in prop::array::uniform3(-1.0f64..1.0),
        ) {
            let (first, next) = (Pose::small(first, 1.0), Pose::small(next, 1.0));
            let (point, centre) = (DVec3::from(point), DVec3::new(0.2, -0.1, 0.4));
            let wanted = next.moved(first.moved(point, centre), centre + first.shift);
            let off = first.then(next).moved(point, centre).distance(wanted);
            prop_assert!(off < 1e-12, "{off}");
        }

        /// A turn by a small angle moves a point at right angles to its axis by the angle times the distance.
        #[test]
        fn a_small_turn_moves_as_it_says(amount in 1e-6f64..1e-4, size in 0.1f64..2.0) {
            let moved = Pose::small([0.0, 0.0, 0.0, 0.0, 0.0, amount], size).moved(DVec3::X * size, DVec3::ZERO);
            prop_assert!(moved.distance(DVec3::new(size, amount, 0.0)) < 1e-3 * amount);
        }
    }
}
