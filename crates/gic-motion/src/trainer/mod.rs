//! Training: static Gaussians first, then the base motion, then the network (paper section 4.1, A.1).
//!
//! [`train`] runs the steps. Each file adds one part to them: `start` the first state, `schedule` what takes part in a step,
//! `follow` the first base motion, `view_gradient` one picture, `regularise` what holds Gaussians together, `judge` when it is
//! good enough. `training` holds what stays the same, `state` what changes, `checkpoint` writes it to disk.

mod check;
mod checkpoint;
mod follow;
mod judge;
mod progress;
mod regularise;
mod run;
mod schedule;
mod start;
mod state;
mod step;
mod training;
mod view_gradient;

pub use progress::{Phase, Progress};
pub use run::train;
