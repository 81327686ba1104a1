//! The background grid: a dense box of nodes that follows the particles.
//!
//! A node holds four numbers: momentum (later velocity) and mass. The z index runs fastest.

use glam::IVec3;

/// Momentum [mass units m/s] or velocity [m/s], and mass [mass units].
pub(crate) type Node<R> = [R; 4];

/// A box of nodes; node `(0, 0, 0)` of the box is node `first` of the infinite grid, at `first * spacing`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct GridBox {
    pub(crate) first: IVec3,
    pub(crate) size: [usize; 3],
}

impl GridBox {
    /// The box that holds the stencils of all particles whose stencil bases are within `[lowest, highest]`.
    pub(crate) fn around(lowest: IVec3, highest: IVec3) -> Self {
        // Three nodes per stencil, and a fourth along z because rows are read in fours.
        let size = highest - lowest + IVec3::new(3, 3, 4);
        Self { first: lowest, size: size.to_array().map(|n| n as usize) }
    }

    /// Number of nodes.
    pub(crate) fn nodes(&self) -> usize {
        self.size.iter().product()
    }

    /// Number of nodes in a plane of constant x.
    pub(crate) fn plane(&self) -> usize {
        self.size[1] * self.size[2]
    }

    /// Index of a node in the box.
    #[inline(always)]
    pub(crate) fn index(&self, x: usize, y: usize, z: usize) -> usize {
        (x * self.size[1] + y) * self.size[2] + z
    }
}
