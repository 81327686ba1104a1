//! Motion-factorised dynamic Gaussians (paper section 4.1): the network, its gradient, and training.
//!
//! [`train`] turns a [`gic_scene::Scene`] into [`DynamicGaussians`], which give [`gic_splat::Gaussians`] at any time.

mod adam;
mod base;
mod base_fit;
mod checkpoint;
mod dress;
mod error;
mod evaluate;
mod initial;
mod lattice;
mod light;
mod loss;
mod model;
mod network;
mod normals;
mod parameters;
mod register;
mod settings;
mod shade;
mod smoothing;
mod storage;
mod targets;
mod tensor_file;
mod trainer;

pub use base::{Affine, BaseMotion, Pose};
pub use dress::{DressProgress, DressSettings, LitGaussians, Posture, color_of, dress};
pub use error::MotionError;
pub use evaluate::{ViewScore, evaluate};
pub use lattice::Lattice;
pub use light::{Light, TERMS};
pub use model::{Domain, DynamicGaussians, Motion};
pub use network::{Architecture, Deformation, MotionNetwork, NetworkGradient, Scalar};
pub use normals::outward_normals;
pub use register::{Candidate, RegisterSettings, Registration, check_registrable, placed, register};
pub use settings::{Capture, DensitySettings, GaussianShape, InitialPoints, LearningRates, LossWeights, TrainSettings};
pub use trainer::{Phase, Progress, train};
