//! The stage `predict`: the twin's motion over the frames of the video.

use std::path::PathBuf;

use gic_mpm::{Options, Simulator};
use gic_scene::Scene;
use gic_twin::matter::read_particles;
use gic_twin::simulate::{Scenario, SimulationRequest, simulate, usual_budget, write_frame};
use gic_twin::twin::Twin;
use glam::DVec3;

use super::Run;
use super::clock::Clock;
use crate::error::{Error, Result};

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
        let video = self.identified()?.as_fitted(&self.video);
        if video.has_lags() { self.predict_moments(&video) } else { Ok(()) }
    }

    /// The twin's motion at the times of pictures that were taken between frames.
    fn predict_moments(&self, video: &Scene) -> Result<()> {
        let (twin, mut world) = Twin::read(&self.path("twin.json"), &[])?.to_world()?;
        let moments = video.moments();
        let clock = Clock::of(&moments.times, twin.frame_rate_hz);
        world.frame_rate_hz = clock.rate_hz();
        world.stepping = clock.stepping(world.stepping);
        let unstable = || Error::stage("simulating the times of the pictures");
        let mut simulator = Simulator::new(&world, &Options::default()).map_err(unstable())?;
        let mut frame = simulator.frame();
        for (moment, time) in moments.times.iter().enumerate() {
            while frame.index < clock.tick(*time) {
                self.stop_if_asked("the prediction of whole frames")?;
                frame = simulator.advance_frame().map_err(unstable())?;
            }
            write_frame(&self.path(moment_file(video, moment)), &frame)?;
        }
        Ok(())
    }

    /// Particles of the twin at a time of [`Scene::moments`] of the video [m].
    ///
    /// # Errors
    /// A missing or damaged file.
    pub fn predicted(&self, moment: usize) -> Result<Vec<DVec3>> {
        Ok(read_particles(&self.path(moment_file(&self.video, moment)))?.positions)
    }
}

/// Name of the file, inside the run folder, of the twin's particles at a time of [`Scene::moments`] of the video.
pub(crate) fn moment_file(video: &Scene, moment: usize) -> PathBuf {
    match video.has_lags() {
        true => format!("prediction/moment_{moment:04}.ply").into(),
        false => prediction_file(simulated_frame(video, moment)),
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
