//! Minimisers that several stages share.

mod adam;
mod damped_step;

pub use adam::{Adam, Moments, decayed};
pub use damped_step::damped_step;
