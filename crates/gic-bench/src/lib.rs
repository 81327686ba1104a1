//! Suites of scenes with their truth: `gic bench`.
//!
//! A suite becomes tasks, one for each scene and each case of a sweep ([`sweep`], [`plan`]); an [`engine`] starts them
//! on this machine or on a cluster; each leaves a [`record`] in its run folder; [`collect()`] makes the tables of what
//! is there. The output folder is all that they share. [`others`] takes other methods to the same scenes.

mod collect;
pub mod engine;
mod error;
mod evaluation;
pub mod forecast;
pub mod others;
mod outcome;
mod page;
mod paper;
pub mod plan;
pub mod record;
pub mod states;
mod suite;
pub mod sweep;
pub mod tables;
mod text;
mod truth;
mod tuning;

pub use collect::{Collected, collect};
pub use error::{BenchError, Result};
pub use evaluation::{Evaluation, FrameError, ParameterError, PictureError, RegistrationError, VelocityError};
pub use paper::{paper_name, paper_value};
pub use suite::{SuiteScene, find_scenes};
pub use truth::Truth;

/// Name in events.
pub(crate) const STAGE: &str = "bench";
