//! The body of each frame, one after the other, completed by its mirror planes.

use gic_continuum::{Completion, FillSettings, Filling, MaskedView, Symmetry, fill};

use super::fill_input::FillInput;
use super::rigid_frames::RigidFrames;
use crate::error::{Error, Result};

/// Fills frame by frame.
pub(super) struct FrameFiller {
    /// Whether mirror planes are sought.
    symmetric: bool,
    /// Planes found in the surface.
    completion: Completion,
    /// Planes found in the outlines, where the surface shows less than three.
    rigid: Option<RigidFrames>,
}

impl FrameFiller {
    pub(super) fn new(symmetric: bool) -> FrameFiller {
        FrameFiller { symmetric, completion: Completion::default(), rigid: None }
    }

    /// The body of the next frame.
    pub(super) fn next(
        &mut self,
        input: &FillInput,
        frame: usize,
        views: &[MaskedView],
        settings: &FillSettings,
    ) -> Result<Filling> {
        if let Some(rigid) = self.rigid.as_ref().filter(|rigid| frame < rigid.frames()) {
            return rigid.fill(input, frame, settings);
        }
        let gaussians = input.gaussians.at(input.scene.times[frame]);
        let mut filling = fill(&gaussians, views, settings).map_err(Error::filling(frame))?;
        // One view tells nothing of a body's far side.
        if !self.symmetric || filling.views_used < 2 {
            return Ok(filling);
        }
        self.completion.next(&mut filling, views);
        if frame == 0 && self.completion.first().is_none_or(|symmetry| symmetry.planes.len() < 3) {
            self.rigid = RigidFrames::find(input)?;
            if let Some(rigid) = &self.rigid {
                return rigid.fill(input, frame, settings);
            }
        }
        Ok(filling)
    }

    /// The symmetry of the body in the first frame, where it has any.
    pub(super) fn symmetry(&self) -> Option<&Symmetry> {
        self.rigid.as_ref().map(RigidFrames::symmetry).or(self.completion.first())
    }

    /// Frames whose outlines alone made the body.
    pub(super) fn outline_frames(&self) -> usize {
        self.rigid.as_ref().map_or(0, RigidFrames::frames)
    }

    /// The symmetry that was found and how it was used, in a sentence.
    pub(super) fn symmetry_summary(&self, symmetry: &Symmetry) -> String {
        let (planes, off) = (symmetry.planes.len(), 1e3 * symmetry.misfit());
        let how = match self.outline_frames() {
            0 => "completed by it".to_owned(),
            frames => format!("made of {frames} frames' outlines by it, for its surface is poorly known"),
        };
        format!("the body is its own mirror image in {planes} planes (to {off:.1} mm): {how}")
    }
}
