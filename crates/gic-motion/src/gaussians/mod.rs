//! The canonical Gaussians while they are trained: where they start, their parameters, their number, and their
//! smoothing.

pub(crate) mod density;
pub(crate) mod first_points;
pub(crate) mod parameters;
pub(crate) mod smoothing;
