//! One substep, forward and backward.
//!
//! [`scalar`] is the readable engine, with the equations; [`fast`] is the same over SIMD lanes and threads.

pub(crate) mod engine;
pub(crate) mod fast;
pub(crate) mod grid;
pub(crate) mod grid_update;
pub(crate) mod prepared_world;
pub(crate) mod scalar;
pub(crate) mod state;
pub(crate) mod stencil;
#[cfg(test)]
mod tests;
pub(crate) mod violation;
