//! One substep, forward and backward.

pub(crate) mod fast;
pub(crate) mod grid_update;
pub(crate) mod prepared_world;
pub(crate) mod scalar;
pub(crate) mod state;
pub(crate) mod stencil;
#[cfg(test)]
mod tests;
