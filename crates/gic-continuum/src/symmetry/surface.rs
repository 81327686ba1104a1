//! Mirror planes of a surface.
//!
//! 1. Planes of all directions near the body's middle are rated by how far a few mirrored surface points lie from the
//!    surface; the best are fitted by iterated least squares (point-to-plane distances: Chen & Medioni 1992).
//! 2. Up to three at right angles to each other are kept, and fitted together.

use gic_geometry::DensityField;
use gic_geometry::KdTree;
use gic_optimize::damped_step;
use glam::DVec3;
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;

use super::planes::{MirrorPlane, Symmetry, normals_beside};
use crate::Filling;
use crate::tuning::{CompletionTuning, SurfaceSymmetryTuning};

/// The surface of a body as points.
pub(super) struct KnownSurface<'a> {
    tuning: &'a SurfaceSymmetryTuning,
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
}

impl KnownSurface<'_> {
    /// The surface of a body.
    pub(super) fn new<'a>(filling: &Filling, tuning: &'a SurfaceSymmetryTuning) -> KnownSurface<'a> {
        let samples = filling.surface_mesh().sample(filling.field.spacing, 0);
        let points: Vec<DVec3> = samples.iter().map(|s| s.position).collect();
        let doubts: Vec<f32> = points.iter().map(|p| filling.doubt_of_surface(*p)).collect();
        let (low, high) =
            points.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), |(l, h), p| (l.min(*p), h.max(*p)));
        let single: Vec<[f32; 3]> = points.iter().map(|p| p.as_vec3().to_array()).collect();
        KnownSurface {
            tuning,
            normals: samples.iter().map(|s| s.normal).collect(),
            seen: points.iter().zip(&doubts).filter(|(_, d)| **d < tuning.seen_below_doubt).map(|(p, _)| *p).collect(),
            tree: KdTree::new(&single),
            middle: points.iter().sum::<DVec3>() / points.len().max(1) as f64,
            size: (high - low).max_element().max(0.0),
            points,
            doubts,
        }
    }

    /// The mirror planes of the body, none where the part of its surface that is seen has none.
    pub(super) fn symmetry(&self) -> Symmetry {
        let mut planes: Vec<MirrorPlane> = Vec::new();
        while planes.len() < 3 && self.seen.len() >= self.tuning.points_tried {
            let Some(more) = self.with_another(&planes) else { break };
            planes = more;
        }
        Symmetry { planes, interchangeable_planes: Vec::new() }
    }

    /// About `count` of the points that are seen, always the same ones.
    fn some(&self, count: usize) -> impl Iterator<Item = DVec3> + '_ {
        self.seen.iter().step_by(self.seen.len().div_ceil(count).max(1)).copied()
    }

    /// Signed distance of a point from the surface [m], the direction in which it is measured, and how far it counts at
    /// most: less inside of what no view sees. Close to the surface it is the distance from its plane there.
    fn signed_distance(&self, point: DVec3) -> (f64, DVec3, f64) {
        let SurfaceSymmetryTuning { farthest_miss: farthest, farthest_miss_unseen, tangent_within, .. } = *self.tuning;
        let Some((i, squared)) = self.tree.nearest(point.as_vec3().to_array()) else {
            return (f64::INFINITY, DVec3::Y, farthest * self.size);
        };
        let offset = point - self.points[i];
        let along = offset.dot(self.normals[i]);
        let inside_most = farthest + f64::from(self.doubts[i]) * (farthest_miss_unseen - farthest);
        let most = self.size * if along < 0.0 { inside_most } else { farthest };
        let distance = f64::from(squared).sqrt();
        if distance < tangent_within * self.size {
            return (along, self.normals[i], most);
        }
        (distance * along.signum(), offset * along.signum() / distance, most)
    }

    /// How far mirrored points lie from the surface, in the mean [m].
    fn misfit(&self, plane: &MirrorPlane, count: usize) -> f64 {
        let off = |p| {
            let (distance, _, most) = self.signed_distance(plane.mirror(p));
            distance.abs().min(most)
        };
        let (sum, total) = self.some(count).fold((0.0, 0usize), |(sum, n), p| (sum + off(p), n + 1));
        sum / total.max(1) as f64
    }

    /// The planes and the best other one at right angles to them, fitted together; `None` where no other one fits.
    fn with_another(&self, planes: &[MirrorPlane]) -> Option<Vec<MirrorPlane>> {
        let tuning = self.tuning;
        let steps = tuning.offsets as i32;
        let mut tried: Vec<MirrorPlane> = normals_beside(planes, tuning.normals, tuning.second_normals)
            .into_par_iter()
            .flat_map_iter(|normal| {
                (-steps..=steps).map(move |step| {
                    let offset = normal.dot(self.middle) + f64::from(step) * tuning.offset_step * self.size;
                    let plane = MirrorPlane { normal, offset, misfit: 0.0 };
                    MirrorPlane { misfit: self.misfit(&plane, tuning.points_tried), ..plane }
                })
            })
            .collect();
        tried.sort_by(|a, b| a.misfit.total_cmp(&b.misfit));
        let mut distinct = Vec::<MirrorPlane>::new();
        for plane in tried {
            let is_new = |d: &MirrorPlane| d.normal.dot(plane.normal).abs() < tuning.distinct_cosine;
            if distinct.len() < tuning.candidates && distinct.iter().all(is_new) {
                distinct.push(plane);
            }
        }
        let fitted = |plane| self.fit([planes, &[plane]].concat(), tuning.points_candidate);
        let fits: Vec<Vec<MirrorPlane>> = distinct.into_par_iter().map(fitted).collect();
        let last = |fit: &[MirrorPlane]| fit[planes.len()].misfit;
        let best = fits.into_iter().min_by(|a, b| last(a).total_cmp(&last(b)))?;
        let best = self.fit(best, tuning.points_final);
        (last(&best) <= tuning.largest_misfit * self.size).then_some(best)
    }

    /// Turns planes that are at right angles together and shifts each, so that `count` mirrored points come to lie on
    /// the surface: least squares of the distances, those weighted by their inverse, round by round.
    fn fit(&self, mut planes: Vec<MirrorPlane>, count: usize) -> Vec<MirrorPlane> {
        let (unknowns, tuning) = (3 + planes.len(), self.tuning);
        for _ in 0..tuning.fit_rounds {
            let (mut matrix, mut pull) = (DMatrix::zeros(unknowns, unknowns), DVector::zeros(unknowns));
            for (k, plane) in planes.iter().enumerate() {
                for p in self.some(count) {
                    let (distance, normal, most) = self.signed_distance(plane.mirror(p));
                    if distance.abs() >= most {
                        continue;
                    }
                    let from_middle = p - self.middle;
                    let height = plane.normal.dot(p) - plane.offset;
                    // The image p - 2 h n moves by -2 (dn . (p - m)) n - 2 h dn + 2 dc n where dn = turn x n and c is
                    // measured from m.
                    let along = normal.dot(plane.normal);
                    let turned = -2.0 * (along * plane.normal.cross(from_middle) + height * plane.normal.cross(normal));
                    let mut row = DVector::zeros(unknowns);
                    row.rows_mut(0, 3).copy_from_slice(&turned.to_array());
                    row[3 + k] = 2.0 * along;
                    let weight = 1.0 / distance.abs().max(tuning.least_distance * self.size);
                    pull += &row * (weight * distance);
                    matrix.ger(weight, &row, &row, 1.0);
                }
            }
            let mean = matrix.diagonal().sum() / unknowns as f64;
            let damping = |own: f64| tuning.damping * own + 1e-9 * mean + f64::MIN_POSITIVE;
            let Some(step) = damped_step(&matrix, &pull, damping) else { break };
            let turn = DVec3::new(step[0], step[1], step[2]);
            let rotation = glam::DQuat::from_scaled_axis(turn.clamp_length_max(tuning.largest_turn));
            let converged = turn.length() < tuning.converged_step
                && step.rows_range(3..).amax() < tuning.converged_step * self.size;
            let largest_shift = tuning.largest_shift * self.size;
            for (k, plane) in planes.iter_mut().enumerate() {
                *plane = plane.turned(rotation * plane.normal, self.middle);
                plane.offset += step[3 + k].clamp(-largest_shift, largest_shift);
            }
            if converged {
                break;
            }
        }
        for plane in &mut planes {
            plane.misfit = self.misfit(plane, count);
        }
        planes
    }

    /// The planes with how far mirrored points of this surface lie from it.
    pub(super) fn measured(&self, mut symmetry: Symmetry) -> Symmetry {
        symmetry.planes.iter_mut().for_each(|plane| plane.misfit = self.misfit(plane, self.tuning.points_final));
        symmetry
    }

    /// Signed distance from the surface [m] at each voxel, cut to the band, and how much the surface next to it is in
    /// doubt.
    pub(super) fn distances(&self, filling: &Filling, tuning: &CompletionTuning) -> (DensityField, DensityField) {
        let field = &filling.field;
        let band = tuning.band * field.spacing;
        let of = |i: usize| -> (f32, f32) {
            let point = field.centre(field.voxel(i));
            let inside = f64::from(field.values[i]) >= filling.th_min;
            let Some((nearest, squared)) = self.tree.nearest(point.as_vec3().to_array()) else {
                return (band as f32, 0.0);
            };
            let distance = f64::from(squared).sqrt();
            let doubt = if inside || distance < band { self.doubts[nearest] } else { 0.0 };
            if distance > tuning.tangent_within * field.spacing {
                let sign = if inside { -1.0 } else { 1.0 };
                return ((sign * distance.min(band)) as f32, doubt);
            }
            ((point - self.points[nearest]).dot(self.normals[nearest]) as f32, doubt)
        };
        let (distances, doubts): (Vec<f32>, Vec<f32>) = (0..field.len()).into_par_iter().map(of).unzip();
        (DensityField { values: distances, ..*field }, DensityField { values: doubts, ..*field })
    }
}
