//! Undersides: the boundary of the body where no view sees it.
//!
//! The largest body that agrees with all views hangs down in wedges below every part whose underside no camera sees. It
//! is bounded by rays that graze the body along the rim of what is seen, so the rim is true and what spans it is not.
//! Four steps find a better span:
//!
//! 1. What nobody sees reaches no further than what is seen: the convex hull of the seen boundary bounds it, to within
//!    what counts as seen.
//! 2. The boundary that no view sees is relaxed towards the smallest surface that spans the rim, inside the largest
//!    body, by filtering and sharpening in turn (motion by mean curvature: Merriman, Bence & Osher 1992). What is seen
//!    stays.
//! 3. The whole unseen boundary is moved along its normal. By how much is a compromise of two priors: the body keeps
//!    the volume it is known to have ([`FillSettings::volume`]), and undersides lie [`crate::UnseenTuning::lift`]
//!    above the relaxed surface.
//! 4. What lies close to where the boundary ends up is in doubt ([`crate::Filling::doubt`]).

use std::f64::consts::PI;

use gic_geometry::DensityField;
use glam::DVec3;
use rayon::prelude::*;

use super::coarse_to_fine::MEAN;
use crate::evidence::Evidence;
use crate::symmetry::direction;
use crate::tuning::Tuning;
use crate::{FillSettings, Unseen};

/// Half of the neighbours of a voxel: one of each pair of opposite directions.
const DIRECTIONS: [[i64; 3]; 13] = [
    [1, 0, 0],
    [0, 1, 0],
    [0, 0, 1],
    [1, 1, 0],
    [1, -1, 0],
    [1, 0, 1],
    [1, 0, -1],
    [0, 1, 1],
    [0, 1, -1],
    [1, 1, 1],
    [1, 1, -1],
    [1, -1, 1],
    [-1, 1, 1],
];

/// Puts the unseen boundary of the largest body where it is most likely. Returns how much each voxel's matter is in
/// doubt: 1 at and beyond the unseen boundary, falling linearly to 0 as far below it as it may move. Linear in the
/// number of voxels.
pub(crate) fn place_unseen(
    field: &mut DensityField,
    views: &[Evidence],
    inset: f64,
    settings: &FillSettings,
) -> Vec<f32> {
    let body: Vec<bool> = field.values.iter().map(|&v| f64::from(v) >= settings.th_min).collect();
    let (seen, share) = seen_boundary(field, &body, views, inset, settings);
    if share < settings.tuning.unseen.least_seen {
        return Vec::new();
    }
    let body = match settings.unseen {
        Unseen::Smooth => cut_to_hull_of_seen(field, body, &seen, settings),
        Unseen::Fill => body,
    };
    let furthest = furthest_move(settings) / field.spacing;
    let depths = depths_below_unseen(field, &body, &seen, furthest as f32, &settings.tuning);
    let level = match settings.unseen {
        Unseen::Smooth => likeliest_level(field, &depths, settings),
        Unseen::Fill => depths.iter().copied().fold(0.0, f32::min) - 0.5,
    };
    for (value, depth) in field.values.iter_mut().zip(&depths) {
        *value = value.min((0.5 + depth - level).clamp(0.0, 1.0));
    }
    let doubt = |(&depth, &body): (&f32, &bool)| {
        if body { (1.0 - (depth - level) / furthest as f32).clamp(0.0, 1.0) } else { 0.0 }
    };
    depths.iter().zip(&body).map(doubt).collect()
}

/// How far the unseen boundary is moved at most, and how deep below it matter is in doubt: two standard deviations [m].
fn furthest_move(settings: &FillSettings) -> f64 {
    2.0 * settings.tuning.unseen.boundary_deviation * settings.grid_spacing
}

/// Boundary this close to a rendered surface [m] is seen: so far the filters move it at most.
fn seen_within(field: &DensityField, settings: &FillSettings) -> f64 {
    settings.tuning.filling.filter_rounds as f64 * field.spacing
}

/// Voxels of the body that touch its outside where some view renders a surface, and the share of all that touch it of
/// which something is known: these and the ones on the ground. Of a body whose volume is not known, the ground is taken
/// for its underside.
fn seen_boundary(
    field: &DensityField,
    body: &[bool],
    views: &[Evidence],
    inset: f64,
    settings: &FillSettings,
) -> (Vec<bool>, f64) {
    let near = seen_within(field, settings);
    let on_ground = |point| settings.ground.is_some_and(|g| g.height(point) < near);
    let (seen, known): (Vec<bool>, Vec<Option<bool>>) = (0..body.len())
        .into_par_iter()
        .map(|i| {
            if !touches_outside(field, body, i) {
                return (false, None);
            }
            let point = field.centre(field.voxel(i));
            let normal = -field.gradient(point).normalize_or_zero();
            let seen = views.iter().any(|v| {
                normal.dot(v.direction_from(point)) > settings.tuning.facing_cosine
                    && v.evidence_at(point).is_some_and(|s| (f64::from(s.behind) + inset).abs() < near)
            });
            let grounded = on_ground(point);
            (seen || grounded && settings.volume.is_none(), Some(seen || grounded))
        })
        .unzip();
    let boundary = known.iter().flatten().count();
    let share = known.iter().flatten().filter(|&&k| k).count() as f64 / boundary.max(1) as f64;
    (seen, share)
}

/// Takes from a `body` what lies outside of the convex hull of what is `seen` of it. Returns what is left.
fn cut_to_hull_of_seen(field: &mut DensityField, body: Vec<bool>, seen: &[bool], settings: &FillSettings) -> Vec<bool> {
    let (seen, boundary) = (centres(field, |i| seen[i]), centres(field, |i| touches_outside(field, &body, i)));
    let reach = |points: &[DVec3], normal| points.iter().map(|p| p.dot(normal)).fold(f64::NEG_INFINITY, f64::max);
    let near = seen_within(field, settings);
    // As many as half the body needs so that planes of neighbouring directions lie no further apart.
    let count = (0.5 * PI * (0.5 * settings.size / near).powi(2)).ceil() as usize;
    let plane = |k: usize| {
        let normal = if k < count { direction(k, count) } else { -direction(k - count, count) };
        let offset = reach(&seen, normal);
        (offset.is_finite() && reach(&boundary, normal) > offset + near).then_some((normal, offset + near))
    };
    let planes: Vec<(DVec3, f64)> = (0..2 * count).into_par_iter().filter_map(plane).collect();
    let depth = |i: usize| {
        let point = field.centre(field.voxel(i));
        planes.iter().map(|(normal, offset)| offset - point.dot(*normal)).fold(f64::INFINITY, f64::min)
    };
    let within = |i: usize| if field.values[i] > 0.0 { (0.5 + depth(i) / field.spacing).clamp(0.0, 1.0) } else { 0.0 };
    let within: Vec<f64> = (0..body.len()).into_par_iter().map(within).collect();
    for (value, within) in field.values.iter_mut().zip(within) {
        *value = value.min(within as f32);
    }
    body.into_iter().zip(&field.values).map(|(body, value)| body && f64::from(*value) >= settings.th_min).collect()
}

/// Centres of the voxels that are chosen [m].
fn centres(field: &DensityField, is_chosen: impl Fn(usize) -> bool + Sync) -> Vec<DVec3> {
    (0..field.len()).into_par_iter().filter(|&i| is_chosen(i)).map(|i| field.centre(field.voxel(i))).collect()
}

/// Whether a voxel is of the body and one that shares a side with it is not.
fn touches_outside(field: &DensityField, body: &[bool], index: usize) -> bool {
    body[index] && sides(field, index).any(|j| !body[j])
}

/// The voxels that share a side with one.
fn sides(field: &DensityField, index: usize) -> impl Iterator<Item = usize> {
    DIRECTIONS[..3]
        .iter()
        .flat_map(move |&d| [1, -1].into_iter().filter_map(move |s| step(field, index, d.map(|c| s * c))))
}

/// The neighbour of a voxel in a direction; `None` outside the grid.
fn step(field: &DensityField, index: usize, direction: [i64; 3]) -> Option<usize> {
    let v = field.voxel(index);
    let mut to = [0usize; 3];
    for axis in 0..3 {
        let c = v[axis] as i64 + direction[axis];
        if c < 0 || c >= field.size[axis] as i64 {
            return None;
        }
        to[axis] = c as usize;
    }
    Some(field.index(to[0], to[1], to[2]))
}

/// Depth of every voxel of the body, and of those around it, below the relaxed unseen boundary [voxels], negative
/// beyond it but not below `-furthest`; infinite where this boundary is not.
fn depths_below_unseen(field: &DensityField, body: &[bool], seen: &[bool], furthest: f32, tuning: &Tuning) -> Vec<f32> {
    let fixed = shell(field, body, seen);
    let mut relaxed = relax(field, body, &fixed, tuning);
    for ((relaxed, &value), &body) in relaxed.values.iter_mut().zip(&field.values).zip(body) {
        *relaxed = if body { relaxed.min(value) } else { value };
    }
    let inside: Vec<bool> = relaxed.values.iter().map(|&v| v >= 0.5).collect();
    // Where the boundary lies between a voxel inside and its neighbours outside, from the centre of the one and of the
    // other.
    let (mut depth, mut height) = (vec![f32::INFINITY; body.len()], vec![f32::INFINITY; body.len()]);
    for i in (0..body.len()).filter(|&i| inside[i] && !fixed[i]) {
        for j in sides(field, i).filter(|&j| !inside[j]) {
            let (a, b) = (relaxed.values[i], relaxed.values[j]);
            let share = (a - 0.5) / (a - b);
            depth[i] = depth[i].min(share);
            height[j] = height[j].min(1.0 - share);
        }
    }
    spread_distances(field, &mut depth, &inside);
    spread_distances(field, &mut height, body);
    (0..body.len())
        .map(|i| match (inside[i], body[i] || height[i].is_finite()) {
            (true, _) => depth[i],
            (false, true) => -height[i].min(furthest),
            (false, false) => f32::INFINITY,
        })
        .collect()
}

/// What is seen, and the matter directly behind it: the voxels of the body that touch it.
fn shell(field: &DensityField, body: &[bool], seen: &[bool]) -> Vec<bool> {
    let held = |i: usize| body[i] && (seen[i] || sides(field, i).any(|j| seen[j]));
    (0..body.len()).into_par_iter().map(held).collect()
}

/// Densities of the body with its boundary, at one half, relaxed where it is not fixed.
fn relax(field: &DensityField, body: &[bool], fixed: &[bool], tuning: &Tuning) -> DensityField {
    let values = body.iter().map(|&b| f32::from(u8::from(b))).collect();
    let mut relaxed = DensityField { values, ..*field };
    for _ in 0..tuning.iterations.most_rounds {
        for _ in 0..tuning.filling.filter_rounds {
            relaxed.mean_filter(MEAN);
        }
        relaxed.values.par_iter_mut().enumerate().for_each(|(i, value)| {
            *value = match (body[i], fixed[i]) {
                (_, true) => 1.0,
                (false, _) => 0.0,
                _ => (0.5 + tuning.unseen.sharpness * (*value - 0.5)).clamp(0.0, 1.0),
            }
        });
    }
    relaxed
}

/// The depth [voxels] at which the unseen boundary is most likely: the sum of the squared deviations of the volume and
/// of the boundary, each over its standard deviation, is least.
fn likeliest_level(field: &DensityField, depths: &[f32], settings: &FillSettings) -> f32 {
    let per_voxel = 1.0 / field.spacing;
    let tuning = &settings.tuning.unseen;
    let expected = tuning.lift * settings.grid_spacing * per_voxel;
    let Some(known) = settings.volume else { return expected as f32 };
    let deviation = tuning.boundary_deviation * settings.grid_spacing * per_voxel;
    let most = furthest_move(settings) * per_voxel;
    let least = f64::from(depths.iter().copied().fold(0.0, f32::min));
    // Only these voxels change with the level.
    let near: Vec<(f32, f32)> = field
        .values
        .iter()
        .zip(depths)
        .filter(|(_, depth)| f64::from(**depth) < most + 0.5)
        .map(|(&value, &depth)| (value, depth))
        .collect();
    let all = field.volume(settings.th_min);
    let voxel = field.spacing.powi(3);
    let cost = |level: f64| {
        let cut = |&(value, depth): &(f32, f32)| (value - (0.5 + depth - level as f32).clamp(0.0, 1.0)).max(0.0);
        let volume = all - voxel * f64::from(near.iter().map(cut).sum::<f32>());
        let deviations = [(volume / known - 1.0) / tuning.volume_deviation, (level - expected) / deviation];
        deviations.iter().map(|d| d * d).sum::<f64>()
    };
    let levels =
        (0..).map(|i| least + f64::from(i) * settings.tuning.iterations.tolerance).take_while(|level| *level <= most);
    let best = levels.map(|level| (level, cost(level))).min_by(|a, b| a.1.total_cmp(&b.1));
    best.map_or(expected, |(level, _)| level) as f32
}

/// Spreads distances [voxels] from where they are finite to all that can be reached inside `within`, by sweeps of the
/// 26-neighbour distance transform (exact along the axes and diagonals, at most a tenth too long between).
fn spread_distances(field: &DensityField, distance: &mut [f32], within: &[bool]) {
    // The half of the neighbours that comes before a voxel in memory, with their distances.
    let earlier: Vec<([i64; 3], f32)> = DIRECTIONS
        .iter()
        .map(|&d| {
            let ahead = d[0] + 4 * d[1] + 16 * d[2] > 0;
            let length = (d.iter().map(|c| c * c).sum::<i64>() as f32).sqrt();
            (if ahead { d.map(|c| -c) } else { d }, length)
        })
        .collect();
    let count = distance.len();
    // Sweeps until nothing changes, because paths inside `within` may bend.
    let mut changes = true;
    while std::mem::take(&mut changes) {
        for pass in [1, -1] {
            for k in 0..count {
                let i = if pass == 1 { k } else { count - 1 - k };
                if !within[i] {
                    continue;
                }
                for &(d, length) in &earlier {
                    let Some(j) = step(field, i, d.map(|c| pass * c)) else { continue };
                    if distance[j] + length < distance[i] {
                        distance[i] = distance[j] + length;
                        changes = true;
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A block, and below it the wedge that cameras above leave, of which only the block's sides are seen.
    #[test]
    fn what_hangs_below_the_hull_of_what_is_seen_is_cut_away() {
        let empty = DensityField { origin: DVec3::ZERO, spacing: 0.01, size: [40; 3], values: vec![0.0; 64_000] };
        let off = |i: usize| (empty.centre(empty.voxel(i)) - DVec3::splat(0.2)) / 0.01;
        let block = |p: DVec3| p.abs().cmple(DVec3::new(12.0, 6.0, 12.0)).all();
        let hangs = |p: DVec3| p.y < 0.0 && p.x.abs().max(p.z.abs()) + 1.6 * (-6.0 - p.y) < 12.0;
        let body: Vec<bool> = (0..empty.len()).map(|i| block(off(i)) || hangs(off(i))).collect();
        let seen: Vec<bool> =
            (0..empty.len()).map(|i| block(off(i)) && off(i).x.abs().max(off(i).z.abs()) > 11.0).collect();
        let is_block: Vec<bool> = (0..empty.len()).map(|i| block(off(i))).collect();
        let values = body.iter().map(|&b| f32::from(u8::from(b))).collect();
        let mut field = DensityField { values, ..empty };
        let lowest = |flags: &[bool]| (0..flags.len()).filter(|&i| flags[i]).map(|i| off(i).y).fold(0.0, f64::min);
        let (hanging, settings) = (lowest(&body), FillSettings::for_size(0.8));
        let cut = cut_to_hull_of_seen(&mut field, body, &seen, &settings);
        // The block ends at -6, and what lies two voxels below what is seen counts as seen.
        assert!(hanging < -12.0 && lowest(&cut) > -8.0, "{hanging} {}", lowest(&cut));
        assert!(cut.iter().zip(&is_block).all(|(cut, block)| *cut || !block), "a part of the block is gone");
    }
}
