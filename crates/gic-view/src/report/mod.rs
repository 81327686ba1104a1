//! The drawings of a report: line charts, and the twin over the pictures of the video.

mod chart;
mod overlay;

pub use chart::{Series, chart, short_number};
pub use overlay::{Overlay, TwinDrawing, overlays};
