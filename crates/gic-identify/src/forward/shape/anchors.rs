//! Places on the surface: which of them a camera sees, how certain they are, and whether they are edges or notches.

use gic_geometry::Neighbours;
use glam::DVec3;
use rayon::prelude::*;

use crate::Input;
use crate::forward::surface_membership::memberships;
use crate::tuning::{ShapeTuning, SurfaceTuning};

/// A place on the surface.
pub(crate) struct Anchor {
    pub position: DVec3,
    pub normal: DVec3,
    pub seen: bool,
    pub deviation: f64,
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
pub(crate) fn anchors(input: &Input, normals: &[Option<DVec3>], (spacing, tuning): (f64, &ShapeTuning)) -> Vec<Anchor> {
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
    let places: Vec<(DVec3, DVec3, bool)> = chosen
        .into_par_iter()
        .map(|i| {
            let (position, normal) = (input.positions[i], normals[i].unwrap_or(DVec3::Y));
            let seen = input.cameras.iter().any(|camera| {
                let direction = (camera.centre - position).normalize_or_zero();
                let from = position + 2.0 * spacing * normal;
                normal.dot(direction) > tuning.least_facing_cosine && is_free(&tree, from, camera.centre, spacing)
            });
            (position, normal, seen)
        })
        .collect();
    let seen: Vec<DVec3> = places.iter().filter(|(.., seen)| *seen).map(|(p, ..)| *p).collect();
    let to_seen = |p: DVec3| seen.iter().map(|q| q.distance(p)).fold(f64::INFINITY, f64::min);
    let ball = 8.0 / 15.0 * std::f64::consts::PI * tuning.bluntness_radius_spacings.powi(3);
    let bluntness = |p: DVec3| {
        let (radius, mut full) = (tuning.bluntness_radius_spacings * spacing, 0.0);
        tree.within(p, radius, |squared, _, _| full += 1.0 - squared / (radius * radius));
        2.0 * (bluntness_of_flat(tuning.bluntness_radius_spacings) - full / ball)
    };
    let deviation = |p: DVec3, is_seen: bool| {
        if is_seen {
            tuning.seen_deviation_spacings * spacing
        } else {
            tuning.unseen_deviation_spacings * spacing + tuning.unseen_deviation_per_distance * to_seen(p)
        }
    };
    places
        .into_iter()
        .map(|(position, normal, seen)| {
            let (deviation, bluntness) = (deviation(position, seen), bluntness(position));
            Anchor { position, normal, seen, deviation, bluntness }
        })
        .collect()
}

/// Share of a ball of `radius` [particle spacings] around a particle of a flat face that is full, where the outermost
/// particles lie half a spacing deep and a point counts by 1 - (d / radius)^2: half of it, and a layer half a spacing
/// thick at its middle.
fn bluntness_of_flat(radius: f64) -> f64 {
    0.5 + 15.0 / 16.0 * 0.5 / radius
}

/// Whether a ray that starts two spacings off the surface reaches the camera without coming as near to a particle as
/// one.
fn is_free(body: &Neighbours, from: DVec3, camera: DVec3, spacing: f64) -> bool {
    let (length, direction) = (from.distance(camera), (camera - from).normalize_or_zero());
    let mut travelled = 0.0;
    while travelled < length {
        let [(squared, _)] = body.nearest::<1>(from + travelled * direction);
        let beyond = squared.sqrt() - spacing;
        if beyond < 0.0 {
            return false;
        }
        // Nothing is nearer than that; one spacing is too short to pass through the body.
        travelled += beyond.max(spacing);
    }
    true
}
