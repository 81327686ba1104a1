//! The fast engine: the same substep as [`crate::substep::scalar`], over SIMD lanes.
//!
//! Particles lie in blocks of 16 (`block`), sorted by cell once per segment. What concerns one particle alone (law, weights)
//! runs a particle per lane; what concerns its 27 nodes runs over whole rows of nodes, a particle at a time (`scatter`). The
//! particles of a body are cut into chunks, as many as their number asks for, never as many as there are threads; each chunk scatters into
//! a private slab of the grid, and slabs are added in fixed order: no atomics, and the same bits for any thread count.
//! `step` holds the passes over a chunk, forward beside backward; `engine` strings them together.

mod block;
mod engine;
mod scatter;
mod step;

pub(crate) use engine::FastEngine;
