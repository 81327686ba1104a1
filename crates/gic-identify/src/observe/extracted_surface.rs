//! An extracted surface, prepared for comparison: points with normals, and signed distances from the mean of the
//! nearest points' planes.

use gic_geometry::Neighbours;
use glam::{DMat3, DVec3};

use crate::tuning::{NEAREST_SURFACE_POINTS, SurfaceTuning};

/// An extracted surface with normals.
#[derive(Clone, Debug)]
pub(crate) struct ObservedSurface {
    /// Points [m].
    pub points: Vec<DVec3>,
    /// Unit normals of unknown sign.
    pub normals: Vec<DVec3>,
    /// How much each point counts.
    pub confidences: Vec<f64>,
    tree: Neighbours,
    /// Beyond this the nearest point, not the plane through it, is what pulls [m].
    far: f64,
}

impl ObservedSurface {
    /// Normals from the neighbours by principal components.
    pub(crate) fn new(points: &[DVec3], grid_spacing_m: f64, tuning: &SurfaceTuning) -> ObservedSurface {
        let radius = tuning.plane_radius_cells * grid_spacing_m;
        let tree = Neighbours::new(points, radius);
        let normals = points.iter().map(|p| normal(&tree, *p, radius)).collect();
        let confidences = vec![1.0; points.len()];
        ObservedSurface { points: points.to_vec(), normals, confidences, tree, far: radius }
    }

    /// From here on each point counts the less the more it is in doubt; without `doubts` nothing changes.
    pub(crate) fn discount_doubtful(&mut self, doubts: &[f32]) {
        for (confidence, doubt) in self.confidences.iter_mut().zip(doubts) {
            *confidence = 1.0 - f64::from(*doubt);
        }
    }
}

/// Direction of least spread of the points around `p`.
fn normal(tree: &Neighbours, p: DVec3, radius: f64) -> DVec3 {
    let (mut count, mut mean, mut square) = (0.0, DVec3::ZERO, DMat3::ZERO);
    tree.within(p, radius, |_, _, q| {
        let d = q - p;
        count += 1.0;
        mean += d;
        square += DMat3::from_cols(d * d.x, d * d.y, d * d.z);
    });
    let mean = mean / count;
    let spread = square * (1.0 / count) - DMat3::from_cols(mean * mean.x, mean * mean.y, mean * mean.z);
    let matrix = nalgebra::Matrix3::from_column_slice(&spread.to_cols_array());
    let eigen = matrix.symmetric_eigen();
    let least = eigen.eigenvalues.imin();
    let n = eigen.eigenvectors.column(least);
    DVec3::new(n[0], n[1], n[2]).normalize_or(DVec3::Y)
}

/// Distance of `p` from the surface, positive outward (along `outward`), the direction in which it is measured, and how
/// much the surface there counts.
///
/// The surface is the mean of the nearest points' planes.
pub(crate) fn signed_distance(surface: &ObservedSurface, p: DVec3, outward: DVec3) -> (f64, DVec3, f64) {
    let (mut place, mut normal, mut confidence) = (DVec3::ZERO, DVec3::ZERO, 0.0);
    for (id, share) in shares(surface.tree.nearest::<NEAREST_SURFACE_POINTS>(p), |_| 1.0) {
        let n = surface.normals[id];
        place += share * surface.points[id];
        confidence += share * surface.confidences[id];
        normal += if n.dot(outward) < 0.0 { -share * n } else { share * n };
    }
    let (distance, normal) = directed(p - place, normal.normalize_or(outward), outward, surface.far);
    (distance, normal, confidence)
}

/// The shares of the nearest points (squared distance, index), which sum to one: by inverse squared distance, less that
/// of the last of them. The last has no share then, so that what they are used for is continuous where the nearest
/// points change, and a point that is hit has them all, so that a right hypothesis has no residual. `most` is what a
/// point may count at most, before that. Without any point there are no shares.
pub(crate) fn shares(
    nearest: [(f64, usize); NEAREST_SURFACE_POINTS],
    most: impl Fn(usize) -> f64,
) -> Vec<(usize, f64)> {
    let found = nearest.into_iter().filter(|(squared, _)| squared.is_finite());
    let last = found.clone().next_back().map_or(0.0, |(squared, _)| squared).max(f64::MIN_POSITIVE);
    // The last counts after all where no other does.
    let weight = |squared: f64| last / squared.max(1e-9 * last) - 1.0 + 1e-9;
    let weights: Vec<(usize, f64)> = found.map(|(squared, k)| (k, weight(squared) * most(k))).collect();
    let total: f64 = weights.iter().map(|(_, weight)| weight).sum();
    weights.into_iter().map(|(k, weight)| (k, weight / total)).collect()
}

/// Distance along the normal where the offset is mostly along it or short, along the offset itself elsewhere.
pub(crate) fn directed(offset: DVec3, normal: DVec3, outward: DVec3, far: f64) -> (f64, DVec3) {
    let normal = if normal.dot(outward) < 0.0 { -normal } else { normal };
    let distance = offset.length();
    if distance > far {
        let sign = if offset.dot(outward) < 0.0 { -1.0 } else { 1.0 };
        return (sign * distance, sign * offset / distance);
    }
    (offset.dot(normal), normal)
}
