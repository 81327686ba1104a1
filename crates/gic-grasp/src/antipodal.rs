//! Where to grip: two places of the surface that face each other (an antipodal pair).
//!
//! A pair can be held with friction mu where the line between its places lies within both friction cones: no more than
//! atan(mu) from either normal (Nguyen 1988). Among such pairs the one wins whose normals lie best along the line,
//! whose line passes nearest to the centre of mass (weight then turns the object least in the grip), and around which
//! the surface is flat.

use gic_geometry::outward_normals;
use glam::DVec3;

/// About so many places of the surface are tried, each with all others.
const MAX_CANDIDATES: usize = 1200;
/// Outward normals are shorter inside: from this length on a particle belongs to the surface.
const MIN_SURFACE_NORMAL: f32 = 0.7;
/// Largest angle between the grip's line and the horizontal [rad]: beyond, one pad would have to reach under the
/// object.
const MAX_TILT_RAD: f64 = 0.5;

/// A line to grip along.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct GripLine {
    /// Half-way between the two places [m].
    pub(super) middle: DVec3,
    /// Unit vector from one to the other.
    pub(super) direction: DVec3,
}

/// The best line for pads of half a side `reach` [m] on matter of particles `spacing` [m] apart; at least `width` [m]
/// of matter along it. `None` where no pair can be held.
pub(super) fn search(
    positions: &[DVec3],
    spacing: f64,
    up: DVec3,
    friction: f64,
    width: f64,
    reach: f64,
) -> Option<GripLine> {
    let points: Vec<[f32; 3]> = positions.iter().map(|p| p.as_vec3().to_array()).collect();
    let normals = outward_normals(&points, spacing);
    let length = |n: &[f32; 3]| n.iter().map(|x| x * x).sum::<f32>().sqrt();
    let surface: Vec<(DVec3, DVec3)> = (0..positions.len())
        .filter(|&i| length(&normals[i]) >= MIN_SURFACE_NORMAL)
        .map(|i| (positions[i], DVec3::from(normals[i].map(f64::from)).normalize()))
        .collect();
    let centre = positions.iter().sum::<DVec3>() / positions.len().max(1) as f64;
    let spread = positions.iter().map(|p| p.distance_squared(centre)).sum::<f64>() / positions.len().max(1) as f64;
    let places: Vec<(DVec3, DVec3, DVec3)> = surface
        .iter()
        .step_by(surface.len().div_ceil(MAX_CANDIDATES).max(1))
        .map(|&(p, n)| (p, n, mean_normal(&surface, p, n, reach, spacing)))
        .collect();
    let cone = friction.atan().cos();
    let mut best: Option<(f64, GripLine)> = None;
    for (i, &(p, n, patch_p)) in places.iter().enumerate() {
        for &(q, m, patch_q) in &places[i + 1..] {
            let across = q - p;
            let Some(direction) = across.try_normalize() else { continue };
            let (a, b) = (-n.dot(direction), m.dot(direction));
            // A particle ends half a spacing outside of its centre, at either end.
            let wide = across.length() + spacing >= width;
            if a < cone || b < cone || !wide || direction.dot(up).abs() > MAX_TILT_RAD.sin() {
                continue;
            }
            let middle = 0.5 * (p + q);
            let arm = (centre - middle).reject_from_normalized(direction).length_squared();
            let score = a * b * patch_p.length() * patch_q.length() * (-arm / spread.max(f64::MIN_POSITIVE)).exp();
            if best.is_none_or(|(found, _)| score > found) {
                // The pads lie flat on what is under them; the two particles are off the line by up to their spacing.
                let direction = (patch_q - patch_p).try_normalize().unwrap_or(direction);
                best = Some((score, GripLine { middle, direction }));
            }
        }
    }
    best.map(|(_, line)| line)
}

/// Mean normal of the surface under a pad: of length 1 where it is flat.
fn mean_normal(surface: &[(DVec3, DVec3)], centre: DVec3, normal: DVec3, reach: f64, spacing: f64) -> DVec3 {
    let under = surface.iter().filter(|(p, n)| {
        p.distance_squared(centre) <= reach * reach
            && (p - centre).dot(normal).abs() <= 2.0 * spacing
            && n.dot(normal) > 0.0
    });
    let (sum, count) = under.fold((DVec3::ZERO, 0usize), |(sum, count), (_, n)| (sum + n, count + 1));
    sum / count.max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use gic_twin::matter::{Solid, SolidKind};

    fn lattice(kind: SolidKind, rotation_deg: [f64; 3]) -> Vec<DVec3> {
        Solid { kind, centre_m: [0.3, 0.2, 0.1], rotation_deg }.sample(0.005)
    }

    #[test]
    fn a_turned_box_is_gripped_across_its_faces() {
        let positions = lattice(SolidKind::Box { size_m: [0.05, 0.04, 0.12] }, [0.0, 30.0, 0.0]);
        let line = search(&positions, 0.005, DVec3::Y, 0.5, 0.03, 0.02).unwrap();
        let turn = gic_twin::rotation([0.0, 30.0, 0.0]);
        let along = (line.direction.dot(turn * DVec3::X)).abs().max(line.direction.dot(turn * DVec3::Z).abs());
        assert!(along > 4f64.to_radians().cos(), "{line:?}");
        assert!(line.middle.distance(DVec3::new(0.3, 0.2, 0.1)) < 0.015, "{line:?}");
    }

    #[test]
    fn a_ball_is_gripped_through_its_centre_and_level() {
        let positions = lattice(SolidKind::Sphere { radius_m: 0.05 }, [0.0; 3]);
        let line = search(&positions, 0.005, DVec3::Y, 0.5, 0.06, 0.015).unwrap();
        assert!(line.direction.y.abs() <= MAX_TILT_RAD.sin());
        assert!(line.middle.distance(DVec3::new(0.3, 0.2, 0.1)) < 0.01, "{line:?}");
    }

    #[test]
    fn without_friction_nothing_tapered_is_gripped_and_nothing_is_wider_than_it_is() {
        let positions = lattice(SolidKind::Box { size_m: [0.05, 0.04, 0.05] }, [0.0; 3]);
        assert_eq!(search(&positions, 0.005, DVec3::Y, 0.5, 0.2, 0.02), None);
    }
}
