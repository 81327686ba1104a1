//! Particles of a body, for simulation and for drawing.

mod drawing;
mod informed;
mod sample;
mod thickness;

pub use drawing::Drawing;
pub use informed::{Agreement, Appearance, agreement, calibrate, compare_with_masks, informed_gaussians};
pub use sample::{Particles, sample_particles, sample_points};
