//! Cameras, images and masks; readers for each dataset format; matting; the visual hull.
//!
//! Open a folder with [`Scene::open`], load pixels with [`Scene::load_view`]. What each format means (axes, units,
//! files) is written down in the page of [conventions].

mod camera;
mod error;
mod flight;
mod format;
mod frames;
mod hull;
mod inspect;
mod jpeg;
mod lens;
mod load;
mod matting;
mod network;
mod picture;
mod read;
mod scene;
mod settings;
pub mod sheet;

mod similarity;
mod timing;
mod view;
mod world;

pub use camera::Camera;
pub use error::{Problem, SceneError, Severity};
pub use flight::{CalibrationError, CameraOffset, FlightView, FreeFlight, Seek};
pub use format::Format;
pub use hull::{Hull, HullSettings, HullView};
pub use inspect::{
    CalibrationErrorReport, CameraReport, FallReport, FlightReport, GroundSource, HullReport, Inspection, inspect,
};
pub use matting::difference_matte;
pub use picture::{Mask, Picture, PixelBox, touches_border};
pub use scene::Scene;
pub use settings::{MaskChoice, SceneSettings, Trust};
pub use similarity::Similarity;
pub use view::{MaskSource, Split, View};
pub use world::{ColouredPoint, World};

#[doc = include_str!("../CONVENTIONS.md")]
pub mod conventions {}
