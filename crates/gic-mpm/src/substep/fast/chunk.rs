//! Chunks: the particles that one thread takes through a pass.

use super::block::Block;
use super::stencils::Window;
use crate::substep::engine::BodyBars;
use crate::substep::grid::Node;

/// Consecutive sorted particles of one body.
pub(super) struct Chunk<T> {
    /// Number of the body.
    pub(super) body: usize,
    /// The particles, in the order of the blocks.
    pub(super) order: Vec<u32>,
    pub(super) blocks: Vec<Block<T>>,
    /// Factors on their masses and volumes, as many as the blocks have room for.
    pub(super) factors: Vec<T>,
    /// The nodes that the chunk may touch: all of the grid's along y and z, some planes along x.
    pub(super) window: Window,
    /// Index in the grid of the window's first node.
    pub(super) first_node: usize,
    /// What the chunk's particles scatter, shape [window's nodes].
    pub(super) slab: Vec<Node<T>>,
    pub(super) flags: Flags,
    /// The states between the substeps, one after the other, if they are to be kept.
    pub(super) tape: Option<Vec<Block<T>>>,
    /// What the reverse pass has summed so far.
    pub(super) bars: BodyBars,
    /// The same for each particle's factor; room is made by the reverse pass.
    pub(super) factor_bars: Vec<T>,
}

/// What went wrong in a chunk.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Flags {
    /// |v| dt > dx or NaN.
    pub(super) too_fast: bool,
    /// A stencil reaches out of the window.
    pub(super) escaped: bool,
}

impl Flags {
    pub(super) fn or(self, other: Self) -> Self {
        Self { too_fast: self.too_fast | other.too_fast, escaped: self.escaped | other.escaped }
    }
}
