//! Where colours agree best, to a fraction of a voxel.
//!
//! Carving ends where colours contradict no longer, which is outside of the surface: by as much as a pixel hides. The
//! surface is where they agree best. So every place is tried at several depths along its normal (plane sweep: Collins
//! 1996), the differences of colours around it and around its mirror images are summed at each, and it moves to their
//! minimum: a fraction of a voxel, shared with its neighbours as far as the minimum is flat. With it, the field is
//! carried along, so that edges stay as they are.

use rayon::prelude::*;

use super::coloured::Coloured;
use super::difference::Difference;
use super::displacement::Displacement;
use super::place::Place;
use super::solid::Solid;
use crate::tuning::{SWEEP_DEPTHS, SWEEP_SURFACE, Tuning};
use crate::{Filling, Symmetry};

impl Filling {
    /// Moves the surface to where the colours of `views` agree best at its places and at their images by `symmetry`.
    pub(super) fn settle(&mut self, views: &[Coloured], symmetry: &Symmetry, tuning: &Tuning) {
        let (carving, iterations) = (&tuning.carving, &tuning.iterations);
        let first = self.field.clone();
        let filled = Solid::new(&first, self.th_min).filled(views, tuning);
        let mut moved = Displacement::none(&first);
        for _ in 0..iterations.most_rounds {
            let body = Solid::new(&self.field, self.th_min);
            let mut surface = body.surface(carving);
            surface.par_iter_mut().for_each(|place| self.put_on_level(place, &body, iterations.tolerance));
            let outward = body.normal_displacements(views, symmetry, &surface, tuning);
            moved = moved.then(&Displacement::of(&first, &surface, &outward, body.grid.spacing, carving));
            let before = std::mem::replace(&mut self.field.values, moved.carry(&first));
            let moved_body = Solid::new(&self.field, self.th_min);
            if moved_body.loses_outlines(views, &filled, carving.settled_lost_outline, tuning) {
                self.field.values = before;
                return;
            }
            let squares: f64 = outward.iter().map(|d| d * d).sum();
            if squares <= carving.settled_move * carving.settled_move * outward.len() as f64 {
                return;
            }
        }
    }

    /// Puts a place onto the field's level set, along its normal, to a part `tolerance` of a voxel: in its own voxel or
    /// the next one.
    fn put_on_level(&self, place: &mut Place, body: &Solid, tolerance: f64) {
        let centre = body.grid.centre(body.grid.voxel(place.voxel));
        let along = |t: f64| centre + t * body.grid.spacing * place.normal;
        let (mut inside, mut outside) = (0.0, 2.0);
        if self.field.sample(along(outside)) >= self.th_min {
            return;
        }
        while outside - inside > tolerance {
            let middle = 0.5 * (inside + outside);
            let side = if self.field.sample(along(middle)) >= self.th_min { &mut inside } else { &mut outside };
            *side = middle;
        }
        place.point = along(0.5 * (inside + outside));
    }
}

/// How much colours differ at each depth that is tried.
pub(crate) type Curve = Difference<SWEEP_DEPTHS>;

/// Distance between two depths of the sweep [units].
pub(crate) const DEPTH_STEP: f64 = 0.5;

/// How far outward a depth lies [units].
pub(crate) fn outward(depth: f64) -> f64 {
    DEPTH_STEP * (depth - SWEEP_SURFACE as f64)
}

/// How far outward the depths of the sweep lie [m], in a unit [m].
pub(crate) fn depths_of_sweep(unit: f64) -> [f64; SWEEP_DEPTHS] {
    std::array::from_fn(|k| outward(k as f64) * unit)
}

impl Curve {
    /// Where the curve is least [units outward], by a parabola through its lowest values, and its second derivative
    /// there [1/units^2], that of a squared deviation in units of its variance: differences larger than expected count
    /// for less.
    fn least(&self, largest_difference: f32) -> (f64, f64) {
        let by_difference = |a: &usize, b: &usize| self.squared[*a].total_cmp(&self.squared[*b]);
        let k = (0..SWEEP_DEPTHS).min_by(by_difference).unwrap_or(SWEEP_SURFACE);
        let middle = k.clamp(1, SWEEP_DEPTHS - 2);
        let [a, b, c] = [middle - 1, middle, middle + 1].map(|k| f64::from(self.squared[k]));
        let bend = a - 2.0 * b + c;
        let excess = f64::from(self.squared[k]) / f64::from(self.freedom);
        // Flat, or colours that agree nowhere.
        if self.freedom <= 0.0 || bend <= 0.0 || excess > f64::from(largest_difference) {
            return (0.0, 0.0);
        }
        let shift = (0.5 * (a - c) / bend).clamp(-1.0, 1.0);
        (outward(middle as f64 + shift), bend / (DEPTH_STEP * DEPTH_STEP) / excess.max(1.0))
    }
}

impl Solid {
    /// How far each place of the surface should move outward [voxels].
    fn normal_displacements(
        &self,
        views: &[Coloured],
        symmetry: &Symmetry,
        surface: &[Place],
        tuning: &Tuning,
    ) -> Vec<f64> {
        let depths = depths_of_sweep(self.grid.spacing);
        let around = self.differences_around(views, surface, &depths, tuning);
        let images = symmetry.images();
        let wanted = |place| self.at_images(&around, &images, place).least(tuning.carving.first_tolerance);
        let wanted: Vec<(f64, f64)> = surface.par_iter().map(wanted).collect();
        smoothed(&self.neighbours(surface), &wanted, tuning.carving.neighbour_deviation, tuning)
    }

    /// Places of the surface in the voxels around each of its places.
    fn neighbours(&self, surface: &[Place]) -> Vec<Vec<usize>> {
        let mut numbers = vec![usize::MAX; self.inside.len()];
        surface.iter().enumerate().for_each(|(i, place)| numbers[place.voxel] = i);
        let neighbours = |i: usize| {
            let around = self.grid.around(surface[i].voxel).map(|voxel| numbers[voxel]);
            around.filter(|k| *k != usize::MAX && *k != i).collect()
        };
        (0..surface.len()).into_par_iter().map(neighbours).collect()
    }
}

/// How far places move outward [voxels], of how far each wants to and with which weight, where `neighbours` move
/// alike: Gauss-Seidel's method.
pub(crate) fn smoothed(
    neighbours: &[Vec<usize>],
    wanted: &[(f64, f64)],
    neighbour_deviation: f64,
    tuning: &Tuning,
) -> Vec<f64> {
    let carving = &tuning.carving;
    let (neighbour, own) = (neighbour_deviation.powi(-2), carving.move_deviation.powi(-2));
    let mut moves: Vec<f64> = vec![0.0; wanted.len()];
    for _ in 0..tuning.iterations.most_rounds {
        for i in 0..wanted.len() {
            let (at, weight) = wanted[i];
            let sum: f64 = neighbours[i].iter().map(|k| moves[*k]).sum();
            let total = weight + own + neighbour * neighbours[i].len() as f64;
            moves[i] = (weight * at + neighbour * sum) / total;
        }
    }
    moves
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_of_a_parabola_is_found_exactly() {
        let curve = |at: f64, bend: f64| {
            let value = |k: usize| (bend * (0.5 * (k as f64 - SWEEP_SURFACE as f64) - at).powi(2) + 3.0) as f32;
            Curve { squared: std::array::from_fn(value), freedom: 6.0 }
        };
        for at in [-2.6, -1.13, 0.0, 0.4, 1.7] {
            let (found, bend) = curve(at, 5.0).least(2.88);
            assert!((found - at).abs() < 1e-4 && (bend - 10.0).abs() < 1e-3, "{at}: {found} {bend}");
        }
        assert_eq!(curve(0.3, 0.0).least(2.88), (0.0, 0.0), "flat");
        let nowhere = Curve { freedom: 0.5, ..curve(0.3, 5.0) };
        assert_eq!(nowhere.least(2.88), (0.0, 0.0), "colours that differ at every depth");
        let many = Curve { freedom: 1.5, ..curve(0.5, 5.0) };
        assert!((many.least(2.88).1 - 5.0).abs() < 1e-3, "differences twice as large as expected count half");
    }
}
