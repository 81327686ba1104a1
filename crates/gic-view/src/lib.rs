//! What a twin looks like: pictures and films of its motion, pages for a browser, recordings for Rerun, and the
//! drawings of a report.

mod error;
pub mod page;
#[cfg(feature = "rerun")]
pub mod recording;
pub mod render;
pub mod report;
pub mod skinned_gaussians;
pub mod template;
pub mod units;
pub mod video;

pub use error::{Result, ViewError};
