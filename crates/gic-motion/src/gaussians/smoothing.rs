//! Sharing the pull on a point with its neighbours, so that a surface moves as a surface.
//!
//! Pictures pull each Gaussian its own way, and where few cameras look, noise wins: the surface turns into a cloud that
//! fits the pictures it was trained on. Preconditioning the gradient with `(I + s^2 L)^-1`, where L is the Laplacian of
//! the graph of nearest neighbours, is the steepest descent under a metric in which rough displacements are long
//! (Nicolet et al. 2021, "Large steps in inverse rendering of geometry", there for meshes): neighbours move alike over
//! about s spacings, no place is ruled out.

use crate::tuning::{MAX_SMOOTHING_ITERATIONS, NEIGHBOURS, SEARCH_RADIUS_SPACINGS, SMOOTHING_TOLERANCE};
use rayon::prelude::*;

/// Which points are neighbours; symmetric.
#[derive(Clone, Debug, Default)]
pub(crate) struct NeighbourGraph {
    /// The neighbours of point i are `others[starts[i]..starts[i + 1]]`.
    starts: Vec<usize>,
    others: Vec<u32>,
}

impl NeighbourGraph {
    /// Connects each point with its nearest ones within about twice `spacing` [m].
    pub(crate) fn new(positions: &[[f32; 3]], spacing: f64) -> NeighbourGraph {
        let grid = Grid::new(positions, SEARCH_RADIUS_SPACINGS * spacing);
        let nearest: Vec<Vec<u32>> = (0..positions.len()).into_par_iter().map(|i| grid.nearest(positions, i)).collect();
        let mut pairs: Vec<(u32, u32)> = Vec::with_capacity(2 * NEIGHBOURS * positions.len());
        for (i, list) in nearest.iter().enumerate() {
            for &j in list {
                pairs.push((i as u32, j));
                pairs.push((j, i as u32));
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        let mut starts = vec![0; positions.len() + 1];
        for &(i, _) in &pairs {
            starts[i as usize + 1] += 1;
        }
        for i in 0..positions.len() {
            starts[i + 1] += starts[i];
        }
        NeighbourGraph { starts, others: pairs.into_iter().map(|(_, j)| j).collect() }
    }

    /// How many points it was made for.
    pub(crate) fn len(&self) -> usize {
        self.starts.len().saturating_sub(1)
    }

    /// `x + weight L x` for one axis, with L the Laplacian divided by the usual number of neighbours.
    fn apply(&self, weight: f32, x: &[f32], out: &mut [f32]) {
        let weight = weight / NEIGHBOURS as f32;
        for (i, out) in out.iter_mut().enumerate() {
            let others = &self.others[self.starts[i]..self.starts[i + 1]];
            let sum: f32 = others.iter().map(|&j| x[j as usize]).sum();
            *out = x[i] + weight * (others.len() as f32 * x[i] - sum);
        }
    }

    /// Replaces each vector field value by the solution of `(I + reach^2 L) y = value`; `reach` counts spacings.
    pub(crate) fn smooth(&self, reach: f64, values: &mut [[f32; 3]]) {
        assert_eq!(values.len(), self.len(), "one value per point");
        let weight = (reach * reach) as f32;
        let axes: Vec<Vec<f32>> = (0..3usize)
            .into_par_iter()
            .map(|axis| self.solve(weight, &values.iter().map(|v| v[axis]).collect::<Vec<f32>>()))
            .collect();
        for (i, value) in values.iter_mut().enumerate() {
            *value = core::array::from_fn(|axis| axes[axis][i]);
        }
    }

    /// Adds to `slope` the derivative of `weight` times the mean over points of half their squared distances
    /// [spacings^2] to their neighbours, and returns its value: the tension of a film. What no picture holds gives way
    /// to it.
    pub(crate) fn tension(&self, weight: f64, positions: &[[f32; 3]], spacing: f64, slope: &mut [[f32; 3]]) -> f64 {
        let unit = weight / (NEIGHBOURS * positions.len().max(1)) as f64 / (spacing * spacing);
        let mut sum = 0.0;
        for (i, slope) in slope.iter_mut().enumerate() {
            for &j in &self.others[self.starts[i]..self.starts[i + 1]] {
                for axis in 0..3 {
                    let d = f64::from(positions[i][axis]) - f64::from(positions[j as usize][axis]);
                    // Each pair is met twice.
                    sum += 0.25 * d * d;
                    slope[axis] += (unit * d) as f32;
                }
            }
        }
        unit * sum
    }

    /// Conjugate gradients from zero.
    fn solve(&self, weight: f32, right: &[f32]) -> Vec<f32> {
        let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
        let mut x = vec![0.0f32; right.len()];
        let mut residual = right.to_vec();
        let mut direction = residual.clone();
        let mut image = vec![0.0f32; right.len()];
        let mut size = dot(&residual, &residual);
        let enough = SMOOTHING_TOLERANCE * SMOOTHING_TOLERANCE * size;
        for _ in 0..MAX_SMOOTHING_ITERATIONS {
            if size <= enough {
                break;
            }
            self.apply(weight, &direction, &mut image);
            let step = (size / dot(&direction, &image)) as f32;
            for i in 0..x.len() {
                x[i] += step * direction[i];
                residual[i] -= step * image[i];
            }
            let before = size;
            size = dot(&residual, &residual);
            let turn = (size / before) as f32;
            for (d, r) in direction.iter_mut().zip(&residual) {
                *d = r + turn * *d;
            }
        }
        x
    }
}

/// A graph of neighbours, and the points as they were when it was made; a checkpoint holds them.
#[derive(Clone, Debug, Default)]
pub(crate) struct SmoothingGraph {
    positions: Vec<[f32; 3]>,
    graph: NeighbourGraph,
}

impl SmoothingGraph {
    pub(crate) fn new(positions: Vec<[f32; 3]>, spacing: f64) -> SmoothingGraph {
        SmoothingGraph { graph: NeighbourGraph::new(&positions, spacing), positions }
    }

    pub(crate) fn positions(&self) -> &[[f32; 3]] {
        &self.positions
    }

    pub(crate) fn graph(&self) -> &NeighbourGraph {
        &self.graph
    }
}

/// Points sorted by the cell of a grid that they lie in.
struct Grid {
    cell: f32,
    /// (cell, point), sorted.
    sorted: Vec<([i32; 3], u32)>,
}

impl Grid {
    fn new(positions: &[[f32; 3]], cell: f64) -> Grid {
        let cell = cell as f32;
        let mut sorted: Vec<([i32; 3], u32)> =
            positions.iter().enumerate().map(|(i, p)| (Self::cell_of(p, cell), i as u32)).collect();
        sorted.sort_unstable();
        Grid { cell, sorted }
    }

    /// Casts saturate, and NaN goes to 0: no position is too odd to have a cell.
    fn cell_of(p: &[f32; 3], cell: f32) -> [i32; 3] {
        p.map(|x| ((x / cell).floor() as i32).clamp(-(1 << 30), 1 << 30))
    }

    /// The nearest points of the 27 cells around point `i`, at most [`NEIGHBOURS`].
    fn nearest(&self, positions: &[[f32; 3]], i: usize) -> Vec<u32> {
        let here = positions[i];
        let middle = Self::cell_of(&here, self.cell);
        let mut found: Vec<(f32, u32)> = Vec::new();
        for dx in -1..=1 {
            for dy in -1..=1 {
                // The three cells along the last axis lie one after the other.
                let first = [middle[0] + dx, middle[1] + dy, middle[2] - 1];
                let last = [first[0], first[1], middle[2] + 1];
                let start = self.sorted.partition_point(|(cell, _)| *cell < first);
                let row = self.sorted[start..].iter().take_while(|(cell, _)| *cell <= last);
                found.extend(row.filter(|(_, j)| *j as usize != i).map(|&(_, j)| {
                    let p = positions[j as usize];
                    ((0..3).map(|k| (p[k] - here[k]).powi(2)).sum(), j)
                }));
            }
        }
        found.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        found.truncate(NEIGHBOURS);
        found.into_iter().map(|(_, j)| j).collect()
    }
}

#[cfg(test)]
mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    fn cloud(n: usize) -> Vec<[f32; 3]> {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        (0..n).map(|_| core::array::from_fn(|_| rng.random_range(-1.0..1.0))).collect()
    }

    #[test]
    fn neighbours_are_the_nearest_and_mutual() {
        let positions = cloud(400);
        let reach = 0.4;
        let graph = NeighbourGraph::new(&positions, reach / SEARCH_RADIUS_SPACINGS);
        let distance = |i: usize, j: usize| (0..3).map(|k| (positions[i][k] - positions[j][k]).powi(2)).sum::<f32>();
        let list = |i: usize| &graph.others[graph.starts[i]..graph.starts[i + 1]];
        for i in 0..positions.len() {
            let mut others: Vec<usize> = (0..positions.len()).filter(|&j| j != i).collect();
            others.sort_by(|&a, &b| distance(i, a).total_cmp(&distance(i, b)));
            // Everything within the reach is looked at; what is farther may be left out.
            for &j in others.iter().take(NEIGHBOURS).filter(|&&j| distance(i, j).sqrt() < reach as f32) {
                assert!(list(i).contains(&(j as u32)), "{j} is near {i}");
            }
            for &j in list(i) {
                assert!(list(j as usize).contains(&(i as u32)), "{i} and {j}");
            }
        }
    }

    #[test]
    fn smoothing_solves_its_equation_keeps_the_sum_and_lessens_differences() {
        let positions = cloud(500);
        let graph = NeighbourGraph::new(&positions, 0.2);
        let mut rng = ChaCha8Rng::seed_from_u64(4);
        let values: Vec<[f32; 3]> = (0..500).map(|_| core::array::from_fn(|_| rng.random_range(-1.0..1.0))).collect();
        let mut smoothed = values.clone();
        graph.smooth(3.0, &mut smoothed);
        for axis in 0..3 {
            let column = |v: &[[f32; 3]]| v.iter().map(|v| v[axis]).collect::<Vec<f32>>();
            let (right, x) = (column(&values), column(&smoothed));
            let mut image = vec![0.0; 500];
            graph.apply(9.0, &x, &mut image);
            let norm = |v: &[f32]| v.iter().map(|x| x * x).sum::<f32>().sqrt();
            let error: Vec<f32> = image.iter().zip(&right).map(|(a, b)| a - b).collect();
            assert!(norm(&error) < 2.0 * SMOOTHING_TOLERANCE as f32 * norm(&right));
            assert!(norm(&x) < 0.5 * norm(&right), "noise averages out");
        }
        // A common pull stays what it is: L of a constant is zero.
        let mut pull = vec![[1.0f32, -2.0, 0.5]; 500];
        graph.smooth(3.0, &mut pull);
        assert!(pull.iter().all(|v| (v[0] - 1.0).abs() < 1e-3 && (v[1] + 2.0).abs() < 1e-3));
    }

    #[test]
    fn tension_agrees_with_finite_differences() {
        let positions = cloud(60);
        let graph = NeighbourGraph::new(&positions, 0.4);
        let value = |p: &[[f32; 3]]| graph.tension(7.0, p, 0.4, &mut vec![[0.0; 3]; 60]);
        let mut slope = vec![[1.0f32; 3]; 60];
        graph.tension(7.0, &positions, 0.4, &mut slope);
        for (i, axis) in [(0, 0), (13, 1), (59, 2)] {
            let nudged = |h: f32| {
                let mut p = positions.clone();
                p[i][axis] += h;
                value(&p)
            };
            let expected = (nudged(1e-2) - nudged(-1e-2)) / 2e-2;
            let got = f64::from(slope[i][axis]) - 1.0;
            assert!(expected.abs() > 1e-3 && (got - expected).abs() < 1e-4, "{got} against {expected}");
        }
    }

    #[test]
    fn odd_positions_do_no_harm() {
        let positions = [[f32::NAN; 3], [f32::INFINITY, 0.0, 0.0], [0.0; 3], [0.0; 3], [1e30; 3]];
        let graph = NeighbourGraph::new(&positions, 0.1);
        assert_eq!(graph.len(), 5);
        let mut values = [[1.0f32; 3]; 5];
        graph.smooth(2.0, &mut values);
        assert!(values.iter().flatten().all(|v| v.is_finite()));
        NeighbourGraph::new(&[], 0.1).smooth(1.0, &mut []);
    }
}
