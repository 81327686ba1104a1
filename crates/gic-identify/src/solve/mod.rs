//! How far a hypothesis is from the video, and how a better one is found.

pub(crate) mod levenberg_marquardt;
pub(crate) mod loss;
pub(crate) mod objective;
