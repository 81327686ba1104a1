//! The stage `appearance`: the twin's colours, trained on the pictures with its motion given.

use std::ops::ControlFlow;

use gic_appearance::{AppearanceProgress, PosedPoints, fit_appearance};
use gic_continuum::{Appearance, informed_gaussians};
use gic_geometry::outward_normals;
use gic_twin::matter::read_particles;
use gic_view::skinned_gaussians::SkinnedGaussians;
use glam::DVec3;

use super::{Run, Stage, TWIN_MATTER};
use crate::error::{Error, Result};

/// Steps between two events.
const EVENT_EVERY: usize = 25;

impl Run<'_> {
    pub(super) fn appearance(&self) -> Result<()> {
        let (drawing, drawn) = self.drawing(&self.continuum()?)?;
        let spacing = drawing.particles.spacing;
        let to_f32 = |points: Vec<DVec3>| points.iter().map(|p| p.as_vec3().to_array()).collect::<Vec<[f32; 3]>>();
        let mut posed = Vec::new();
        let found = self.identified()?;
        let moments = found.as_fitted(&self.scene).moments();
        for frame in 0..moments.times.len() {
            let positions = to_f32(drawing.positions(&self.predicted(frame)?));
            posed.push(PosedPoints { frame, normals: outward_normals(&positions, spacing), positions });
        }
        let rest = drawing.positions(&read_particles(&self.path(TWIN_MATTER))?.positions);
        let drawn = Appearance { scale: found.splat_factor * drawn.scale, ..drawn };
        let bare = informed_gaussians(&rest, &drawing.particles, &drawn);
        let settings = &self.config.appearance.train;
        let mut tell = |progress: &AppearanceProgress| self.report_appearance(progress, settings.steps);
        let held_out = &self.config.reconstruct.held_out;
        let lit = fit_appearance(&moments, held_out, &bare, &posed, (settings, self.config.seed), &mut tell)
            .map_err(Error::stage("training the twin's colours"))?;
        if self.interrupt.requested() {
            return Err(self.interrupted("the prediction"));
        }
        Ok(SkinnedGaussians::save(&lit, spacing, &self.folder)?)
    }

    fn report_appearance(&self, progress: &AppearanceProgress, steps: usize) -> ControlFlow<()> {
        if progress.step.is_multiple_of(EVENT_EVERY) || progress.step == steps {
            let values = [("loss", progress.loss), ("psnr_db", progress.psnr)];
            self.events.step(Stage::Appearance.name(), "", progress.step as u64, Some(steps as u64), &values);
        }
        if self.interrupt.requested() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}
