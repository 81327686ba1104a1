//! What an import made.

use serde::{Deserialize, Serialize};

use crate::align::Align;

/// What was imported.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Imported {
    /// The cameras, in the order of the films.
    pub cameras: Vec<ImportedCamera>,
    /// By what the films were aligned.
    pub aligned_by: Align,
    /// Number of frames.
    pub frames: usize,
    /// Whether the cameras' places are known.
    pub is_calibrated: bool,
}

/// A camera of an import.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct ImportedCamera {
    /// Its name.
    pub name: String,
    /// Width and height [pixels].
    pub size_px: [usize; 2],
    /// Mean frames per second of the film.
    pub frame_rate_hz: Option<f64>,
    /// When the film begins on the clock of the first one [s].
    pub offset_s: f64,
    /// Pixels of the empty scene that no frame shows, filled from around; `None` where the picture was there already.
    pub never_free_px: Option<usize>,
    /// Pixels of resting objects and shadows that were taken out of it.
    pub taken_out_px: Option<usize>,
}
