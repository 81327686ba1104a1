//! What is asked of an import.

use std::path::PathBuf;

use crate::align::Align;

/// What to import.
#[derive(Clone, Debug)]
pub struct ImportRequest {
    /// Films, or a folder of them; empty to give cameras to a scene that was imported before.
    pub films: Vec<PathBuf>,
    /// The scene's folder.
    pub scene: PathBuf,
    /// Where the cut begins [s], on the clock of the first film; by default where all films have begun.
    pub start_s: Option<f64>,
    /// Number of frames; by default all.
    pub frames: Option<usize>,
    /// Take every so many-th frame.
    pub every: usize,
    /// Frames per second of numbered pictures.
    pub frame_rate_hz: Option<f64>,
    /// Cameras: a file of `gic calibrate`, a `transforms.json`, or a scene.
    pub calibration: Option<PathBuf>,
    /// How to find the common clock.
    pub align: Align,
}
