//! The bodies of all frames, filled one after the other. [`ShapeFrom`] tells from what.

use gic_continuum::{Completion, FillSettings, Filling, MaskedView, ShapeFrom, Symmetry, fill};

use super::fill_input::FillInput;
use super::rigid_frames::RigidFrames;
use crate::error::{Error, Result};

/// Fills frame by frame.
pub(super) struct FrameFiller {
    /// Whether mirror planes are sought.
    symmetric: bool,
    /// Planes found in the surface.
    completion: Completion,
    /// What makes the shape; decided at the first frame.
    shape: ShapeFrom<RigidFrames>,
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
        if let Some(rigid) = self.rigid_frames().filter(|rigid| frame < rigid.frames()) {
            return rigid.fill(input, frame, settings);
        }
        let gaussians = input.gaussians.at(input.scene.times[frame]);
        let mut filling = fill(&gaussians, views, settings).map_err(Error::filling(frame))?;
        if !self.symmetric {
            return Ok(filling);
        }
        self.completion.next(&mut filling, views, &settings.tuning);
        if frame > 0 {
            return Ok(filling);
        }
        let by_outlines = || RigidFrames::find(input, &settings.tuning.symmetry);
        self.shape = ShapeFrom::decide(&filling, self.completion.first(), by_outlines)?;
        self.rigid_frames().map_or(Ok(filling), |rigid| rigid.fill(input, frame, settings))
    }

    /// The frames whose outlines make the body, where outlines do.
    fn rigid_frames(&self) -> Option<&RigidFrames> {
        match &self.shape {
            ShapeFrom::Depths => None,
            ShapeFrom::Outlines(rigid) => Some(rigid),
        }
    }

    /// The symmetry of the body in the first frame, where it has any.
    pub(super) fn symmetry(&self) -> Option<&Symmetry> {
        self.rigid_frames().map(RigidFrames::symmetry).or(self.completion.first())
    }

    /// Frames whose outlines alone made the body.
    pub(super) fn outline_frames(&self) -> usize {
        self.rigid_frames().map_or(0, RigidFrames::frames)
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
