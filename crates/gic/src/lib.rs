//! The pipeline as a library: run folder, stages, configuration, report. The binary `gic` is a thin layer over it.

pub mod bench;
pub mod config;
pub mod demo;
mod error;
pub mod eval;
pub mod grasp;
pub mod outputs;
pub mod pipeline;
pub mod recording;
pub mod report;
mod statistics;

pub use error::{Error, Result};
