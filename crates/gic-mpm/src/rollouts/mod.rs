//! Frames from substeps, and their derivatives.

pub(crate) mod frames;
pub(crate) mod gradcheck;
pub(crate) mod gradient;
pub(crate) mod jacobian;
pub(crate) mod simulator;
