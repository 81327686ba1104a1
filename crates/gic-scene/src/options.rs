//! Settings for opening a scene.

use std::path::PathBuf;

/// Which masks to use.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub enum Masks {
    /// Alpha channels or mask files where the scene has them, else matting against the empty background.
    #[default]
    Auto,
    /// Matting against the empty background, even where the scene has masks.
    Difference,
    /// The matting network in this ONNX file (needs the cargo feature `onnx`).
    Network(PathBuf),
}

/// Settings for opening a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenOptions {
    /// Which masks to use.
    pub masks: Masks,
    /// Frames per second, in place of what the format says; the times of the frames become frame / rate.
    pub frame_rate: Option<f64>,
    /// Which of several sets in the folder to read (an object of a Spring-Gaus real capture); the first by name if `None`.
    pub set: Option<String>,
}
