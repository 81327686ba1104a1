//! A plane with a free side.

use glam::DVec3;

/// A plane, one side of which is free: ground, for example.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// A point of the plane [m].
    pub point: DVec3,
    /// Unit normal towards the free side.
    pub normal: DVec3,
}

impl Plane {
    /// Height of a point [m] above the plane, normal . (x - point) [m]: positive on the free side.
    #[inline]
    pub fn height(&self, x: DVec3) -> f64 {
        self.normal.dot(x - self.point)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn heights_are_positive_on_the_free_side() {
        let plane = Plane { point: DVec3::new(0.5, 0.2, 0.0), normal: DVec3::new(0.6, 0.8, 0.0) };
        assert!((plane.height(plane.point + 0.3 * plane.normal + DVec3::Z) - 0.3).abs() < 1e-15);
        assert!((plane.height(DVec3::ZERO) + 0.46).abs() < 1e-15);
    }
}
