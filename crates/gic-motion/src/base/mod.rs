//! The base motion: where an affine map and a coarse displacement field take the canonical Gaussians in each frame.

pub(crate) mod fit;
mod lattice;
mod motion;
mod shade;

pub use lattice::Lattice;
pub(crate) use motion::PoseGradient;
pub use motion::{Affine, BaseMotion, Pose};
