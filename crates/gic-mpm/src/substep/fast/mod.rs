//! The fast engine: the same substep as [`crate::substep::scalar`], over SIMD lanes.
//!
//! Particles lie in blocks of 16 ([`block`]), sorted by cell once per segment ([`layout`]). What concerns one particle
//! alone (law, weights) runs a particle per lane; what concerns its 27 nodes runs over whole rows of nodes, a particle
//! at a time ([`scatter`], [`gather`]). The particles of a body are cut into chunks ([`chunk`]), as many as their
//! number asks for, never as many as there are threads; each chunk scatters into a private slab of the grid, and slabs
//! are added in fixed order: no atomics, and the same bits for any thread count. [`p2g`] and [`g2p`] hold the two
//! transfers, each with its adjoint; [`forward`] fuses them into one pass; [`engine`] strings the passes together.

mod block;
mod chunk;
mod engine;
mod forward;
mod g2p;
mod gather;
mod layout;
mod p2g;
mod scatter;
mod stencils;
mod step;

pub(crate) use engine::FastEngine;
