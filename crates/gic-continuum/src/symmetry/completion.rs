//! Completing a body by its mirror images: signed distances from the surface at a place and at all its images are
//! averaged, each by how well the views know the surface there.

use gic_geometry::DensityField;
use glam::DVec3;
use rayon::prelude::*;

use super::planes::Symmetry;
use super::surface::KnownSurface;
use crate::shape_from::FEWEST_VIEWS;
use crate::tuning::Tuning;
use crate::{Filling, MaskedView};

/// Completes a body by its symmetry in the frames of a video, as long as it keeps the shape that it has in the first.
#[derive(Debug, Default)]
pub struct Completion {
    /// The symmetry of the first frame's surface, once that is known.
    rest: Option<Symmetry>,
    /// What the first frame was completed by.
    first: Option<Symmetry>,
    /// Whether no more frames are completed: the outlines do not agree with the symmetry, or the body has changed its
    /// shape.
    ended: bool,
}

impl Completion {
    /// Completes the next frame, which these views show, unless it has but one.
    pub fn next(&mut self, filling: &mut Filling, views: &[MaskedView], tuning: &Tuning) {
        if self.ended || filling.views_used < FEWEST_VIEWS {
            return;
        }
        let surface = KnownSurface::new(filling, &tuning.symmetry);
        let symmetry = surface.symmetry();
        let rest = self.rest.get_or_insert_with(|| symmetry.clone());
        let is_still = !rest.planes.is_empty() && symmetry.is_still(rest, tuning.symmetry.same_misfit);
        // Outlines are sharper than surfaces, and show thin parts, which hardly count in a surface's mean.
        let agreed = is_still.then(|| symmetry.on_outlines(views, &tuning.symmetry)).flatten();
        self.ended = agreed.is_none();
        if let Some(symmetry) = agreed {
            let symmetry = surface.measured(symmetry);
            filling.complete(&symmetry, &surface);
            self.first.get_or_insert(symmetry);
        }
    }

    /// The symmetry by which the first frame's body was completed; `None` before that, or where it has no mirror
    /// planes.
    pub fn first(&self) -> Option<&Symmetry> {
        self.first.as_ref()
    }
}

impl Filling {
    /// Completes a body with this surface by its mirror images: afterwards what no view sees is what its images show.
    pub(super) fn complete(&mut self, symmetry: &Symmetry, surface: &KnownSurface) {
        if symmetry.planes.is_empty() {
            return;
        }
        let (distances, doubts) = surface.distances(self);
        let (band, images) = (surface.band(), symmetry.images());
        let distance_and_doubt = |point: DVec3| {
            // Beyond the grid there is nothing.
            let Some(i) = self.field.discretize(point) else { return (band, 0.0) };
            (sample_or(&distances, point, band), f64::from(doubts.values[i]))
        };
        let merged: Vec<(f32, f32)> = (0..self.field.len())
            .into_par_iter()
            .map(|i| {
                let (mut sum, mut total, mut doubt) = (0.0, 0.0, 1.0f64);
                for image in images.of(self.field.centre(self.field.voxel(i))) {
                    let (distance, doubtful) = distance_and_doubt(image);
                    // What no view sees decides only where it is alone.
                    let share = f64::EPSILON.sqrt() + 1.0 - doubtful;
                    sum += share * distance;
                    total += share;
                    doubt = doubt.min(doubtful);
                }
                let distance = sum / total / self.field.spacing;
                // The density falls from 1 to 0 over one voxel.
                ((0.5 - distance).clamp(0.0, 1.0) as f32, doubt as f32)
            })
            .collect();
        for (i, (density, doubt)) in merged.into_iter().enumerate() {
            self.field.values[i] = density;
            if let Some(own) = self.doubt.get_mut(i) {
                *own = own.min(doubt);
            }
        }
    }
}

/// Trilinear interpolation of what is `beyond` outside of the grid.
fn sample_or(field: &DensityField, point: DVec3, beyond: f64) -> f64 {
    let inner = 0.5 * field.spacing;
    let (low, high) = (field.origin + inner, field.centre(field.size.map(|n| n - 1)));
    if point.cmplt(low).any() || point.cmpgt(high).any() { beyond } else { field.sample(point) }
}
