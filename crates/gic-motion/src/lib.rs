//! Motion-factorised dynamic Gaussians (paper section 4.1): the network, its gradient, and training.
//!
//! [`train`] turns a [`gic_scene::Scene`] into [`DynamicGaussians`], which give [`gic_splat::Gaussians`] at any time.
//!
//! - `network`: shared motion bases and their coefficients per point (paper eq. 3).
//! - `base`: a pose of the whole body for each frame, to which the network's residuals are added.
//! - `gaussians`: the canonical Gaussians in training.
//! - [`pictures`]: what is to be reproduced, and the loss of one picture (paper eq. 5).
//! - `trainer`: the steps that fit all of them.

mod base;
mod error;
mod evaluate;
mod gaussians;
mod model;
mod network;
pub mod pictures;
mod settings;
mod storage;
mod tensor_file;
mod trainer;
mod tuning;

pub use base::{Affine, BaseMotion, Lattice, Pose};
pub use error::MotionError;
pub use evaluate::{ViewScore, evaluate};
pub use model::{Displacement, Domain, DynamicGaussians};
pub use network::{Architecture, Deformation, MotionNetwork, NetworkGradient, Scalar};
pub use settings::{Capture, DensitySettings, GaussianShape, InitialPoints, LearningRates, LossWeights, TrainSettings};
pub use trainer::{Listener, Phase, Progress, train};
