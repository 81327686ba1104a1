//! A hand that holds a part of the matter and pulls it.

use glam::DVec3;

use crate::tuning::{GRAB_REACH_SPACINGS, HAND_RADIUS_SHARE, HAND_RATE_HZ, HAND_SPEED_SIDES_HZ};

/// What a hand holds, and where it pulls it to.
pub(crate) struct Hand {
    /// Particles, and how firmly each is held, in (0, 1].
    held: Vec<(usize, f64)>,
    /// Where their centre shall be [m].
    pub(crate) target: DVec3,
    /// Highest speed [m/s].
    max_speed: f64,
}

impl Hand {
    /// Grabs around the foremost particle that a ray from `eye` [m] along the unit vector `direction` meets; `None`
    /// where it meets none. `spacing` is that of the particles [m], `side` the largest of the body [m].
    pub(crate) fn grab(positions: &[DVec3], eye: DVec3, direction: DVec3, spacing: f64, side: f64) -> Option<Self> {
        let depth = |p: &DVec3| (*p - eye).dot(direction);
        let beside = |p: &DVec3| (*p - eye - depth(p) * direction).length();
        let met = positions.iter().filter(|p| depth(p) > 0.0 && beside(p) < GRAB_REACH_SPACINGS * spacing);
        let first = *met.min_by(|a, b| depth(a).total_cmp(&depth(b)))?;
        let radius = HAND_RADIUS_SHARE * side;
        let firmness = |p: &DVec3| (1.0 - (p.distance(first) / radius).powi(2)).max(0.0).powi(2);
        let held: Vec<(usize, f64)> =
            positions.iter().map(firmness).enumerate().filter(|(_, firmness)| *firmness > 0.0).collect();
        let mut hand = Self { held, target: first, max_speed: HAND_SPEED_SIDES_HZ * side };
        hand.target = hand.centre(|p| positions[p]);
        Some(hand)
    }

    /// Centre of what is held [m].
    fn centre(&self, position: impl Fn(usize) -> DVec3) -> DVec3 {
        let moment: DVec3 = self.held.iter().map(|&(p, firmness)| firmness * position(p)).sum();
        moment / self.held.iter().map(|(_, firmness)| firmness).sum::<f64>()
    }

    /// The particles that the hand moves, with their new velocities [m/s]: what is held goes to the target.
    pub(crate) fn pulled<'a>(
        &'a self,
        positions: &[DVec3],
        velocities: &'a [DVec3],
    ) -> impl Iterator<Item = (usize, DVec3)> + 'a {
        let way = self.target - self.centre(|p| positions[p]);
        let wanted = (HAND_RATE_HZ * way).clamp_length_max(self.max_speed);
        self.held.iter().map(move |&(p, firmness)| (p, velocities[p].lerp(wanted, firmness)))
    }
}
