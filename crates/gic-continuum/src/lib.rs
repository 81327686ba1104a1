//! From Gaussians to matter (paper section 4.2): the density field by coarse-to-fine filling, particles for simulation,
//! the Gaussian-informed continuum, surfaces and meshes.

mod carve;
mod choices;
mod error;
mod evidence;
mod export;
mod fill;
mod particles;
mod settings;
mod shape_from;
mod symmetry;
#[cfg(test)]
mod test_cross;
mod tuning;

pub use carve::ColouredView;
pub use choices::Settings;
pub use error::ContinuumError;
pub use evidence::MaskedView;
pub use export::write_particles_ply;
pub use fill::{Filling, fill, fill_outlines};
pub use particles::{
    Agreement, Appearance, Drawing, Particles, Placement, agreement, calibrate, compare_with_masks, informed_gaussians,
    sample_particles, sample_points,
};
pub use settings::{FillSettings, Unseen};
pub use shape_from::ShapeFrom;
pub use symmetry::{Completion, MirrorPlane, Symmetry};
pub use tuning::*;
