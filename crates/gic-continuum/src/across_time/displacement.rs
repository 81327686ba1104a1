//! How far matter moves, as a field over the voxels of a body.

use gic_geometry::{DensityField, TriangleMesh};
use glam::DVec3;
use rayon::prelude::*;

use crate::tuning::AcrossTimeTuning;

/// How far matter has moved to each voxel of a field [m], by component.
pub(super) struct Displacement([DensityField; 3]);

impl Displacement {
    pub(super) fn none(field: &DensityField) -> Displacement {
        let none = || DensityField { values: vec![0.0; field.len()], ..*field };
        Displacement([none(), none(), none()])
    }

    /// Of a surface whose vertices move `outward` along their normals, in a unit [m], spread over the voxels around
    /// them.
    pub(super) fn of(
        field: &DensityField,
        surface: &TriangleMesh,
        outward: &[f64],
        unit: f64,
        tuning: &AcrossTimeTuning,
    ) -> Displacement {
        let deviation = tuning.smoothing_deviation;
        let mut sums = vec![(0.0f64, DVec3::ZERO); field.len()];
        for ((point, normal), distance) in surface.vertices.iter().zip(&surface.normals).zip(outward) {
            let Some(own) = field.discretize(*point) else { continue };
            for i in field.within(own, tuning.reach().ceil() as usize) {
                let off = (field.centre(field.voxel(i)) - *point) / (deviation * field.spacing);
                let weight = (-0.5 * off.length_squared()).exp();
                sums[i].0 += weight;
                sums[i].1 += weight * distance * unit * *normal;
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
    pub(super) fn then(&self, later: &Displacement) -> Displacement {
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

    /// This displacement, and a `share` of the one before.
    pub(super) fn after(mut self, before: &Displacement, share: f32) -> Displacement {
        for (axis, before) in self.0.iter_mut().zip(&before.0) {
            axis.values.iter_mut().zip(&before.values).for_each(|(w, before)| *w += share * before);
        }
        self
    }

    /// The values of a field, carried along.
    pub(super) fn carry(&self, field: &DensityField) -> Vec<f32> {
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
    use crate::Filling;

    const MIDDLE: DVec3 = DVec3::splat(0.16);

    /// A ball of 20 voxels across whose density falls linearly over four voxels.
    fn ball() -> Filling {
        let mut ball = Filling::of_body((DVec3::ZERO, DVec3::splat(0.32)), 0.01, 0.02, |p| p.distance(MIDDLE) - 0.1)
            .expect("a grid");
        for i in 0..ball.field.len() {
            let depth = 0.1 - ball.field.centre(ball.field.voxel(i)).distance(MIDDLE);
            ball.field.values[i] = (0.5 + depth / 0.04).clamp(0.0, 1.0) as f32;
        }
        ball
    }

    #[test]
    fn what_is_carried_twice_is_where_it_was_carried_to() {
        let (ball, tuning) = (ball(), AcrossTimeTuning::default());
        let (field, surface) = (&ball.field, ball.surface_mesh());
        // Outward by three quarters of a voxel, then one way along x by half a voxel, from all places around.
        let grow = Displacement::of(field, &surface, &vec![1.0; surface.vertices.len()], 0.0075, &tuning);
        let along: Vec<f64> = surface.normals.iter().map(|normal| normal.x).collect();
        let all = Displacement::of(field, &surface, &along, 0.005, &tuning);
        let carried = |values: Vec<f32>| DensityField { values, ..*field };
        let (grown, both) = (carried(grow.carry(field)), carried(grow.then(&all).carry(field)));
        for k in 0..60 {
            let direction = crate::symmetry::direction(k, 60);
            let reach = |field: &DensityField| {
                let samples = (0..400).map(|i| 0.05 + 0.0003 * f64::from(i));
                samples.take_while(|r| field.sample(MIDDLE + *r * direction) >= 0.5).last().expect("a middle")
            };
            let (once, twice) = (reach(&grown), reach(&both));
            // A little less than asked: the normals around it differ.
            assert!((once - reach(field) - 0.0068).abs() < 1e-3, "{direction}: {once}");
            // A way along the normal by the normal's own component moves the level by its square.
            let wanted = once + 0.005 * direction.x;
            assert!((twice - wanted).abs() < 1e-3, "{direction}: {twice} instead of {wanted}");
        }
    }
}
