//! Cameras, images and masks; readers for each dataset format.

mod camera;

pub use camera::Camera;
