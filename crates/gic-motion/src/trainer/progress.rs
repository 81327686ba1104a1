//! What training tells its caller while it runs.

use crate::ViewScore;

/// What training is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Static Gaussians on the first frame, or on all pictures of a static scene.
    WarmUp,
    /// Gaussians and motion together.
    Motion,
}

/// One step of training, told to the callback.
#[derive(Clone, Debug)]
pub struct Progress {
    /// What training is doing.
    pub phase: Phase,
    /// Steps done.
    pub step: usize,
    /// Steps in all.
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
    /// Seconds left, at the present pace.
    pub seconds_left: f64,
}
