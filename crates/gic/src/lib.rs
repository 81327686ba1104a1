//! The pipeline as a library: run folder, stages, configuration, report; and the command line, which the binary `gic`
//! and the Python package call.

pub mod cli;
pub mod config;
pub mod demo;
mod error;
pub mod eval;
mod explanation;
pub mod export;
pub mod outputs;
pub mod pipeline;
pub mod recording;
pub mod report;

pub use error::{Error, Result};
pub use explanation::Explanation;
