//! The simulation of `gic view --live`: a twin with few particles, stepped by [`gic_mpm`] in one thread, that a hand
//! can pull and whose parameters can be changed on the way.
//!
//! The page's module is this crate compiled to WebAssembly (`scripts/build_live.sh`); `exports` is its interface. The
//! program makes the [`reduced`] world and hands it to the page as [`encode`]d numbers.

#[cfg(target_arch = "wasm32")]
mod exports;
mod hand;
mod live_simulation;
mod numbers;
mod outward;
mod reduce;
mod tuning;

pub use live_simulation::LiveSimulation;
pub use numbers::{decode, encode};
pub use reduce::reduced;
pub use tuning::{FRAME_RATE_HZ, MAX_PARTICLES};
