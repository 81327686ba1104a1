//! The bodies of all frames, filled one after the other. [`ShapeFrom`] tells from what the first one is made.

use gic_continuum::{Completion, FillSettings, Filling, MaskedView, ShapeFrom, Symmetry, fill, fill_outlines};

use super::fill_input::FillInput;
use crate::error::{Error, Result};

/// Fills frame by frame.
pub(super) struct FrameFiller {
    /// Whether mirror planes are sought.
    symmetric: bool,
    /// Planes found in the surface.
    completion: Completion,
    /// What makes the body of the first frame.
    shape: ShapeFrom,
}

impl FrameFiller {
    pub(super) fn new(symmetric: bool) -> FrameFiller {
        FrameFiller { symmetric, completion: Completion::default(), shape: ShapeFrom::Depths }
    }

    /// The body of the next frame.
    pub(super) fn next(
        &mut self,
        input: &FillInput,
        frame: usize,
        views: &[MaskedView],
        settings: &FillSettings,
    ) -> Result<Filling> {
        let gaussians = input.gaussians.at(input.scene.times[frame]);
        let mut filling = fill(&gaussians, views, settings).map_err(Error::filling(frame))?;
        if !self.symmetric {
            return Ok(filling);
        }
        self.completion.next(&mut filling, views, &settings.tuning);
        if frame > 0 {
            return Ok(filling);
        }
        let later =
            if views.len() < settings.tuning.symmetry.telling_outlines { input.late_in_flight()? } else { Vec::new() };
        let later = later.iter().map(|(camera, mask)| MaskedView { camera, mask: Some(&mask.coverage) });
        let shown: Vec<MaskedView> = views.iter().copied().chain(later).collect();
        let by_outlines = || Symmetry::of_outlines(&shown, &settings.tuning.symmetry);
        self.shape = ShapeFrom::decide(&filling, self.completion.first(), by_outlines);
        self.outlines().map_or(Ok(filling), |symmetry| {
            fill_outlines(&gaussians, &shown, symmetry, settings).map_err(Error::filling(frame))
        })
    }

    /// The symmetry whose mirrored outlines make the first body, where outlines do.
    fn outlines(&self) -> Option<&Symmetry> {
        match &self.shape {
            ShapeFrom::Depths => None,
            ShapeFrom::Outlines(symmetry) => Some(symmetry),
        }
    }

    /// The symmetry of the body in the first frame, where it has any.
    pub(super) fn symmetry(&self) -> Option<&Symmetry> {
        self.outlines().or(self.completion.first())
    }

    /// Whether outlines alone made the body of the first frame.
    pub(super) fn is_by_outlines(&self) -> bool {
        self.outlines().is_some()
    }

    /// The symmetry that was found and how it was used, in a sentence.
    pub(super) fn symmetry_summary(&self, symmetry: &Symmetry) -> String {
        let (planes, off) = (symmetry.planes.len(), 1e3 * symmetry.misfit());
        let how = if self.is_by_outlines() {
            "made of mirrored outlines by it, for its surface is poorly known"
        } else {
            "completed by it"
        };
        format!("the body is its own mirror image in {planes} planes (to {off:.1} mm): {how}")
    }
}
