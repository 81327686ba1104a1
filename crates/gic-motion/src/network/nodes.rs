//! The network at the nodes of a lattice around the points, and what lies between: neighbours move almost alike, so a
//! network asked once per node instead of once per point costs a fraction and leaves time for more points.

use std::collections::HashMap;

use foldhash::fast::FixedState;
use rayon::prelude::*;

use super::{MIN_BLOCK_ROWS, RESIDUALS, Scalar};

/// Cells further from the origin than this are no places (and would not fit the numbers of cells).
const MAX_CELL: f64 = 1e6;

/// The corners of all cells that hold points.
pub(super) struct Nodes<T> {
    spacing: f64,
    /// Where the nodes are, shape [m, 3].
    pub(super) positions: Vec<[T; 3]>,
    /// The eight nodes of each cell; bit 0 of the corner's number is the step along x, bit 1 along y, bit 2 along z.
    cells: Vec<[u32; 8]>,
    places: Vec<Place<T>>,
}

/// Where one point is.
struct Place<T> {
    cell: u32,
    /// How far through the cell along each axis, 0 to 1.
    share: [T; 3],
}

impl<T: Scalar> Nodes<T> {
    /// The nodes around `points`, numbered in the order in which the points meet them.
    pub(super) fn around(points: &[[T; 3]], spacing: f64) -> Nodes<T> {
        let mut nodes =
            Nodes { spacing, positions: Vec::new(), cells: Vec::new(), places: Vec::with_capacity(points.len()) };
        // Places are no secret: a fast hash will do.
        let mut cell_of: HashMap<[i32; 3], u32, FixedState> = HashMap::default();
        let mut node_of: HashMap<[i32; 3], u32, FixedState> = HashMap::default();
        for point in points {
            let place = point.map(|x| (x.to_f64() / spacing).clamp(-MAX_CELL, MAX_CELL));
            let first = place.map(|x| x.floor() as i32);
            let cell = *cell_of.entry(first).or_insert_with(|| {
                nodes.cells.push(core::array::from_fn(|corner| {
                    let at: [i32; 3] = core::array::from_fn(|axis| first[axis] + step(corner, axis) as i32);
                    *node_of.entry(at).or_insert_with(|| {
                        nodes.positions.push(at.map(|i| T::of(f64::from(i) * spacing)));
                        nodes.positions.len() as u32 - 1
                    })
                }));
                nodes.cells.len() as u32 - 1
            });
            let share = core::array::from_fn(|axis| T::of(place[axis] - f64::from(first[axis])));
            nodes.places.push(Place { cell, share });
        }
        nodes
    }

    /// The value at each point, trilinear in those of its nodes.
    pub(super) fn spread(&self, values: &[[T; RESIDUALS]]) -> Vec<[T; RESIDUALS]> {
        let at = |place: &Place<T>| {
            let mut sum = [T::of(0.0); RESIDUALS];
            for (corner, &node) in self.cells[place.cell as usize].iter().enumerate() {
                let weight = weight(place, corner);
                for (s, v) in sum.iter_mut().zip(values[node as usize]) {
                    *s += weight * v;
                }
            }
            sum
        };
        self.places.par_iter().with_min_len(MIN_BLOCK_ROWS).map(at).collect()
    }

    /// Derivatives with respect to the nodes' values and the points' positions from those with respect to the points'
    /// values.
    pub(super) fn pull_back(
        &self,
        values: &[[T; RESIDUALS]],
        d: &[[T; RESIDUALS]],
    ) -> (Vec<[T; RESIDUALS]>, Vec<[T; 3]>) {
        let position = |(place, d): (&Place<T>, &[T; RESIDUALS])| {
            let mut d_position = [T::of(0.0); 3];
            for (corner, &node) in self.cells[place.cell as usize].iter().enumerate() {
                let [fx, fy, fz] = core::array::from_fn(|axis| factor(place, corner, axis));
                let mut along = T::of(0.0);
                for i in 0..RESIDUALS {
                    along += values[node as usize][i] * d[i];
                }
                for (axis, others) in [fy * fz, fx * fz, fx * fy].into_iter().enumerate() {
                    let slope = if step(corner, axis) { others } else { -others };
                    d_position[axis] += slope * along;
                }
            }
            d_position.map(|x| T::of(1.0 / self.spacing) * x)
        };
        let d_positions = self.places.par_iter().zip(d).with_min_len(MIN_BLOCK_ROWS).map(position).collect();
        let mut d_values = vec![[T::of(0.0); RESIDUALS]; values.len()];
        for (nodes, d_corners) in self.cells.iter().zip(self.corner_sums(d)) {
            for (&node, d) in nodes.iter().zip(d_corners) {
                for (sum, d) in d_values[node as usize].iter_mut().zip(d) {
                    *sum += d;
                }
            }
        }
        (d_values, d_positions)
    }

    /// For each cell what its points say of the values at its corners, in the order of the points.
    fn corner_sums(&self, d: &[[T; RESIDUALS]]) -> Vec<[[T; RESIDUALS]; 8]> {
        let mut starts = vec![0u32; self.cells.len() + 1];
        for place in &self.places {
            starts[place.cell as usize + 1] += 1;
        }
        for cell in 1..starts.len() {
            starts[cell] += starts[cell - 1];
        }
        let (mut next, mut members) = (starts.clone(), vec![0u32; self.places.len()]);
        for (i, place) in self.places.iter().enumerate() {
            members[next[place.cell as usize] as usize] = i as u32;
            next[place.cell as usize] += 1;
        }
        let sum = |cell: usize| {
            let mut sums = [[T::of(0.0); RESIDUALS]; 8];
            for &i in &members[starts[cell] as usize..starts[cell + 1] as usize] {
                let place = &self.places[i as usize];
                for (corner, sum) in sums.iter_mut().enumerate() {
                    let weight = weight(place, corner);
                    for (sum, d) in sum.iter_mut().zip(d[i as usize]) {
                        *sum += weight * d;
                    }
                }
            }
            sums
        };
        (0..self.cells.len()).into_par_iter().with_min_len(MIN_BLOCK_ROWS).map(sum).collect()
    }
}

/// Whether a corner lies one step along an axis.
fn step(corner: usize, axis: usize) -> bool {
    corner >> axis & 1 == 1
}

/// The share of a corner's value at a place.
fn weight<T: Scalar>(place: &Place<T>, corner: usize) -> T {
    factor(place, corner, 0) * factor(place, corner, 1) * factor(place, corner, 2)
}

/// What an axis contributes to the weight of a corner.
fn factor<T: Scalar>(place: &Place<T>, corner: usize, axis: usize) -> T {
    if step(corner, axis) { place.share[axis] } else { T::of(1.0) - place.share[axis] }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn points() -> Vec<[f64; 3]> {
        (0..60).map(|i| core::array::from_fn(|k| ((i * (k + 2)) as f64 * 0.9 + 1.0).sin() * 0.4)).collect()
    }

    #[test]
    fn linear_fields_are_met_exactly() {
        let nodes = Nodes::around(&points(), 0.07);
        let field = |[x, y, z]: [f64; 3]| [x + 2.0 * y, 0.3 - z, x - y + z, 1.0];
        let values: Vec<_> = nodes.positions.iter().copied().map(field).collect();
        for (x, got) in points().into_iter().zip(nodes.spread(&values)) {
            assert!(got.iter().zip(field(x)).all(|(g, w)| (g - w).abs() < 1e-12), "{got:?} at {x:?}");
        }
    }

    #[test]
    fn cells_share_their_nodes() {
        let nodes = Nodes::around(&[[0.25, 0.25, 0.25], [0.75, 0.25, 0.25], [0.26, 0.2, 0.2]], 0.5);
        assert_eq!((nodes.positions.len(), nodes.cells.len()), (12, 2));
    }

    #[test]
    fn places_that_are_none_do_no_harm() {
        let nodes = Nodes::around(&[[f64::NAN, 0.0, 0.0], [f64::INFINITY, -1e300, 0.0], [0.1, 0.1, 0.1]], 0.5);
        let values = vec![[1.0; 4]; nodes.positions.len()];
        assert!(nodes.spread(&values)[2].iter().all(|v| (v - 1.0).abs() < 1e-12));
    }
}
