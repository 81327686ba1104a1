//! The drawings of a report: line charts, and the twin over the pictures of the video.

mod chart;
mod overlay;

pub use chart::{Chart, Series};
pub use overlay::{Overlay, TwinDrawing, overlays};
