//! Motion-factorised dynamic Gaussians (paper section 4.1): the network, its gradient, and training.

mod network;

pub use network::{Architecture, Deformation, MotionNetwork, NetworkGradient, Scalar};
