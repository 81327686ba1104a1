//! Cameras, images and masks; readers for each dataset format; matting; the visual hull.
//!
//! Open a folder with [`Scene::open`], load pixels with [`Scene::load_view`]. What each format means (axes, units, files)
//! is written down in the page of [conventions].

mod camera;
mod error;
mod hull;
mod inspect;
mod lens;
mod matting;
mod network;
mod picture;
mod read;
mod scene;
mod sheet;
mod similarity;

pub use camera::Camera;
pub use error::{Problem, SceneError, Severity};
pub use hull::{Hull, HullSettings, HullView, SurfacePoint};
pub use inspect::{CameraReport, GroundSource, HullReport, Inspection, inspect};
pub use matting::difference_matte;
pub use picture::{Mask, Picture, PixelBox, touches_border};
pub use scene::{ColouredPoint, Format, MaskSource, Masks, OpenOptions, Plane, Scene, Split, View, World};
pub use similarity::Similarity;

#[doc = include_str!("../CONVENTIONS.md")]
pub mod conventions {}
