//! Where the body of a moment lies, beside where its motion takes it.

use glam::{DMat3, DVec3};

/// A turn about the body's centre and a shift, on top of the motion.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pose {
    pub(super) turn: DMat3,
    pub(super) shift: DVec3,
}

impl Default for Pose {
    fn default() -> Pose {
        Pose { turn: DMat3::IDENTITY, shift: DVec3::ZERO }
    }
}

impl Pose {
    /// Where a point of a body around `centre` goes.
    pub(super) fn moved(&self, point: DVec3, centre: DVec3) -> DVec3 {
        self.turn * (point - centre) + centre + self.shift
    }
}
