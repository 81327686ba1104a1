//! A physical digital twin: its file `twin.json`, its matter, its simulation, and its forms for other simulators.
//!
//! Also what every command of gic shares: events, interrupts, the cost of a stage, and files that appear whole.

pub mod atomic;
mod error;
pub mod events;
pub mod interchange;
mod interrupt;
pub mod json;
mod json_difference;
pub mod matter;
mod resource_usage;
mod rotation;
pub mod simulate;
pub mod twin;

pub use error::{Result, TwinError, hint_of_file};
pub use interrupt::Interrupt;
pub use json_difference::first_difference;
pub use resource_usage::{ResourceMeter, available_memory_bytes};
pub use rotation::rotation;

/// Version of gic.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
