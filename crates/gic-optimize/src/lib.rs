//! Minimisers that several stages share.

mod adam;

pub use adam::{Moments, decayed};
