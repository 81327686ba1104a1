//! A displacement field on a lattice, for what an affine map cannot follow.

use crate::tuning::CELLS_ALONG_LONGEST_SIDE;
use serde::{Deserialize, Serialize};

/// A regular lattice around the canonical points; values in between are trilinear, beyond it those of its faces.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lattice {
    /// The first node [m].
    pub low: [f64; 3],
    /// Distance of neighbouring nodes [m].
    pub cell: f64,
    /// Nodes along x, y and z, two at least; x runs fastest.
    pub size: [usize; 3],
}

/// The cell of a point: its eight nodes, their weights, and the weights' derivatives with respect to the point [1/m].
struct Corners {
    nodes: [usize; 8],
    weights: [f32; 8],
    slopes: [[f32; 3]; 8],
}

impl Lattice {
    /// A lattice around `points`.
    pub(crate) fn around(points: &[[f32; 3]]) -> Lattice {
        let (mut low, mut high) = ([f64::INFINITY; 3], [f64::NEG_INFINITY; 3]);
        for p in points {
            for axis in 0..3 {
                low[axis] = low[axis].min(f64::from(p[axis]));
                high[axis] = high[axis].max(f64::from(p[axis]));
            }
        }
        let widest = (0..3).map(|axis| high[axis] - low[axis]).fold(0.0, f64::max);
        let cell = if widest > 0.0 && widest.is_finite() { widest / CELLS_ALONG_LONGEST_SIDE } else { 1.0 };
        let size = core::array::from_fn(|axis| {
            ((high[axis] - low[axis]).max(0.0) / cell).ceil().min(CELLS_ALONG_LONGEST_SIDE) as usize + 2
        });
        // Half a cell of room on average on both sides.
        let low = core::array::from_fn(|axis| {
            let middle = 0.5 * (low[axis] + high[axis]);
            if middle.is_finite() { middle - 0.5 * (size[axis] - 1) as f64 * cell } else { 0.0 }
        });
        Lattice { low, cell, size }
    }

    /// How many nodes.
    pub fn nodes(&self) -> usize {
        self.size.iter().product()
    }

    /// Where the nodes are [m].
    pub(crate) fn positions(&self) -> Vec<[f32; 3]> {
        let [nx, ny, _] = self.size;
        let place = |i: usize, axis: usize| (self.low[axis] + i as f64 * self.cell) as f32;
        (0..self.nodes()).map(|n| [place(n % nx, 0), place(n / nx % ny, 1), place(n / (nx * ny), 2)]).collect()
    }

    fn corners(&self, x: [f32; 3]) -> Corners {
        let (mut first, mut share, mut slope) = ([0; 3], [0.0f64; 3], [0.0f64; 3]);
        for axis in 0..3 {
            let last = (self.size[axis] - 1) as f64;
            let place = (f64::from(x[axis]) - self.low[axis]) / self.cell;
            let inside = if place.is_nan() { 0.0 } else { place.clamp(0.0, last) };
            first[axis] = (inside as usize).min(self.size[axis] - 2);
            share[axis] = inside - first[axis] as f64;
            slope[axis] = if inside == place { 1.0 / self.cell } else { 0.0 };
        }
        let [nx, ny, _] = self.size;
        let mut corners = Corners { nodes: [0; 8], weights: [0.0; 8], slopes: [[0.0; 3]; 8] };
        for corner in 0..8 {
            let bit: [usize; 3] = core::array::from_fn(|axis| corner >> axis & 1);
            let [i, j, k]: [usize; 3] = core::array::from_fn(|axis| first[axis] + bit[axis]);
            let factor: [f64; 3] = core::array::from_fn(|a| if bit[a] == 1 { share[a] } else { 1.0 - share[a] });
            let turn = |axis: usize| if bit[axis] == 1 { slope[axis] } else { -slope[axis] };
            corners.nodes[corner] = (k * ny + j) * nx + i;
            corners.weights[corner] = (factor[0] * factor[1] * factor[2]) as f32;
            corners.slopes[corner] =
                core::array::from_fn(|axis| (turn(axis) * factor[(axis + 1) % 3] * factor[(axis + 2) % 3]) as f32);
        }
        corners
    }

    /// The value at a point of the field with `values` at the nodes.
    pub(crate) fn value(&self, values: &[[f32; 3]], x: [f32; 3]) -> [f32; 3] {
        let Corners { nodes, weights, .. } = self.corners(x);
        let mut sum = [0.0; 3];
        for (node, weight) in nodes.into_iter().zip(weights) {
            for axis in 0..3 {
                sum[axis] += weight * values[node][axis];
            }
        }
        sum
    }

    /// Adds a derivative `g` with respect to the value at `x` to that of the nodes' values and of `x`.
    pub(crate) fn pull_back(
        &self,
        values: &[[f32; 3]],
        x: [f32; 3],
        g: [f32; 3],
        d_values: &mut [[f32; 3]],
        d_x: &mut [f32; 3],
    ) {
        let Corners { nodes, weights, slopes } = self.corners(x);
        for ((node, weight), slope) in nodes.into_iter().zip(weights).zip(slopes) {
            let mut along = 0.0;
            for axis in 0..3 {
                d_values[node][axis] += weight * g[axis];
                along += values[node][axis] * g[axis];
            }
            for axis in 0..3 {
                d_x[axis] += slope[axis] * along;
            }
        }
    }

    /// Whether it has the shape of a lattice.
    pub(crate) fn is_valid(&self) -> bool {
        self.cell > 0.0
            && self.cell.is_finite()
            && self.low.iter().all(|x| x.is_finite())
            && self.size.iter().all(|&n| (2..=1 << 10).contains(&n))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points() -> Vec<[f32; 3]> {
        (0..40)
            .map(|i| core::array::from_fn(|k| ((i * (k + 2)) as f32 * 0.9 + 1.0).sin() * 0.1 * (k + 1) as f32))
            .collect()
    }

    #[test]
    fn linear_fields_are_met_exactly_wherever_the_points_are() {
        let lattice = Lattice::around(&points());
        let field = |x: [f32; 3]| [x[0] + 2.0 * x[1], 0.3 - x[2], x[0] - x[1] + x[2]];
        let values: Vec<[f32; 3]> = lattice.positions().into_iter().map(field).collect();
        assert_eq!(values.len(), lattice.nodes());
        for x in points() {
            let (got, wanted) = (lattice.value(&values, x), field(x));
            assert!((0..3).all(|k| (got[k] - wanted[k]).abs() < 1e-5), "{got:?} against {wanted:?}");
        }
    }

    #[test]
    fn pulling_back_agrees_with_finite_differences() {
        let lattice = Lattice::around(&points());
        let mut values: Vec<[f32; 3]> =
            (0..lattice.nodes()).map(|i| core::array::from_fn(|k| ((3 * i + k) as f32).sin())).collect();
        let (g, h) = ([0.7f32, -0.4, 1.1], 1e-3f32);
        let dot = |v: [f32; 3]| (0..3).map(|k| f64::from(v[k]) * f64::from(g[k])).sum::<f64>();
        for x in points().into_iter().step_by(7) {
            let (mut d_values, mut d_x) = (vec![[0.0; 3]; lattice.nodes()], [0.0; 3]);
            lattice.pull_back(&values, x, g, &mut d_values, &mut d_x);
            for axis in 0..3 {
                let nudged = |h: f32| {
                    let mut x = x;
                    x[axis] += h;
                    dot(lattice.value(&values, x))
                };
                let expected = (nudged(0.1 * h) - nudged(-0.1 * h)) / (0.2 * f64::from(h));
                assert!(
                    (f64::from(d_x[axis]) - expected).abs() < 2e-2 * (1.0 + expected.abs()),
                    "{} against {expected}",
                    d_x[axis]
                );
            }
            let touched = (0..lattice.nodes()).filter(|&n| d_values[n] != [0.0; 3]).collect::<Vec<_>>();
            assert!(!touched.is_empty() && touched.len() <= 8);
            for node in touched {
                let kept = values[node][1];
                values[node][1] = kept + h;
                let above = dot(lattice.value(&values, x));
                values[node][1] = kept - h;
                let below = dot(lattice.value(&values, x));
                values[node][1] = kept;
                let expected = (above - below) / (2.0 * f64::from(h));
                assert!((f64::from(d_values[node][1]) - expected).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn odd_points_do_no_harm() {
        for points in [vec![], vec![[0.5; 3]], vec![[f32::NAN; 3]], vec![[0.0; 3], [f32::INFINITY; 3]]] {
            let lattice = Lattice::around(&points);
            assert!(lattice.is_valid(), "{lattice:?}");
            let values = vec![[1.0; 3]; lattice.nodes()];
            for x in [[0.0; 3], [f32::NAN; 3], [1e30; 3]] {
                assert!(lattice.value(&values, x).iter().all(|v| (v - 1.0).abs() < 1e-6));
            }
        }
    }
}
