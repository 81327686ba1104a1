//! Frames from substeps, and their derivatives.

pub(crate) mod advance;
mod checkpoints;
pub(crate) mod frame;
pub(crate) mod gradcheck;
pub(crate) mod gradient;
mod invariants;
pub(crate) mod jacobian;
pub(crate) mod recording;
pub(crate) mod simulator;
pub(crate) mod snapshot;
pub(crate) mod timestep_bound;
mod timing;
pub(crate) mod unknown;
mod wall_speed;
