//! The stage `predict`: the twin's motion over the frames of the video.

use std::path::PathBuf;

use gic_scene::Scene;
use gic_twin::simulate::{Scenario, SimulationRequest, simulate, usual_budget};

use super::Run;
use crate::error::Result;

impl Run<'_> {
    pub(super) fn predict(&self) -> Result<()> {
        let request = SimulationRequest {
            scenario: Scenario { twin: self.path("twin.json"), ..Scenario::default() },
            out: self.path("prediction"),
            frames: Some(self.frames_to_simulate()),
            restart: true,
            budget: usual_budget(),
        };
        simulate(&request, self.events, self.interrupt)?;
        Ok(())
    }
}

/// Number of the simulated frame at the time of a frame of the video: simulations have evenly spaced frames, videos may
/// lack some.
pub(crate) fn simulated_frame(video: &Scene, frame: usize) -> usize {
    (video.times[frame] * video.frame_rate.unwrap_or(24.0)).round().max(0.0) as usize
}

/// Name of the file of a simulated frame's particles, inside the run folder.
pub(crate) fn prediction_file(simulated: usize) -> PathBuf {
    format!("prediction/particles_{simulated:04}.ply").into()
}
