//! The stage `predict`: the twin's motion over the frames of the video.

use super::Run;
use crate::error::Result;
use crate::simulate::{Request, simulate};

impl Run<'_> {
    pub(super) fn predict(&self) -> Result<()> {
        let request = Request {
            twin: self.path("twin.json"),
            settings: Vec::new(),
            colliders: None,
            companions: Vec::new(),
            out: self.path("prediction"),
            frames: Some(self.frames_to_simulate()),
            restart: true,
        };
        simulate(&request, self.events, self.interrupt).map(|_| ())
    }
}
