//! The first impact of an elastic body: how deep it is, and the linear law that is compressed as much.

use glam::DVec3;

use super::super::{ExportBody, lame};
use crate::twin::{Obstacle, ObstacleShape};

/// Compressions, as shares of the length, between which that of an impact is sought.
const COMPRESSED: [f64; 2] = [0.05, 1.0];

/// Energy per volume [Pa] with which the body meets the first half space that it falls on: kinetic energy at the start
/// and the work of gravity; 0 where it falls on none.
pub(super) fn impact_energy_pa(body: &ExportBody) -> f64 {
    let twin = body.twin();
    let gravity = DVec3::from(twin.gravity_m_s2);
    let fall = |obstacle: &Obstacle| {
        let ObstacleShape::HalfSpace { point_m, normal } = obstacle.shape else { return None };
        let turn = crate::rotation(obstacle.rotation_deg.unwrap_or_default());
        let normal = turn * DVec3::from(normal).normalize();
        let slope = -normal.dot(gravity.normalize_or_zero());
        let heights = body.particles().iter().map(|p| (*p - DVec3::from(point_m)).dot(normal));
        (slope > 0.0).then(|| heights.fold(f64::INFINITY, f64::min).max(0.0) / slope)
    };
    let drop = twin.colliders.iter().filter_map(fall).fold(f64::INFINITY, f64::min);
    if !drop.is_finite() {
        return 0.0;
    }
    let speed_squared = DVec3::from(twin.initial_velocity_m_s).length_squared() + 2.0 * gravity.length() * drop;
    0.5 * twin.density_kg_m3 * speed_squared
}

/// Energy per volume [Pa] of the neo-Hookean law compressed to the share `s` of its length without widening:
/// `mu (s^2 - 1) / 2 - mu ln s + lambda (ln s)^2 / 2`.
fn stored_pa(s: f64, moduli: [f64; 2]) -> f64 {
    let [mu, lambda] = lame(moduli);
    0.5 * mu * (s * s - 1.0) - mu * s.ln() + 0.5 * lambda * s.ln().powi(2)
}

/// By which share of its length the neo-Hookean law is compressed, without widening, when it stores an energy per
/// volume `w` [Pa].
pub(super) fn impact_compression(w: f64, moduli: [f64; 2]) -> f64 {
    let [mut low, mut high] = COMPRESSED;
    // The stored energy falls from the most compressed to the uncompressed.
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        *(if stored_pa(middle, moduli) > w { &mut low } else { &mut high }) = middle;
    }
    1.0 - low
}

/// By how much the modulus of a law that is linear in the stretch is raised so that it stores at a compression by the
/// share `e` of the length what the neo-Hookean law does: `(lambda + 2 mu) e^2 / 2` against [`stored_pa`].
pub(super) fn impact_factor(e: f64, moduli: [f64; 2]) -> f64 {
    let [mu, lambda] = lame(moduli);
    let linear = 0.5 * (lambda + 2.0 * mu) * e * e;
    // Where hardly anything is compressed, both laws are the same.
    if e < 1e-6 { 1.0 } else { (stored_pa(1.0 - e, moduli) / linear).max(1.0) }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_modulus_is_raised_for_a_hard_impact_and_not_for_a_soft_one() {
        let factor = |w: f64, moduli: [f64; 2]| impact_factor(impact_compression(w, moduli), moduli);
        assert_eq!(factor(0.0, [4e4, 0.3]), 1.0);
        assert!((factor(1.0, [4e6, 0.3]) - 1.0).abs() < 1e-2);
        let raised = factor(5600.0, [4.04e4, 0.322]);
        assert!(raised > 1.3 && raised < 1.45, "{raised}");
        // Without Poisson's ratio both energies are written down for one compression, to half the length.
        let mu = 0.5e4;
        let w = mu * (-0.375 + 2f64.ln());
        assert!((impact_compression(w, [1e4, 0.0]) - 0.5).abs() < 1e-9);
        assert!((factor(w, [1e4, 0.0]) - w / (mu * 0.25)).abs() < 1e-6);
    }
}
