//! The stage `reconstruct`: pictures to moving Gaussians.

use std::ops::ControlFlow;

use gic_files::FileError;
use gic_motion::{DynamicGaussians, Phase, Progress, train};

use super::stamp::Recipe;
use super::{Run, Stage};
use crate::error::{Error, Result};

/// Steps between two events.
const EVENT_EVERY: usize = 25;

impl Run<'_> {
    pub(super) fn reconstruct(&self, recipe: &Recipe) -> Result<()> {
        for found in self.scene.corrections() {
            self.events.note(Stage::Reconstruct.name(), found);
        }
        let folder = self.path("gaussians");
        // A state that was saved for other settings or another scene must not be continued.
        let begun = self.path("stamps/reconstruct.begun.json");
        let goes_on = recipe.goes_on(&begun)?;
        if !goes_on && folder.exists() {
            std::fs::remove_dir_all(&folder).map_err(FileError::write(&folder))?;
        }
        gic_twin::atomic::create_folder(&folder)?;
        recipe.write(&begun)?;
        let checkpoint = folder.join("checkpoint");
        let mut tell = |progress: &Progress| self.tell(progress);
        let model = train(
            self.scan().unwrap_or(&self.scene),
            &self.config.reconstruct,
            self.config.seed,
            &mut tell,
            Some(&checkpoint),
        )
        .map_err(Error::stage("reconstruction"))?;
        if self.interrupt.requested() {
            return Err(self.interrupted("saving the training state"));
        }
        model.save(&folder).map_err(Error::stage("saving the Gaussians"))?;
        Ok(std::fs::remove_dir_all(&checkpoint).map_err(FileError::write(&checkpoint))?)
    }

    /// The reconstruction's result.
    pub(super) fn gaussians(&self) -> Result<DynamicGaussians> {
        DynamicGaussians::load(&self.path("gaussians")).map_err(Error::stage("reading the Gaussians"))
    }

    fn tell(&self, progress: &Progress) -> ControlFlow<()> {
        let phase = match progress.phase {
            Phase::WarmUp => "warm-up",
            Phase::Tracking => "tracking",
            Phase::Motion => "motion",
        };
        if progress.step.is_multiple_of(EVENT_EVERY) || progress.step == progress.steps || progress.held_out.is_some() {
            let mut values = vec![
                ("loss", progress.loss),
                ("psnr_db", progress.psnr),
                ("gaussians", progress.gaussians as f64),
                ("seconds_left", progress.seconds_left),
            ];
            if let Some(score) = progress.held_out {
                values.extend([
                    ("held_out_psnr_db", score.psnr),
                    ("held_out_ssim", score.ssim),
                    ("held_out_iou", score.iou),
                ]);
            }
            let (step, of) = (progress.step as u64, Some(progress.steps as u64));
            self.events.step(Stage::Reconstruct.name(), phase, step, of, &values);
        }
        if self.interrupt.requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}
