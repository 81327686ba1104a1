//! What surrounds each of many points: how dense matter is there, and where it lies.

use gic_simd::{Kernel, Lanes, Level, dispatch};
use glam::DVec3;

use crate::neighbours::Neighbours;
use crate::weighted_sum::Nearby;

/// The surroundings of a point, itself included.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Surroundings {
    /// Sum of the weights.
    pub weight: f64,
    /// Sum of the weighted ways from the others to the point, in units of the radius; zero where it was not asked for.
    pub offset: DVec3,
}

/// Sums of the weights (1 - (d / radius)^2)^2 within `radius` [m] of each point [m], itself included, shape [n].
pub fn densities(points: &[DVec3], radius: f64) -> Vec<f32> {
    surroundings::<false>(Level::active(), points, radius).iter().map(|around| around.weight as f32).collect()
}

/// Those weights and the weighted ways from the others within `radius` [m] of each point [m], shape [n].
pub fn offsets(points: &[DVec3], radius: f64) -> Vec<Surroundings> {
    surroundings::<true>(Level::active(), points, radius)
}

fn surroundings<const OFFSET: bool>(level: Level, points: &[DVec3], radius: f64) -> Vec<Surroundings> {
    let cells = Neighbours::new(points, radius);
    dispatch(level, Around::<OFFSET> { cells: &cells, scale: 1.0 / radius })
}

struct Around<'a, const OFFSET: bool> {
    /// Cells no smaller than the radius, so that all that counts lies in those around.
    cells: &'a Neighbours,
    scale: f64,
}

impl<const OFFSET: bool> Kernel for Around<'_, OFFSET> {
    type Output = Vec<Surroundings>;

    #[inline(always)]
    fn run<L: Lanes<Scalar = f32>>(self) -> Vec<Surroundings> {
        let cells = self.cells;
        let mut all = vec![Surroundings::default(); cells.len()];
        let mut nearby = Nearby::default();
        for cell in cells.occupied() {
            // Relative to the cell's corner, where single precision is fine enough.
            let origin = cells.corner(cell);
            let scaled = |place: usize| ((cells.point(place) - origin) * self.scale).as_vec3().to_array();
            nearby.gather(cells.around(cell).into_iter().flatten().map(scaled));
            for place in cells.in_cell(cell) {
                let sums = nearby.sums::<L, OFFSET>(scaled(place));
                let offset = DVec3::from_array(sums.offset);
                all[cells.id(place)] = Surroundings { weight: sums.weight, offset };
            }
        }
        all
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
        fn all_levels_agree_with_the_definition(
            points in prop::collection::vec(point(), 1..200), radius in 0.1f64..0.9,
        ) {
            let exact = plain(&points, radius);
            for level in Level::supported() {
                let (with, without) =
                    (surroundings::<true>(level, &points, radius), surroundings::<false>(level, &points, radius));
                for ((found, bare), exact) in with.iter().zip(&without).zip(&exact) {
                    let off = (found.weight - exact.weight).abs().max((found.offset - exact.offset).length());
                    prop_assert!(off < 1e-5 * exact.weight, "{level}: {found:?} {exact:?}");
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
