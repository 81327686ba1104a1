//! Minimisers that several stages share.

mod adam;
mod damped_step;
mod least_squares;

pub use adam::{Adam, Moments, decayed};
pub use damped_step::{DAMPING_FACTOR, FIRST_DAMPING, damped_step};
pub use least_squares::{Minimum, least_squares};
