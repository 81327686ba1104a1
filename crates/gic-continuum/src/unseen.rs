//! Undersides: the boundary of the body where no view sees it.
//!
//! The largest body that agrees with all views hangs down in wedges below every part whose underside no camera sees. The smallest
//! one is what the seen boundary encloses: a point belongs to it if some straight line through the point leaves the largest body
//! at both ends through boundary that is seen. The truth lies between, at the smallest body for flat undersides and further out for
//! round ones; [`FillSettings::unseen_share`] says where.

use crate::view::Evidence;
use crate::{DensityField, FillSettings};

/// Boundary within so many voxels of a rendered surface counts as seen.
const SEEN_WITHIN: f64 = 1.5;
/// ... from a camera that it faces: cosine between its normal and the direction to the camera. The sides of a wedge that hangs below
/// an unseen part are what rays along silhouettes leave behind, so that no camera looks at them from the front.
const FACING: f64 = 0.25;
/// If the seen boundary encloses less than this share of the body, too little is seen to say anything.
const MIN_ENCLOSED: f64 = 0.5;

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

/// Lowers the density beyond a surface between the smallest and the largest body; linear in the number of voxels.
pub(crate) fn halve_unseen(field: &mut DensityField, views: &[Evidence], inset: f64, settings: &FillSettings) {
    let body: Vec<bool> = field.values.iter().map(|&v| f64::from(v) >= settings.th_min).collect();
    let seen = seen_boundary(field, &body, views, inset, settings);
    let enclosed = enclosed_by_seen(field, &body, &seen);
    let count = |flags: &[bool]| flags.iter().filter(|&&f| f).count() as f64;
    if count(&enclosed) < MIN_ENCLOSED * count(&body) {
        return;
    }
    // Distances in voxels, from voxel centre to voxel centre: half a voxel nearer to the boundary between.
    let to_enclosed = distances(field, &enclosed, &body);
    let outside: Vec<bool> = body.iter().map(|&b| !b).collect();
    let to_outside = distances(field, &outside, &vec![true; body.len()]);
    for i in 0..body.len() {
        if body[i] && !enclosed[i] {
            let share = settings.unseen_share as f32;
            field.values[i] *= (0.5 + share * to_outside[i] - (1.0 - share) * to_enclosed[i]).clamp(0.0, 1.0);
        }
    }
}

/// Voxels of the body that touch its outside where some view renders a surface, or where the ground is.
fn seen_boundary(
    field: &DensityField,
    body: &[bool],
    views: &[Evidence],
    inset: f64,
    settings: &FillSettings,
) -> Vec<bool> {
    use rayon::prelude::*;
    let near = SEEN_WITHIN * field.spacing;
    (0..body.len())
        .into_par_iter()
        .map(|i| {
            if !body[i] || !touches_outside(field, body, i) {
                return false;
            }
            let point = field.centre(field.voxel(i));
            let normal = -field.gradient(point).normalize_or_zero();
            settings.ground.is_some_and(|g| g.height(point) < near)
                || views.iter().any(|v| {
                    normal.dot(v.direction_from(point)) > FACING
                        && v.look(point).is_some_and(|s| (f64::from(s.behind) + inset).abs() < near)
                })
        })
        .collect()
}

fn touches_outside(field: &DensityField, body: &[bool], index: usize) -> bool {
    DIRECTIONS[..3].iter().any(|&d| {
        [1, -1].iter().any(|sign| step(field, index, d.map(|c| sign * c)).is_none_or(|neighbour| !body[neighbour]))
    })
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

/// Voxels of the body through which some line of [`DIRECTIONS`] leaves the body at both ends through seen boundary.
fn enclosed_by_seen(field: &DensityField, body: &[bool], seen: &[bool]) -> Vec<bool> {
    let mut enclosed = vec![false; body.len()];
    let mut run = Vec::new();
    for direction in DIRECTIONS {
        for start in 0..body.len() {
            if step(field, start, direction.map(|c| -c)).is_some() {
                continue;
            }
            let mut next = Some(start);
            while let Some(i) = next {
                if body[i] {
                    run.push(i);
                }
                next = step(field, i, direction);
                if !run.is_empty() && (!body[i] || next.is_none()) {
                    if seen[run[0]] && seen[run[run.len() - 1]] {
                        for &i in &run {
                            enclosed[i] = true;
                        }
                    }
                    run.clear();
                }
            }
        }
    }
    enclosed
}

/// Distance [voxels] of every voxel to the nearest of `targets` on paths inside `within`, by two sweeps of the 26-neighbour
/// distance transform (exact along the axes and diagonals, at most a tenth too long between).
fn distances(field: &DensityField, targets: &[bool], within: &[bool]) -> Vec<f32> {
    let mut distance: Vec<f32> = targets.iter().map(|&t| if t { 0.0 } else { f32::INFINITY }).collect();
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
    // Two rounds, because paths inside `within` may bend.
    for _ in 0..2 {
        for pass in [1, -1] {
            for k in 0..count {
                let i = if pass == 1 { k } else { count - 1 - k };
                if !within[i] || targets[i] {
                    continue;
                }
                for &(d, length) in &earlier {
                    if let Some(j) = step(field, i, d.map(|c| pass * c)) {
                        distance[i] = distance[i].min(distance[j] + length);
                    }
                }
            }
        }
    }
    distance
}
