//! The bodies of all frames, filled one after the other and completed by their mirror planes.

use gic_continuum::{Completion, FillSettings, Filling, MaskedView, Symmetry, fill};

use super::source::Source;
use super::still::Still;
use crate::error::{Error, Result};

/// Fills frame by frame.
pub(super) struct Bodies {
    /// Whether mirror planes are looked for.
    symmetric: bool,
    /// Planes found in the surface.
    completion: Completion,
    /// Planes found in the outlines, where the surface shows less than three.
    still: Option<Still>,
}

impl Bodies {
    pub(super) fn new(symmetric: bool) -> Bodies {
        Bodies { symmetric, completion: Completion::default(), still: None }
    }

    /// The body of the next frame.
    pub(super) fn next(
        &mut self,
        source: &Source,
        frame: usize,
        views: &[MaskedView],
        settings: &FillSettings,
    ) -> Result<Filling> {
        if let Some(still) = self.still.as_ref().filter(|still| frame < still.frames()) {
            return still.fill(source, frame, settings);
        }
        let gaussians = source.gaussians.at(source.scene.times[frame]);
        let mut filling = fill(&gaussians, views, settings).map_err(Error::filling(frame))?;
        // One view tells nothing of a body's far side.
        if !self.symmetric || filling.views_used < 2 {
            return Ok(filling);
        }
        self.completion.next(&mut filling, views);
        if frame == 0 && self.completion.first().is_none_or(|symmetry| symmetry.planes.len() < 3) {
            self.still = Still::find(source)?;
            if let Some(still) = &self.still {
                return still.fill(source, frame, settings);
            }
        }
        Ok(filling)
    }

    /// The symmetry of the body in the first frame, where it has any.
    pub(super) fn symmetry(&self) -> Option<&Symmetry> {
        self.still.as_ref().map(Still::symmetry).or(self.completion.first())
    }

    /// Frames whose outlines alone made the body.
    pub(super) fn outline_frames(&self) -> usize {
        self.still.as_ref().map_or(0, Still::frames)
    }

    /// What a person is told of its symmetry.
    pub(super) fn told(&self, symmetry: &Symmetry) -> String {
        let (planes, off) = (symmetry.planes.len(), 1e3 * symmetry.misfit());
        let how = match self.outline_frames() {
            0 => "completed by it".to_owned(),
            frames => format!("made of {frames} frames' outlines by it, for its surface is poorly known"),
        };
        format!("the body is its own mirror image in {planes} planes (to {off:.1} mm): {how}")
    }
}
