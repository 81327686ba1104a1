//! A physical digital twin: its file `twin.json`, its matter, its simulation, and its forms for other simulators.
//!
//! Also what every command of gic shares: events, interrupts, the cost of a stage, and files that appear whole.

pub mod atomic;
mod difference;
mod error;
pub mod events;
pub mod interchange;
mod interrupt;
pub mod matter;
mod rotation;
pub mod simulate;
pub mod twin;
pub mod usage;

pub use difference::first_difference;
pub use error::{Result, TwinError};
pub use interrupt::Interrupt;
pub use rotation::rotation;

/// Version of gic.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
