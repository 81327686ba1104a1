//! What cameras show of a flying body in a frame.

use super::outline::Outline;
use crate::{Camera, Mask};

/// What a camera shows of the body in a frame.
#[derive(Clone, Debug)]
pub struct FlightView {
    /// Index of the camera.
    pub index: usize,
    /// The camera.
    pub camera: Camera,
    /// By how much its picture is known to be later than the frame's time [s].
    pub lag_s: f64,
    /// The body's mask.
    pub mask: Mask,
}

/// An outline in a frame, by its camera's index.
pub(super) struct Moment {
    pub(super) frame: usize,
    pub(super) camera: usize,
    pub(super) lag_s: f64,
    pub(super) outline: Outline,
}

impl Moment {
    pub(super) fn new(frame: usize, view: &FlightView) -> Option<Moment> {
        let outline = Outline::new(&view.camera, &view.mask)?;
        Some(Moment { frame, camera: view.index, lag_s: view.lag_s, outline })
    }
}
