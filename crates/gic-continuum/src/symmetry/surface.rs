//! Mirror planes of a surface.
//!
//! 1. Planes of all directions near the body's middle are rated by how far a few mirrored surface points lie from the
//!    surface; the best are fitted by least squares (point-to-plane distances: Chen & Medioni 1992).
//! 2. Up to three at right angles to each other are kept, and fitted together.

use gic_geometry::DensityField;
use gic_geometry::KdTree;
use glam::DVec3;
use nalgebra::DVector;
use rayon::prelude::*;

use super::planes::{MirrorPlane, Symmetry, angle_between, normals_beside};
use crate::Filling;
use crate::tuning::SymmetryTuning;

/// The surface of a body as points.
pub(super) struct KnownSurface<'a> {
    tuning: &'a SymmetryTuning,
    points: Vec<DVec3>,
    normals: Vec<DVec3>,
    /// How much each is in doubt.
    doubts: Vec<f32>,
    tree: KdTree,
    /// The points that a view sees, spread evenly over the surface in whatever order.
    seen: Vec<DVec3>,
    middle: DVec3,
    /// Largest side of the body's box [m].
    size: f64,
    /// About the distance between neighbouring points [m].
    spacing: f64,
}

impl KnownSurface<'_> {
    /// The surface of a body.
    pub(super) fn new<'a>(filling: &Filling, tuning: &'a SymmetryTuning) -> KnownSurface<'a> {
        let samples = filling.surface_mesh().sample(filling.field.spacing, 0);
        let points: Vec<DVec3> = samples.iter().map(|s| s.position).collect();
        let doubts: Vec<f32> = points.iter().map(|p| filling.doubt_of_surface(*p)).collect();
        let (low, high) =
            points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
        let single: Vec<[f32; 3]> = points.iter().map(|p| p.as_vec3().to_array()).collect();
        KnownSurface {
            tuning,
            normals: samples.iter().map(|s| s.normal).collect(),
            seen: points.iter().zip(&doubts).filter(|(_, d)| **d < 0.5).map(|(p, _)| *p).collect(),
            tree: KdTree::new(&single),
            middle: points.iter().sum::<DVec3>() / points.len().max(1) as f64,
            size: (high - low).max_element().max(0.0),
            spacing: filling.field.spacing,
            points,
            doubts,
        }
    }

    /// The mirror planes of the body, none where the part of its surface that is seen has none.
    pub(super) fn symmetry(&self) -> Symmetry {
        let mut planes: Vec<MirrorPlane> = Vec::new();
        while planes.len() < 3 && self.seen.len() >= self.tuning.points {
            let Some(more) = self.with_another(&planes) else { break };
            planes = more;
        }
        Symmetry { planes, interchangeable_planes: Vec::new() }
    }

    /// Some of the points that are seen, always the same ones.
    fn some(&self) -> impl Iterator<Item = DVec3> + '_ {
        self.seen.iter().step_by(self.seen.len().div_ceil(self.tuning.points).max(1)).copied()
    }

    /// Signed distance of a point from the surface [m], no larger than it counts: less inside of what no view sees.
    fn signed_distance(&self, point: DVec3) -> f64 {
        let most = self.band();
        let Some((i, squared)) = self.tree.nearest(point.as_vec3().to_array()) else { return most };
        let along = (point - self.points[i]).dot(self.normals[i]);
        // A notch that no view sees is filled too far.
        let unseen = self.tuning.largest_misfit * self.size;
        let inside_most = most + f64::from(self.doubts[i]) * (unseen - most);
        self.distance_from_plane_or_point(along, f64::from(squared).sqrt(), along.signum()).clamp(-inside_most, most)
    }

    /// Signed distance of a point that lies `distance` from the nearest one of the surface, of that `along` its normal
    /// [m]: close to it that from its plane, else from the point itself, with the sign of the side.
    fn distance_from_plane_or_point(&self, along: f64, distance: f64, side: f64) -> f64 {
        if distance < self.tuning.tangent_spacings * self.spacing { along } else { side * distance }
    }

    /// How far mirrored points lie from the surface, in the mean [m].
    fn misfit(&self, plane: &MirrorPlane) -> f64 {
        let off = |p| self.signed_distance(plane.mirror(p)).abs();
        let (sum, total) = self.some().fold((0.0, 0usize), |(sum, n), p| (sum + off(p), n + 1));
        sum / total.max(1) as f64
    }

    /// The planes and the best other one at right angles to them, fitted together; `None` where no other one fits.
    fn with_another(&self, planes: &[MirrorPlane]) -> Option<Vec<MirrorPlane>> {
        let tuning = self.tuning;
        let mut tried: Vec<MirrorPlane> = normals_beside(planes, tuning.normals)
            .into_par_iter()
            .map(|normal| self.rated(MirrorPlane { normal, offset: normal.dot(self.middle), misfit: 0.0 }))
            .collect();
        tried.sort_by(|a, b| a.misfit.total_cmp(&b.misfit));
        // Next to a plane that is fitted none needs to be.
        let distinct_cosine = (2.0 * angle_between(tuning.normals)).cos();
        let mut distinct = Vec::<MirrorPlane>::new();
        for plane in tried {
            let is_new = |d: &MirrorPlane| d.normal.dot(plane.normal).abs() < distinct_cosine;
            if distinct.len() < tuning.candidates && distinct.iter().all(is_new) {
                distinct.push(plane);
            }
        }
        let fitted = |plane| self.fit([planes, &[plane]].concat());
        let fits: Vec<Vec<MirrorPlane>> = distinct.into_par_iter().map(fitted).collect();
        let last = |fit: &[MirrorPlane]| fit[planes.len()].misfit;
        let best = fits.into_iter().min_by(|a, b| last(a).total_cmp(&last(b)))?;
        (last(&best) <= tuning.largest_misfit * self.size).then_some(best)
    }

    /// Turns planes that are at right angles together and shifts each, so that mirrored points come to lie on the
    /// surface: the sum of their distances is least.
    fn fit(&self, planes: Vec<MirrorPlane>) -> Vec<MirrorPlane> {
        // Its square is the pseudo-Huber cost sqrt(k^2 + d^2) - k: least sums, smooth at a small part of a misfit.
        let knee = 0.1 * self.tuning.largest_misfit * self.size;
        let residual = |distance: f64| distance / (knee + knee.hypot(distance)).sqrt();
        let misses = |symmetry: &Symmetry| {
            let of = |plane: &MirrorPlane| {
                self.some().map(|p| residual(self.signed_distance(plane.mirror(p)))).collect::<Vec<f64>>()
            };
            DVector::from_vec(symmetry.planes.iter().flat_map(of).collect())
        };
        let start = Symmetry { planes, interchangeable_planes: Vec::new() };
        let half_a_voxel = 0.5 * self.spacing / self.size;
        let (_, fitted) = start.fitted((self.middle, self.size), half_a_voxel, misses);
        self.measured(fitted).planes
    }

    /// A plane with how far mirrored points of this surface lie from it.
    fn rated(&self, plane: MirrorPlane) -> MirrorPlane {
        MirrorPlane { misfit: self.misfit(&plane), ..plane }
    }

    /// The planes with how far mirrored points of this surface lie from it.
    pub(super) fn measured(&self, mut symmetry: Symmetry) -> Symmetry {
        symmetry.planes.iter_mut().for_each(|plane| *plane = self.rated(*plane));
        symmetry
    }

    /// How far from the surface a point counts at most [m].
    pub(super) fn band(&self) -> f64 {
        self.tuning.farthest_miss * self.size
    }

    /// Signed distance from the surface [m] at each voxel, cut to the band, and how much the surface next to it is in
    /// doubt.
    pub(super) fn distances(&self, filling: &Filling) -> (DensityField, DensityField) {
        let field = &filling.field;
        let band = self.band();
        let of = |i: usize| -> (f32, f32) {
            let point = field.centre(field.voxel(i));
            let inside = f64::from(field.values[i]) >= filling.th_min;
            let Some((nearest, squared)) = self.tree.nearest(point.as_vec3().to_array()) else {
                return (band as f32, 0.0);
            };
            let distance = f64::from(squared).sqrt();
            let doubt = if inside || distance < band { self.doubts[nearest] } else { 0.0 };
            let along = (point - self.points[nearest]).dot(self.normals[nearest]);
            let signed = self.distance_from_plane_or_point(along, distance, if inside { -1.0 } else { 1.0 });
            (signed.clamp(-band, band) as f32, doubt)
        };
        let (distances, doubts): (Vec<f32>, Vec<f32>) = (0..field.len()).into_par_iter().map(of).unzip();
        (DensityField { values: distances, ..*field }, DensityField { values: doubts, ..*field })
    }
}
