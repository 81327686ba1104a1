//! The grid of cells that carries the body: where its nodes are, what they weigh, and which of them move.

use gic_geometry::TetMesh;
use glam::DVec3;

/// The nodes of a cell move if it is filled by this share. Derived: above what MuJoCo may take for empty.
const LEAST_FILLED_SHARE: f64 = 0.01;
/// Least mass of a node that moves, as a share of that of a node between filled cells. Derived: as MuJoCo's own, for
/// nodes of cells that hold next to nothing.
const LEAST_MASS_SHARE: f64 = 1.0 / 400.0;

/// A grid of cells around a mesh.
pub(super) struct Lattice {
    /// Cells along each axis.
    pub(super) cells: [usize; 3],
    /// The nodes, the last axis fastest, as MuJoCo numbers them.
    pub(super) nodes: Vec<Node>,
    low: DVec3,
    side: DVec3,
}

/// A corner of cells.
pub(super) struct Node {
    /// Name, by its place along the axes.
    pub(super) name: String,
    /// Where it is [m].
    pub(super) position: DVec3,
    /// What it weighs, with those that ride on it [kg].
    pub(super) mass_kg: f64,
    /// The node that it rides on; itself where it moves. A node of cells that hold next to nothing rides on the
    /// nearest that moves, so that what they hold goes with the body: MuJoCo refuses a file in which a node of empty
    /// cells moves on its own, and what it takes for empty is its own rule.
    pub(super) carrier: usize,
}

impl Lattice {
    /// Cells of about `cell` [m] around `mesh`, whose tetrahedra weigh `mass_kg` in all: a quarter of each at each of
    /// its vertices, and that of a vertex at the corners of its cell, as the cell interpolates.
    pub(super) fn around(mesh: &TetMesh, cell: f64, mass_kg: f64) -> Self {
        let low = mesh.vertices.iter().fold(DVec3::INFINITY, |low, p| low.min(*p));
        let high = mesh.vertices.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p));
        let counts = ((high - low) / cell).round().max(DVec3::ONE);
        let cells = counts.to_array().map(|n| n as usize);
        let mut lattice = Self { cells, nodes: Vec::new(), low, side: (high - low) / counts };
        lattice.nodes = places(cells.map(|n| n + 1))
            .map(|place| Node {
                name: format!("node_{}_{}_{}", place[0], place[1], place[2]),
                position: low + lattice.side * DVec3::from(place.map(|n| n as f64)),
                mass_kg: 0.0,
                carrier: usize::MAX,
            })
            .collect();
        lattice.find_carriers(mesh);
        lattice.share_mass(mesh, mass_kg);
        lattice
    }

    /// The nodes that move.
    pub(super) fn moving(&self) -> impl Iterator<Item = &Node> {
        self.nodes.iter().enumerate().filter(|(index, node)| *index == node.carrier).map(|(_, node)| node)
    }

    fn find_carriers(&mut self, mesh: &TetMesh) {
        let mut held_m3 = vec![0.0; self.cells.iter().product()];
        let [_, ny, nz] = self.cells;
        for (corners, volume) in mesh.tetrahedra.iter().zip(mesh.volumes()) {
            let centre = corners.iter().map(|&corner| mesh.vertices[corner as usize]).sum::<DVec3>() / 4.0;
            let [i, j, k] = self.cell_of(centre).0;
            held_m3[(i * ny + j) * nz + k] += volume;
        }
        // A body of which every cell is thin keeps the fullest.
        let fullest = held_m3.iter().copied().fold(0.0, f64::max);
        let least = fullest.min(LEAST_FILLED_SHARE * self.side.element_product());
        let mut moves = vec![false; self.nodes.len()];
        for (cell, _) in places(self.cells).zip(held_m3).filter(|(_, held)| *held >= least) {
            (0..8).for_each(|corner| moves[self.corner_of(cell, corner)] = true);
        }
        let moving: Vec<usize> = (0..moves.len()).filter(|&node| moves[node]).collect();
        for node in 0..self.nodes.len() {
            let distance = |&other: &usize| self.nodes[other].position.distance_squared(self.nodes[node].position);
            let nearest = || moving.iter().copied().min_by(|a, b| distance(a).total_cmp(&distance(b)));
            self.nodes[node].carrier = if moves[node] { node } else { nearest().unwrap_or(node) };
        }
    }

    fn share_mass(&mut self, mesh: &TetMesh, mass_kg: f64) {
        let density = mass_kg / mesh.volume();
        for (corners, volume) in mesh.tetrahedra.iter().zip(mesh.volumes()) {
            for &corner in corners {
                let (cell, share) = self.cell_of(mesh.vertices[corner as usize]);
                for corner in 0..8 {
                    let weight =
                        (0..3).map(|axis| if corner >> axis & 1 == 1 { share[axis] } else { 1.0 - share[axis] });
                    let carrier = self.nodes[self.corner_of(cell, corner)].carrier;
                    self.nodes[carrier].mass_kg += 0.25 * density * volume * weight.product::<f64>();
                }
            }
        }
        let least = LEAST_MASS_SHARE * density * self.side.element_product();
        let moves = |(index, node): &(usize, &mut Node)| *index == node.carrier;
        self.nodes.iter_mut().enumerate().filter(moves).for_each(|(_, node)| node.mass_kg = node.mass_kg.max(least));
        let surplus = self.nodes.iter().map(|node| node.mass_kg).sum::<f64>() / mass_kg;
        self.nodes.iter_mut().for_each(|node| node.mass_kg /= surplus);
    }

    /// The cell that holds a place, and where in it that is, from 0 to 1 along each axis.
    fn cell_of(&self, place: DVec3) -> ([usize; 3], [f64; 3]) {
        let at = ((place - self.low) / self.side).to_array();
        let cell: [usize; 3] = std::array::from_fn(|axis| (at[axis].max(0.0) as usize).min(self.cells[axis] - 1));
        (cell, std::array::from_fn(|axis| at[axis] - cell[axis] as f64))
    }

    /// The node at a corner of a cell, whose bits say at which end of each axis.
    fn corner_of(&self, cell: [usize; 3], corner: usize) -> usize {
        let [i, j, k]: [usize; 3] = std::array::from_fn(|axis| cell[axis] + (corner >> axis & 1));
        (i * (self.cells[1] + 1) + j) * (self.cells[2] + 1) + k
    }
}

/// All places of a grid, the last axis fastest.
fn places([nx, ny, nz]: [usize; 3]) -> impl Iterator<Item = [usize; 3]> {
    (0..nx * ny * nz).map(move |index| [index / (ny * nz), index / nz % ny, index % nz])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nodes_of_cells_that_hold_next_to_nothing_ride_and_the_mass_is_kept() {
        // A unit cube's corner of five tetrahedra, and a thorn of a hundred thousandth on its far side.
        let cube = |bits: usize| DVec3::new((bits & 1) as f64, (bits >> 1 & 1) as f64, (bits >> 2 & 1) as f64);
        let mut vertices: Vec<DVec3> = (0..8).map(cube).collect();
        let thorn = DVec3::new(0.9, 0.9, 0.9);
        vertices.extend([
            thorn,
            thorn + DVec3::X,
            thorn + DVec3::X * 0.9 + DVec3::Y * 0.01,
            thorn + DVec3::X + DVec3::Z * 0.01,
        ]);
        let tetrahedra = vec![[0, 1, 2, 4], [3, 2, 1, 7], [5, 4, 7, 1], [6, 7, 4, 2], [1, 2, 4, 7], [8, 9, 10, 11]];
        let mesh = TetMesh { vertices, tetrahedra };
        let lattice = Lattice::around(&mesh, 1.0, 2.0);
        assert_eq!(lattice.cells, [2, 1, 1]);
        let moving: Vec<&str> = lattice.moving().map(|node| node.name.as_str()).collect();
        assert_eq!(moving.len(), 8, "{moving:?}");
        for node in lattice.nodes.iter().filter(|node| node.name.starts_with("node_2")) {
            let carrier = &lattice.nodes[node.carrier];
            assert_eq!(carrier.name, node.name.replace("node_2", "node_1"), "the nearest that moves");
            assert_eq!(node.mass_kg, 0.0);
        }
        assert!((lattice.nodes.iter().map(|node| node.mass_kg).sum::<f64>() - 2.0).abs() < 1e-12);
    }
}
