//! How sure the answer is: noise of the residuals, intervals, and whether the model explains the video.

pub(crate) mod input_checks;
pub(crate) mod interval;
pub(crate) mod noise;
pub(crate) mod profile;
pub(crate) mod variance;
pub(crate) mod verdicts;
