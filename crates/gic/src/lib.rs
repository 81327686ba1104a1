//! The pipeline as a library: run folder, stages, configuration, report. The binary `gic` is a thin layer over it.

pub mod atomic;
pub mod bench;
pub mod config;
pub mod demo;
mod difference;
mod error;
pub mod eval;
pub mod events;
pub mod gradcheck;
pub mod grasp;
pub mod interchange;
mod interrupt;
pub mod look;
pub mod matter;
pub mod pipeline;
pub mod render;
pub mod report;
pub mod simulate;
pub mod twin;
pub mod usage;
pub mod view;

pub use error::{Error, Result};
pub use interrupt::Interrupt;

/// Version of gic.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");
