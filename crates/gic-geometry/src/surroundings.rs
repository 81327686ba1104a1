//! Weighted sums over what surrounds each of many points: how dense matter is there, and where it lies.
//!
//! The weight falls from 1 at the point itself to 0 at the radius as (1 - (d / radius)^2)^2, so that sums change smoothly as points move.

use std::ops::Range;

use gic_simd::{Kernel, Lanes, Level, MAX_LANES, dispatch};
use glam::DVec3;

use crate::Neighbours;

/// The surroundings of a point, itself included.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Surroundings {
    /// Sum of the weights.
    pub weight: f64,
    /// Sum of the weighted ways from the others to the point, in units of the radius; zero where it was not asked for.
    pub offset: DVec3,
}

/// Sums of the weights within `radius` [m] of each point, shape [n].
pub fn densities(points: &[DVec3], radius: f64) -> Vec<f32> {
    surroundings::<false>(Level::active(), points, radius).iter().map(|around| around.weight as f32).collect()
}

/// Weights and weighted ways within `radius` [m] of each point, shape [n].
pub fn offsets(points: &[DVec3], radius: f64) -> Vec<Surroundings> {
    surroundings::<true>(Level::active(), points, radius)
}

fn surroundings<const OFFSET: bool>(level: Level, points: &[DVec3], radius: f64) -> Vec<Surroundings> {
    let cells = Neighbours::new(points, radius);
    dispatch(level, Sums::<OFFSET> { cells: &cells, scale: 1.0 / radius })
}

struct Sums<'a, const OFFSET: bool> {
    /// Cells no smaller than the radius, so that all that counts lies in those around.
    cells: &'a Neighbours,
    scale: f64,
}

impl<const OFFSET: bool> Kernel for Sums<'_, OFFSET> {
    type Output = Vec<Surroundings>;

    #[inline(always)]
    fn run<L: Lanes<Scalar = f32>>(self) -> Vec<Surroundings> {
        let cells = self.cells;
        let mut all = vec![Surroundings::default(); cells.len()];
        let mut around = Around::default();
        for cell in cells.occupied() {
            let origin = cells.corner(cell);
            around.gather(cells, cell, origin, self.scale);
            for i in cells.in_cell(cell) {
                let p = ((cells.point(i) - origin) * self.scale).as_vec3().to_array();
                all[cells.id(i)] = around.sum::<L, OFFSET>(p);
            }
        }
        all
    }
}

/// Points in and around one cell, relative to its corner and in units of the radius.
#[derive(Default)]
struct Around {
    axes: [Vec<f32>; 3],
}

impl Around {
    /// Too far away to weigh anything, and no infinity when squared.
    const NOWHERE: f32 = 1e9;

    fn gather(&mut self, cells: &Neighbours, cell: usize, origin: DVec3, scale: f64) {
        self.axes.iter_mut().for_each(Vec::clear);
        let runs: [Range<usize>; 9] = cells.around(cell);
        for i in runs.into_iter().flatten() {
            let p = ((cells.point(i) - origin) * scale).as_vec3().to_array();
            self.axes.iter_mut().zip(p).for_each(|(axis, x)| axis.push(x));
        }
        let whole = self.axes[0].len().next_multiple_of(MAX_LANES);
        self.axes.iter_mut().for_each(|axis| axis.resize(whole, Self::NOWHERE));
    }

    #[inline(always)]
    fn sum<L: Lanes<Scalar = f32>, const OFFSET: bool>(&self, p: [f32; 3]) -> Surroundings {
        let [xs, ys, zs] = &self.axes;
        let (px, py, pz) = (L::of(p[0]), L::of(p[1]), L::of(p[2]));
        let (mut total, mut x, mut y, mut z) = (L::zero(), L::zero(), L::zero(), L::zero());
        for at in (0..xs.len()).step_by(L::LANES) {
            let (dx, dy, dz) = (px - L::load(&xs[at..]), py - L::load(&ys[at..]), pz - L::load(&zs[at..]));
            let left = L::one() - dx.mul_add(dx, dy.mul_add(dy, dz * dz));
            // Phrased so that points that are no numbers weigh nothing.
            let near = L::lt(L::zero(), left);
            let weight = L::select(near, left * left, L::zero());
            total += weight;
            if OFFSET {
                x = weight.mul_add(L::select(near, dx, L::zero()), x);
                y = weight.mul_add(L::select(near, dy, L::zero()), y);
                z = weight.mul_add(L::select(near, dz, L::zero()), z);
            }
        }
        let offset = DVec3::new(x.sum_lanes(), y.sum_lanes(), z.sum_lanes());
        Surroundings { weight: total.sum_lanes(), offset }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The definition, point by point.
    fn plain(points: &[DVec3], radius: f64) -> Vec<Surroundings> {
        let around = |p: &DVec3| {
            let mut sum = Surroundings::default();
            for q in points {
                let d = (*p - *q) / radius;
                let weight = (1.0 - d.length_squared()).max(0.0).powi(2);
                sum.weight += weight;
                sum.offset += weight * d;
            }
            sum
        };
        points.iter().map(around).collect()
    }

    fn point() -> impl Strategy<Value = DVec3> {
        (-1.0f64..1.0, -1.0f64..1.0, -1.0f64..1.0).prop_map(|(x, y, z)| DVec3::new(x, y, z))
    }

    proptest! {
        #[test]
        fn all_levels_agree_with_the_definition(points in prop::collection::vec(point(), 1..200), radius in 0.1f64..0.9) {
            let exact = plain(&points, radius);
            for level in Level::supported() {
                let (with, without) =
                    (surroundings::<true>(level, &points, radius), surroundings::<false>(level, &points, radius));
                for ((found, bare), exact) in with.iter().zip(&without).zip(&exact) {
                    prop_assert!((found.weight - exact.weight).abs() < 1e-5 * exact.weight, "{level}: {found:?} {exact:?}");
                    prop_assert!((found.offset - exact.offset).length() < 1e-5 * exact.weight, "{level}: {found:?} {exact:?}");
                    prop_assert_eq!(bare.weight, found.weight);
                }
            }
        }
    }

    #[test]
    fn points_that_are_no_numbers_weigh_nothing() {
        let known = [DVec3::ZERO, DVec3::new(0.5, 0.0, 0.0)];
        for at in 0..=known.len() {
            let mut points = known.to_vec();
            points.insert(at, DVec3::NAN);
            let mut found = offsets(&points, 1.0);
            assert_eq!(found.remove(at).weight, 0.0);
            assert_eq!(found, plain(&known, 1.0));
        }
    }
}
