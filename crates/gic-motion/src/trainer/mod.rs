//! Training: static Gaussians first, then the base motion, then the network (paper section 4.1, A.1).
//!
//! [`train`] runs the steps. `training` holds what stays the same, `state` what changes, `checkpoint` writes it to
//! disk. Each other file adds a part:
//!
//! - `start`: the state before the first step.
//! - `schedule`: what is trained in a step, and on which pictures.
//! - `track_base`: the first base motion, from frame to frame.
//! - `step`: one step; `view_gradient` is one picture of it, `regularise` what holds the Gaussians together.
//! - `averaging`: the mean of the last steps.
//! - `early_stopping`: when training is good enough.

mod averaging;
mod check;
mod checkpoint;
mod early_stopping;
mod progress;
mod regularise;
mod run;
mod schedule;
mod start;
mod state;
mod step;
mod track_base;
mod training;
mod view_gradient;

pub use progress::{Listener, Phase, Progress};
pub use run::train;
