//! Places on the surface: which of them pictures tell, how certain they are, and whether they are edges or notches.

use gic_geometry::Neighbours;
use glam::DVec3;

use crate::Input;
use crate::forward::shape::Scale;
use crate::forward::surface_membership::memberships;
use crate::tuning::SurfaceTuning;

/// A place on the surface.
pub(crate) struct Anchor {
    pub position: DVec3,
    pub normal: DVec3,
    /// Whether a picture tells where it is.
    pub is_told: bool,
    /// Of its displacement along the normal [m].
    pub deviation: f64,
    /// Over which displacements are correlated, the further the longer from what is told [m].
    pub correlation_length: f64,
    /// How much emptier its vicinity is than that of a flat face, twice the share of a ball: positive at edges,
    /// negative in notches.
    pub bluntness: f64,
}

/// Outward directions of the particles on the surface, `None` inside.
pub(crate) fn normals(input: &Input, (spacing, tuning): (f64, &SurfaceTuning)) -> Vec<Option<DVec3>> {
    let positions: Vec<[f32; 3]> = input.positions.iter().map(|p| p.as_vec3().to_array()).collect();
    let memberships = memberships(&positions, tuning.neighbourhood_spacings * spacing, tuning);
    memberships.iter().map(|membership| membership.is_surface().then_some(membership.outward)).collect()
}

/// Places on the surface, one per cell; `normals` are those of the particles.
pub(crate) fn anchors(input: &Input, normals: &[Option<DVec3>], scale: Scale) -> Vec<Anchor> {
    let Scale { spacing, error_m, tuning, .. } = scale;
    let tree = Neighbours::new(&input.positions, spacing);
    let side = tuning.anchor_spacing_spacings * spacing;
    let mut cells = std::collections::BTreeMap::<[i64; 3], (f64, usize)>::new();
    for (i, p) in input.positions.iter().enumerate().filter(|(i, _)| normals[*i].is_some()) {
        let scaled = *p / side;
        let off = (scaled - scaled.floor() - 0.5).length_squared();
        let best = cells.entry(scaled.floor().to_array().map(|c| c as i64)).or_insert((f64::INFINITY, 0));
        if off < best.0 {
            *best = (off, i);
        }
    }
    let chosen: Vec<usize> = cells.into_values().map(|(_, i)| i).collect();
    let is_told = |i: usize| input.doubts.get(i).is_none_or(|doubt| *doubt < 0.5);
    let told: Vec<DVec3> = chosen.iter().filter(|i| is_told(**i)).map(|i| input.positions[*i]).collect();
    let centre = input.centre();
    let to_told = |p: DVec3| told.iter().map(|q| q.distance(p)).reduce(f64::min).unwrap_or(p.distance(centre));
    let ball = 8.0 / 15.0 * std::f64::consts::PI * tuning.bluntness_radius_spacings.powi(3);
    let bluntness = |p: DVec3| {
        let (radius, mut full) = (tuning.bluntness_radius_spacings * spacing, 0.0);
        tree.within(p, radius, |squared, _, _| full += 1.0 - squared / (radius * radius));
        2.0 * (bluntness_of_flat(tuning.bluntness_radius_spacings) - full / ball)
    };
    chosen
        .into_iter()
        .map(|i| {
            let (position, normal, is_told) = (input.positions[i], normals[i].unwrap_or(DVec3::Y), is_told(i));
            let distance = to_told(position);
            // Untold, it may lie anywhere up to as far in or out as what is told is away: a uniform distribution.
            let deviation = error_m.hypot(distance / 3f64.sqrt());
            let correlation_length = (tuning.correlation_length_spacings * spacing).hypot(distance);
            Anchor { position, normal, is_told, deviation, correlation_length, bluntness: bluntness(position) }
        })
        .collect()
}

/// Share of a ball of `radius` [particle spacings] around a particle of a flat face that is full, where the outermost
/// particles lie half a spacing deep and a point counts by 1 - (d / radius)^2: half of it, and a layer half a spacing
/// thick at its middle.
fn bluntness_of_flat(radius: f64) -> f64 {
    0.5 + 15.0 / 16.0 * 0.5 / radius
}
