//! How far a hypothesis is from the video, and how a better one is found.

pub(crate) mod compared_view;
pub(crate) mod levenberg_marquardt;
pub(crate) mod linearisation;
pub(crate) mod loss;
pub(crate) mod normal_equations;
pub(crate) mod objective;
pub(crate) mod posed;
pub(crate) mod prior;
pub(crate) mod problem;
pub(crate) mod residual_block;
pub(crate) mod surface_residuals;
