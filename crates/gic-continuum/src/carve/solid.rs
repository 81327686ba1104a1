//! A body as voxels, from which layers are carved.

use gic_geometry::DensityField;
use glam::DVec3;
use rayon::prelude::*;

use super::coloured::{Coloured, Visibility};
use super::difference::{Difference, SumsAround, difference};
use super::place::Place;
use crate::Symmetry;
use crate::symmetry::Images;
use crate::tuning::{CarvingTuning, Tuning};

/// A body of voxels half as large as those of the field that it comes from.
pub(super) struct Solid {
    pub(super) grid: DensityField,
    pub(super) inside: Vec<bool>,
}

impl Solid {
    /// The voxels of at least a density.
    pub(super) fn new(field: &DensityField, level: f64) -> Solid {
        let grid = field.upsample();
        let inside = grid.values.iter().map(|v| f64::from(*v) >= level).collect();
        Solid { grid, inside }
    }

    /// The eight voxels that a voxel of the field is made of.
    pub(super) fn children(&self, field: &DensityField, index: usize) -> impl Iterator<Item = usize> + '_ {
        let [x, y, z] = field.voxel(index);
        (0..8).map(move |k| self.grid.index(2 * x + (k & 1), 2 * y + (k >> 1 & 1), 2 * z + (k >> 2)))
    }

    /// Whether a voxel is inside, at some distance from another one; beyond the grid nothing is.
    fn is_inside(&self, [x, y, z]: [usize; 3], [dx, dy, dz]: [i64; 3]) -> bool {
        let at = |c: usize, d: i64, n: usize| c.checked_add_signed(d as isize).filter(|c| *c < n);
        let [nx, ny, nz] = self.grid.size;
        match (at(x, dx, nx), at(y, dy, ny), at(z, dz, nz)) {
            (Some(x), Some(y), Some(z)) => self.inside[self.grid.index(x, y, z)],
            _ => false,
        }
    }

    /// The voxels with a face that is free.
    pub(super) fn surface(&self, tuning: &CarvingTuning) -> Vec<Place> {
        let faces = [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]];
        let is_free = |i: usize| faces.iter().any(|face| !self.is_inside(self.grid.voxel(i), *face));
        let weights = normal_weights(tuning);
        (0..self.inside.len())
            .into_par_iter()
            .filter(|&i| self.inside[i] && is_free(i))
            .map(|voxel| {
                let normal = self.normal(voxel, &weights);
                let point = self.grid.centre(self.grid.voxel(voxel)) + 0.5 * self.grid.spacing * normal;
                Place { voxel, point, normal }
            })
            .collect()
    }

    /// Away from where most of the voxels around are.
    fn normal(&self, voxel: usize, weights: &[([i64; 3], DVec3)]) -> DVec3 {
        let at = self.grid.voxel(voxel);
        let inside = weights.iter().filter(|(offset, _)| self.is_inside(at, *offset));
        (-inside.map(|(_, weighted)| *weighted).sum::<DVec3>()).normalize_or_zero()
    }

    /// Depth of the nearest place in each pixel of each view [m].
    fn depths(&self, views: &[Coloured], surface: &[Place]) -> Vec<Vec<f32>> {
        views.par_iter().map(|view| view.depths(surface, self.grid.spacing)).collect()
    }

    /// The share of each view's mask that the body fills.
    pub(super) fn filled(&self, views: &[Coloured], tuning: &Tuning) -> Vec<f64> {
        let depths = self.depths(views, &self.surface(&tuning.carving));
        let share = |(view, depths): (&Coloured, &Vec<f32>)| {
            let pixels = view.view.mask.iter().zip(depths).filter(|(m, _)| **m >= 0.5);
            let (sum, total) = pixels.fold((0usize, 0usize), |(s, n), (_, d)| (s + usize::from(d.is_finite()), n + 1));
            sum as f64 / total.max(1) as f64
        };
        views.iter().zip(&depths).map(share).collect()
    }

    /// Whether some view's mask is less filled than the shares `filled` say, by more than `lost`.
    pub(super) fn loses_outlines(&self, views: &[Coloured], filled: &[f64], lost: f64, tuning: &Tuning) -> bool {
        self.filled(views, tuning).iter().zip(filled).any(|(now, first)| *now < first - lost)
    }

    /// Carves layer by layer what colours contradict; whether that comes to an end.
    pub(super) fn carve_layers(
        &mut self,
        views: &[Coloured],
        symmetry: &Symmetry,
        tolerance: f32,
        tuning: &Tuning,
    ) -> bool {
        let images = symmetry.images();
        let mut least = usize::MAX;
        for _ in 0..tuning.iterations.most_rounds {
            let surface = self.surface(&tuning.carving);
            let around = self.differences_around(views, &surface, &[0.0], tuning);
            let contradicted = |place: &&Place| {
                let all = self.at_images(&around, &images, place);
                all.freedom >= tuning.carving.fewest_differences && all.squared[0] > tolerance * all.freedom
            };
            let carved: Vec<usize> = surface.par_iter().filter(contradicted).map(|place| place.voxel).collect();
            carved.iter().for_each(|i| self.inside[*i] = false);
            if carved.len() as f64 <= tuning.iterations.tolerance * surface.len() as f64 {
                return true;
            }
            if carved.len() as f64 > tuning.carving.layer_growth * least as f64 {
                return false;
            }
            least = least.min(carved.len());
        }
        false
    }

    /// How much colours differ in the 3x3x3 voxels around each voxel, where places are moved by each of `outward` [m]
    /// along their normals.
    pub(super) fn differences_around<const N: usize>(
        &self,
        views: &[Coloured],
        surface: &[Place],
        outward: &[f64; N],
        tuning: &Tuning,
    ) -> SumsAround<N> {
        let depths = self.depths(views, surface);
        let depth = super::visible_depth(self.grid.spacing, &tuning.carving);
        let visibility = Visibility { depth, least_cosine: tuning.facing_cosine };
        let differences: Vec<Difference<N>> =
            surface.par_iter().map(|place| difference(place, views, &depths, &visibility, outward)).collect();
        let mut around = SumsAround::none(self.inside.len());
        for (place, difference) in surface.iter().zip(&differences).filter(|(_, d)| d.freedom > 0.0) {
            self.grid.around(place.voxel).for_each(|i| around.add(i, difference));
        }
        around
    }

    /// Their sum over a place and its images.
    pub(super) fn at_images<const N: usize>(
        &self,
        around: &SumsAround<N>,
        images: &Images,
        place: &Place,
    ) -> Difference<N> {
        let mut all = Difference::NONE;
        for image in images.of(self.grid.centre(self.grid.voxel(place.voxel))) {
            if let Some(sum) = self.grid.discretize(image).and_then(|i| around.at(i)) {
                all.add(sum);
            }
        }
        all
    }
}

/// How far from a place others count in a mean with weights of a standard deviation: two of these.
pub(super) fn reach(deviation: f64) -> f64 {
    2.0 * deviation
}

/// The voxels around one that tell which way its surface looks, and their offsets, weighted [voxels].
fn normal_weights(tuning: &CarvingTuning) -> Vec<([i64; 3], DVec3)> {
    let deviation = tuning.smoothing_deviation;
    let n = reach(deviation).ceil() as i64;
    let offsets = (-n..=n).flat_map(|z| (-n..=n).flat_map(move |y| (-n..=n).map(move |x| [x, y, z])));
    offsets
        .map(|offset| {
            let towards = DVec3::from_array(offset.map(|c| c as f64));
            (offset, towards * (-0.5 * (towards / deviation).length_squared()).exp())
        })
        .collect()
}
