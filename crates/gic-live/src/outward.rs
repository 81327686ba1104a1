//! Which way is outside, for the light on the particles.

use glam::{DVec3, IVec3};

/// Side of a cell in spacings. Derived: a cell and its neighbours hold what decides about a surface.
const CELL_SPACINGS: f64 = 1.5;
/// Most cells: a body in pieces far apart gets larger ones. Budget: memory.
const MAX_CELLS: f64 = 2e6;

/// For particles about `spacing` [m] apart: minus the slope of their number per cell, at most of length 1, shape [n];
/// about of length 1 at a surface, short within.
pub(crate) fn outward(positions: &[DVec3], spacing: f64) -> Vec<[f32; 3]> {
    let low = positions.iter().fold(DVec3::INFINITY, |low, p| low.min(*p));
    let high = positions.iter().fold(DVec3::NEG_INFINITY, |high, p| high.max(*p));
    let cells_at = |side: f64| ((high - low) / side + 4.0).element_product();
    let mut side = CELL_SPACINGS * spacing;
    while cells_at(side) > MAX_CELLS {
        side *= 2.0;
    }
    let grid = CountGrid::of(positions, low - side, side, ((high - low) / side).as_ivec3() + 4);
    let full = (side / spacing).powi(3);
    positions.iter().map(|p| (-grid.slope(*p) / full).clamp_length_max(1.0).as_vec3().to_array()).collect()
}

/// How many particles there are around each node, by linear shares.
struct CountGrid {
    first: DVec3,
    side: f64,
    size: IVec3,
    counts: Vec<f64>,
}

impl CountGrid {
    fn of(positions: &[DVec3], first: DVec3, side: f64, size: IVec3) -> Self {
        let counts = vec![0.0; size.element_product() as usize];
        let mut grid = Self { first, side, size, counts };
        for p in positions {
            let (base, within) = grid.place(*p);
            for corner in corners() {
                let share = (DVec3::ONE - within - corner.as_dvec3()).abs().element_product();
                let index = grid.index(base + corner);
                grid.counts[index] += share;
            }
        }
        grid
    }

    /// The node below a point and the point's place above it, in cells.
    fn place(&self, p: DVec3) -> (IVec3, DVec3) {
        let at = (p - self.first) / self.side;
        (at.floor().as_ivec3(), at - at.floor())
    }

    fn index(&self, node: IVec3) -> usize {
        let node = node.clamp(IVec3::ZERO, self.size - 1);
        ((node.x * self.size.y + node.y) * self.size.z + node.z) as usize
    }

    /// Central differences at the nodes around a point, by linear shares [1 / cell].
    fn slope(&self, p: DVec3) -> DVec3 {
        let (base, within) = self.place(p);
        let at = |node: IVec3| self.counts[self.index(node)];
        corners()
            .map(|corner| {
                let (share, node) = ((DVec3::ONE - within - corner.as_dvec3()).abs().element_product(), base + corner);
                let along = |axis: IVec3| 0.5 * (at(node + axis) - at(node - axis));
                share * DVec3::new(along(IVec3::X), along(IVec3::Y), along(IVec3::Z))
            })
            .sum()
    }
}

/// The corners of a cell.
fn corners() -> impl Iterator<Item = IVec3> {
    (0..8).map(|n| IVec3::new(n & 1, n >> 1 & 1, n >> 2))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::live_simulation::tests::falling_block;

    #[test]
    fn sides_look_outwards() {
        let body = falling_block().bodies.remove(0);
        let normals = outward(&body.positions, body.particle_volume_m3.cbrt());
        let centre = body.positions.iter().sum::<DVec3>() / body.positions.len() as f64;
        let far = body.positions.iter().map(|p| p.x - centre.x).fold(0.0, f64::max);
        for (p, n) in body.positions.iter().zip(normals) {
            let n = DVec3::from(n.map(f64::from));
            let from_centre = *p - centre;
            if from_centre.abs().max_element() < 0.4 * far {
                assert!(n.length() < 0.1, "inside: {n}");
            }
            if (from_centre.x - far).abs() < 1e-9 && from_centre.y.abs().max(from_centre.z.abs()) < 0.5 * far {
                assert!(n.normalize().x > 0.99 && n.length() > 0.3, "a side: {n}");
            }
        }
    }
}
