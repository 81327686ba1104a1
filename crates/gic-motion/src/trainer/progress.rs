//! What training tells its caller while it runs.

use std::ops::ControlFlow;
use std::time::Instant;

use crate::ViewScore;

/// What training is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Static Gaussians on the first frame, or on all pictures of a static scene.
    WarmUp,
    /// The first motion, from frame to frame, of Gaussians that stay as they are.
    Tracking,
    /// Gaussians and motion together.
    Motion,
}

/// One step of training, told to the callback.
#[derive(Clone, Debug)]
pub struct Progress {
    /// What training is doing.
    pub phase: Phase,
    /// Steps done; tracking counts its own.
    pub step: usize,
    /// Steps in all, at most.
    pub steps: usize,
    /// Moving average of the loss (paper eq. 5).
    pub loss: f64,
    /// PSNR [dB] over the windows rendered in this step.
    pub psnr: f64,
    /// Number of Gaussians.
    pub gaussians: usize,
    /// Mean scores of the held-out views, when they were just measured.
    pub held_out: Option<ViewScore>,
    /// Seconds since training (or its continuation) started.
    pub seconds: f64,
    /// Seconds left of the training, or of tracking, at the present pace.
    pub seconds_left: f64,
}

/// Whoever listens to training, and may end it.
pub type Listener<'a> = dyn FnMut(&Progress) -> ControlFlow<()> + Send + 'a;

/// The pace of a row of steps.
pub(super) struct Pace {
    started: Instant,
    first: usize,
}

impl Pace {
    /// Of steps from `first` on.
    pub(super) fn from(first: usize) -> Self {
        Self { started: Instant::now(), first }
    }

    /// Seconds since the start, and seconds left after `step` of `steps` steps.
    pub(super) fn seconds(&self, step: usize, steps: usize) -> (f64, f64) {
        let seconds = self.started.elapsed().as_secs_f64();
        let done = step.saturating_sub(self.first).max(1);
        (seconds, seconds / done as f64 * (steps - step.min(steps)) as f64)
    }
}
