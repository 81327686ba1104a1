//! Rigid obstacles: their shape, their path, and how they touch.

pub(crate) mod collider;
pub(crate) mod contact;
pub(crate) mod grid_frame;
pub(crate) mod path;
pub(crate) mod shape;
