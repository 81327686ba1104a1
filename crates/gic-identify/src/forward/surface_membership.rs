//! Which particles are on the surface of a body, and where its outside is.

use gic_geometry::{Surroundings, offsets};
use glam::DVec3;

use crate::tuning::SurfaceTuning;

/// From 0 below a threshold to 1 above it, with a continuous derivative; it takes the share `fade` of the threshold to
/// both sides.
pub(crate) fn faded(x: f64, threshold: f64, fade: f64) -> f64 {
    let t = (0.5 + 0.5 * (x / threshold - 1.0) / fade).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// How a particle belongs to the surface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SurfaceMembership {
    /// Away from the centre of its neighbours; of unit length.
    pub outward: DVec3,
    /// 0 for inner particles, 1 where the neighbours lie to one side, and smooth in between.
    pub share: f64,
}

impl SurfaceMembership {
    /// Whether it is more on the surface than inside.
    pub(crate) fn is_surface(&self) -> bool {
        self.share >= 0.5
    }
}

/// The membership of each particle, from its neighbours within `radius` [m]. It changes smoothly as particles move.
pub(crate) fn memberships(positions: &[[f32; 3]], radius: f64, tuning: &SurfaceTuning) -> Vec<SurfaceMembership> {
    let points: Vec<DVec3> = positions.iter().map(|p| glam::Vec3::from_array(*p).as_dvec3()).collect();
    let membership = |around: Surroundings| {
        let asymmetry = around.offset / around.weight;
        SurfaceMembership {
            outward: asymmetry.normalize_or(DVec3::Y),
            share: faded(asymmetry.length(), tuning.asymmetry, tuning.fade),
        }
    };
    offsets(&points, radius).into_iter().map(membership).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_differ_from_the_inside() {
        // A block of particles 10 mm apart.
        let place = |i: usize| 0.01 * DVec3::new((i % 20) as f64, (i / 20 % 16) as f64, (i / 320) as f64);
        let positions: Vec<DVec3> = (0..20 * 16 * 12).map(place).collect();
        let memberships = memberships(
            &positions.iter().map(|p| p.as_vec3().to_array()).collect::<Vec<_>>(),
            0.022,
            &SurfaceTuning::default(),
        );
        for (p, membership) in positions.iter().zip(memberships) {
            let from_face = p.min(DVec3::new(0.19, 0.15, 0.11) - *p).min_element();
            let depth = (from_face / 0.01).round();
            assert!(depth > 0.5 || membership.share > 0.99, "{p} {membership:?}");
            assert!(depth < 1.5 || membership.share < 0.01, "{p} {membership:?}");
        }
    }
}
