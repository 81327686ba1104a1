//! What is asked of a calibration.

use std::path::PathBuf;

use crate::board::Board;

/// What the board does while it is filmed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Motion {
    /// It lies still, and all cameras see it at once.
    Still,
    /// It is shown in several places, to all cameras at the same moments.
    Moving,
}

/// What the board lies on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoardOn {
    /// The floor; a moving board lies there at its end.
    Floor,
    /// Nothing that matters: the world has no up and no ground.
    Nothing,
}

/// What to calibrate.
#[derive(Clone, Debug)]
pub struct CalibrateRequest {
    /// Films, folders of numbered pictures, or a folder of them, one a camera.
    pub films: Vec<PathBuf>,
    /// The board.
    pub board: Board,
    /// Side of a tag's black square [m].
    pub tag_size_m: f64,
    /// Whether the board moves.
    pub motion: Motion,
    /// Lenses alone, each camera for itself.
    pub intrinsics_only: bool,
    /// Known lenses: a file that this wrote earlier.
    pub lenses: Option<PathBuf>,
    /// fy / fx: 1 for square pixels.
    pub pixel_aspect: f64,
    /// What the board lies on.
    pub board_on: BoardOn,
    /// Frames per second of numbered pictures.
    pub frame_rate_hz: Option<f64>,
    /// Folder for the results.
    pub out: PathBuf,
}
