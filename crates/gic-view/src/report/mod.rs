//! The drawings of a report: line charts, and the twin over the pictures of the video.

mod chart;
mod overlay;

pub use chart::{Series, chart, short};
pub use overlay::{Drawn, Overlay, overlays};
