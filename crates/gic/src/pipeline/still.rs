//! The frames in which the object still has the shape that it has in the first, by its outlines alone.
//!
//! Where cameras are so few that the reconstructed surface shows no symmetry, the outlines may: then each frame of flight shows the same body from
//! as many sides again, and all of them together say where it is not.

use gic_continuum::{FillSettings, Filling, MaskedView, Symmetry, fill_outlines};
use gic_scene::{Camera, Mask};

use super::fill::failed;
use super::source::{Source, mean};
use crate::error::Result;

/// The first frames, of which all show the same body.
pub(super) struct Still {
    /// The body's mirror planes in each of them.
    symmetries: Vec<Symmetry>,
    masks: Vec<Vec<Mask>>,
}

impl Still {
    /// `None` where the outlines of the first frame show no symmetry.
    pub(super) fn find(source: &Source) -> Result<Option<Still>> {
        let masks = source.masks(0)?;
        let first = Symmetry::of_outlines(&source.masked_views(0, &masks));
        if first.planes.is_empty() {
            return Ok(None);
        }
        let centre = |frame: usize| mean(&source.gaussians.at(source.scene.times[frame]).positions);
        let start = centre(0);
        let mut still = Still { symmetries: vec![first], masks: vec![masks] };
        for frame in 1..source.scene.times.len() {
            let masks = source.masks(frame)?;
            let views = source.masked_views(frame, &masks);
            let Some(symmetry) = still.symmetries[0].followed(&views, centre(frame) - start) else { break };
            still.symmetries.push(symmetry);
            still.masks.push(masks);
        }
        Ok(Some(still))
    }

    /// The body's symmetry in the first frame.
    pub(super) fn symmetry(&self) -> &Symmetry {
        &self.symmetries[0]
    }

    /// How many frames show it.
    pub(super) fn frames(&self) -> usize {
        self.symmetries.len()
    }

    /// The body in one of the frames.
    pub(super) fn fill(&self, source: &Source, frame: usize, settings: &FillSettings) -> Result<Filling> {
        let here = &self.symmetries[frame];
        let views: Vec<Vec<MaskedView>> =
            self.masks.iter().enumerate().map(|(k, masks)| source.masked_views(k, masks)).collect();
        let moved: Vec<(Camera, &[f32])> = (self.symmetries.iter().zip(&views))
            .flat_map(|(there, views)| views.iter().map(move |view| (there, view)))
            .filter_map(|(there, view)| Some((here.camera_at_rest(there, view.camera)?, view.mask?)))
            .collect();
        let views: Vec<MaskedView> =
            moved.iter().map(|(camera, mask)| MaskedView { camera, mask: Some(mask) }).collect();
        let gaussians = source.gaussians.at(source.scene.times[frame]);
        fill_outlines(&gaussians, &views, here, settings).map_err(failed(frame))
    }
}
