//! Cameras from pictures of printed boards.
//!
//! [`print_board`] makes the board; [`calibrate`] reads films of it: `detect` finds tags, `align` lays their patterns
//! over the pictures, `start` guesses lenses and places, `bundle` adjusts all of them together, and what the cameras
//! then should see is searched for once more. `output` writes `calibration.json`, `report` pictures of the residuals.

mod align;
mod board;
mod bundle;
mod calibrate;
mod detect;
mod error;
mod grey;
mod homography;
mod lens;
mod output;
mod print;
mod report;
mod request;
mod rig;
mod sightings;
mod solution;
mod start;
mod tuning;

pub use board::{Black, Board, TagPlace};
pub use calibrate::calibrate;
pub use detect::{Sighting, find_tags};
pub use error::{CalibrateError, Result};
pub use grey::Grey;
pub use lens::Lens;
pub use output::{Calibrated, CalibratedCamera, Deviations, Distortion};
pub use print::{Paper, PrintRequest, print_board};
pub use request::{BoardOn, CalibrateRequest, Motion};
