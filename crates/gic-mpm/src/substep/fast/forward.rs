//! The forward pass over a chunk: from the grid of one substep to that of the next (g2p, then law and p2g) while the
//! particles are in cache.

use gic_simd::{Kernel, Lanes, Scalar};

use super::chunk::Chunk;
use super::g2p::g2p;
use super::p2g::p2g;
use super::scatter::Pending;
use super::step::{Scratch, Step, packs, prefetch_next};
use crate::substep::grid::Node;

/// One pass of the forward direction over a chunk.
pub(super) struct Forward<'a, T> {
    pub(super) step: Step<'a>,
    pub(super) chunk: &'a mut Chunk<T>,
    /// Velocities of the grid, to gather from; none in the first pass of a segment.
    pub(super) velocities: Option<&'a [Node<T>]>,
    /// Whether to go on to the law and the scattering; not in the last pass of a segment.
    pub(super) scatter: bool,
}

impl<T: Scalar> Kernel<T> for Forward<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes<Scalar = T>>(self) {
        let mut scratch = Scratch::new();
        let mut pending = Pending::<L>::none();
        let particles = self.chunk.order.len();
        if self.scatter {
            self.chunk.slab.fill([T::zero(); 4]);
        }
        for b in 0..self.chunk.blocks.len() {
            prefetch_next(&self.chunk.blocks, b);
            if let Some(velocities) = self.velocities {
                for (at, _) in packs::<L>(b, particles) {
                    g2p::<L>(self.step, self.chunk, b, at, velocities, &mut scratch);
                }
            }
            if let Some(tape) = &mut self.chunk.tape {
                tape.push(self.chunk.blocks[b]);
            }
            if self.scatter {
                for (at, count) in packs::<L>(b, particles) {
                    p2g::<L>(self.step, self.chunk, b, at, count, &mut scratch, &mut pending);
                }
            }
        }
        let Chunk { slab, window, .. } = self.chunk;
        // SAFETY: the slab holds the window's nodes.
        unsafe { pending.finish(slab.as_flattened_mut().as_mut_ptr(), window) };
    }
}
