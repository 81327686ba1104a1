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

    /// Where a pose that was `before` at one moment and is this one at the next goes.
    pub fn onwards(self, before: Pose) -> Pose {
        let turn = self.turn * before.turn.transpose();
        Pose { turn: turn * self.turn, shift: 2.0 * self.shift - before.shift }
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
        /// A steady drift and turn goes on as it is.
        #[test]
        fn a_steady_motion_goes_on(
            amounts in prop::array::uniform6(-0.3f64..0.3),
            point in prop::array::uniform3(-1.0f64..1.0),
        ) {
            let (step, centre) = (Pose::small(amounts, 1.0), DVec3::new(0.2, -0.1, 0.4));
            let (once, twice) = (step, step.then(step));
            let (found, wanted) = (twice.onwards(once), twice.then(step));
            let off = found.moved(point.into(), centre).distance(wanted.moved(point.into(), centre));
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
