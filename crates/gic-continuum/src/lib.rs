//! From Gaussians to matter (paper section 4.2): the density field by coarse-to-fine filling, particles for simulation, the
//! Gaussian-informed continuum, surfaces and meshes.

mod error;
mod field;
mod fill;
mod settings;
mod unseen;
mod view;

pub use error::ContinuumError;
pub use field::{DensityField, MAX_VOXELS};
pub use fill::{Filling, fill};
pub use settings::{FillSettings, GroundPlane, Unseen};
pub use view::MaskedView;
