//! Where colours agree best, to a fraction of a voxel.
//!
//! Carving ends where colours contradict no longer, which is outside of the surface: by as much as a pixel hides. The
//! surface is where they agree best. So every place is tried at several depths along its normal (plane sweep: Collins
//! 1996), the differences of colours around it and around its mirror images are summed at each, and it moves to their
//! minimum: a fraction of a voxel, shared with its neighbours as far as the minimum is flat. With it, the field is
//! carried along, so that edges stay as they are.

use gic_geometry::DensityField;
use glam::DVec3;
use rayon::prelude::*;

use super::coloured::Coloured;
use super::difference::Difference;
use super::place::Place;
use super::solid::{Solid, reach};
use crate::tuning::{CarvingTuning, SWEEP_DEPTHS, SWEEP_SURFACE, Tuning};
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
type Curve = Difference<SWEEP_DEPTHS>;

/// Distance between two depths of the sweep [voxels].
const DEPTH_STEP: f64 = 0.5;

/// How far outward a depth lies [voxels].
fn outward(depth: f64) -> f64 {
    DEPTH_STEP * (depth - SWEEP_SURFACE as f64)
}

impl Curve {
    /// Where the curve is least [voxels outward], by a parabola through its lowest values, and its second derivative
    /// there [1/voxels^2], that of a squared deviation in units of its variance: differences larger than expected count
    /// for less.
    fn least(&self, largest_difference: f32) -> (f64, f64) {
        let k = (0..SWEEP_DEPTHS).min_by(|a, b| self.squared[*a].total_cmp(&self.squared[*b])).unwrap_or(SWEEP_SURFACE);
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
        let depths: [f64; SWEEP_DEPTHS] = std::array::from_fn(|k| outward(k as f64) * self.grid.spacing);
        let around = self.differences_around(views, surface, &depths, tuning);
        let images = symmetry.images();
        let wanted = |place| self.at_images(&around, &images, place).least(tuning.carving.first_tolerance);
        let wanted: Vec<(f64, f64)> = surface.par_iter().map(wanted).collect();
        self.smoothed(surface, &wanted, tuning)
    }

    /// How far places move outward [voxels], of how far each wants to and with which weight, where neighbours move
    /// alike: Gauss-Seidel's method.
    fn smoothed(&self, surface: &[Place], wanted: &[(f64, f64)], tuning: &Tuning) -> Vec<f64> {
        let mut numbers = vec![usize::MAX; self.inside.len()];
        surface.iter().enumerate().for_each(|(i, place)| numbers[place.voxel] = i);
        let neighbours = |i: usize| {
            let around = self.grid.around(surface[i].voxel).map(|voxel| numbers[voxel]);
            around.filter(|k| *k != usize::MAX && *k != i).collect::<Vec<_>>()
        };
        let neighbours: Vec<Vec<usize>> = (0..surface.len()).into_par_iter().map(neighbours).collect();
        let carving = &tuning.carving;
        let (neighbour, own) = (carving.neighbour_deviation.powi(-2), carving.move_deviation.powi(-2));
        let mut moves: Vec<f64> = vec![0.0; surface.len()];
        for _ in 0..tuning.iterations.most_rounds {
            for i in 0..surface.len() {
                let (at, weight) = wanted[i];
                let sum: f64 = neighbours[i].iter().map(|k| moves[*k]).sum();
                let total = weight + own + neighbour * neighbours[i].len() as f64;
                moves[i] = (weight * at + neighbour * sum) / total;
            }
        }
        moves
    }
}

/// How far matter has moved to each voxel of a field [m], by component.
struct Displacement([DensityField; 3]);

impl Displacement {
    fn none(field: &DensityField) -> Displacement {
        let none = || DensityField { values: vec![0.0; field.len()], ..*field };
        Displacement([none(), none(), none()])
    }

    /// Of places that move `outward` along their normals, in a unit [m], spread over the voxels around them.
    fn of(field: &DensityField, surface: &[Place], outward: &[f64], unit: f64, tuning: &CarvingTuning) -> Displacement {
        // The field's voxels are twice as large as those of the surface.
        let deviation = 0.5 * tuning.smoothing_deviation;
        let mut sums = vec![(0.0f64, DVec3::ZERO); field.len()];
        for (place, distance) in surface.iter().zip(outward) {
            let Some(own) = field.discretize(place.point) else { continue };
            for i in field.within(own, reach(deviation).ceil() as usize) {
                let off = (field.centre(field.voxel(i)) - place.point) / (deviation * field.spacing);
                let weight = (-0.5 * off.length_squared()).exp();
                sums[i].0 += weight;
                sums[i].1 += weight * distance * unit * place.normal;
            }
        }
        let mut displacement = Displacement::none(field);
        for (i, (weight, sum)) in sums.into_iter().enumerate().filter(|(_, (weight, _))| *weight > 0.0) {
            displacement.0.iter_mut().zip((sum / weight).to_array()).for_each(|(axis, w)| axis.values[i] = w as f32);
        }
        displacement
    }

    fn at_point(&self, point: DVec3) -> DVec3 {
        let [x, y, z] = &self.0;
        DVec3::new(x.sample(point), y.sample(point), z.sample(point))
    }

    fn at_voxel(&self, i: usize) -> DVec3 {
        let [x, y, z] = &self.0;
        DVec3::new(x.values[i].into(), y.values[i].into(), z.values[i].into())
    }

    /// This displacement, and then another one.
    fn then(&self, later: &Displacement) -> Displacement {
        let mut both = Displacement::none(&self.0[0]);
        let whole = |i: usize| {
            let last = later.at_voxel(i);
            let from = |grid: &DensityField| grid.centre(grid.voxel(i)) - last;
            last + if last == DVec3::ZERO { self.at_voxel(i) } else { self.at_point(from(&self.0[0])) }
        };
        let all: Vec<DVec3> = (0..self.0[0].len()).into_par_iter().map(whole).collect();
        for (i, moved) in all.into_iter().enumerate() {
            both.0.iter_mut().zip(moved.to_array()).for_each(|(axis, w)| axis.values[i] = w as f32);
        }
        both
    }

    /// The values of a field, carried along.
    fn carry(&self, field: &DensityField) -> Vec<f32> {
        let value = |i: usize| {
            let moved = self.at_voxel(i);
            if moved == DVec3::ZERO {
                field.values[i]
            } else {
                field.sample(field.centre(field.voxel(i)) - moved) as f32
            }
        };
        (0..field.len()).into_par_iter().map(value).collect()
    }
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

    /// A ball of 20 voxels across whose density falls linearly over four voxels.
    fn ball(centre: DVec3) -> DensityField {
        let mut field = DensityField::covering(DVec3::ZERO, DVec3::splat(0.32), 0.01, 1).expect("a small field");
        for i in 0..field.len() {
            let depth = 0.1 - field.centre(field.voxel(i)).distance(centre);
            field.values[i] = (0.5 + depth / 0.04).clamp(0.0, 1.0) as f32;
        }
        field
    }

    #[test]
    fn what_is_carried_twice_is_where_it_was_carried_to() {
        let (field, middle) = (ball(DVec3::splat(0.16)), DVec3::splat(0.16));
        let tuning = CarvingTuning::default();
        let body = Solid::new(&field, 0.5);
        let surface = body.surface(&tuning);
        // Outward by three quarters of a voxel, then one way along x by half a voxel, from all places around.
        let grow = Displacement::of(&field, &surface, &vec![1.0; surface.len()], 0.0075, &tuning);
        let along: Vec<f64> = surface.iter().map(|place| place.normal.x).collect();
        let all = Displacement::of(&field, &surface, &along, 0.005, &tuning);
        let grown = DensityField { values: grow.carry(&field), ..field };
        let both = DensityField { values: grow.then(&all).carry(&field), ..field };
        for k in 0..60 {
            let direction = crate::symmetry::direction(k, 60);
            let reach = |field: &DensityField| {
                let samples = (0..400).map(|i| 0.05 + 0.0003 * f64::from(i));
                samples.take_while(|r| field.sample(middle + *r * direction) >= 0.5).last().expect("a middle")
            };
            let (once, twice) = (reach(&grown), reach(&both));
            // A little less than asked: the normals around it differ.
            assert!((once - reach(&field) - 0.0068).abs() < 1e-3, "{direction}: {once}");
            // A way along the normal by the normal's own component moves the level by its square.
            let wanted = once + 0.005 * direction.x;
            assert!((twice - wanted).abs() < 1e-3, "{direction}: {twice} instead of {wanted}");
        }
    }
}
