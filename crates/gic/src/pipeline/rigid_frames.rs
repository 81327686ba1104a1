//! The first frames in which the object keeps its shape, found by its outlines alone.
//!
//! Where cameras are so few that the reconstructed surface shows no symmetry, the outlines may: then each frame of
//! flight shows the same body from as many sides again, and all of them together say where it is not.

use gic_continuum::{ColouredView, FillSettings, Filling, MaskedView, Symmetry, SymmetryTuning, fill_outlines};
use gic_scene::{Camera, Mask, Picture};

use super::fill_input::{FillInput, mean};
use crate::error::{Error, Result};

/// The first frames, of which all show the same body.
pub(super) struct RigidFrames {
    /// The body's mirror planes in each of them.
    symmetries: Vec<Symmetry>,
    pictures: Vec<Vec<(Picture, Mask)>>,
}

impl RigidFrames {
    /// `None` where the outlines of the first frame show no symmetry.
    pub(super) fn find(input: &FillInput, tuning: &SymmetryTuning) -> Result<Option<RigidFrames>> {
        let pictures = input.pictures(0)?;
        let first = Symmetry::of_outlines(&input.masked_views(0, pictures.iter().map(|(_, mask)| mask)), tuning);
        if first.planes.is_empty() {
            return Ok(None);
        }
        let centre = |frame: usize| mean(&input.gaussians.at(input.scene.times[frame]).positions);
        let start = centre(0);
        let mut rigid = RigidFrames { symmetries: vec![first], pictures: vec![pictures] };
        for frame in 1..input.frames() {
            let pictures = input.pictures(frame)?;
            let views = input.masked_views(frame, pictures.iter().map(|(_, mask)| mask));
            let followed = rigid.symmetries[0].followed(&views, centre(frame) - start, tuning);
            let Some(symmetry) = followed else { break };
            rigid.symmetries.push(symmetry);
            rigid.pictures.push(pictures);
        }
        Ok(Some(rigid))
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
    pub(super) fn fill(&self, input: &FillInput, frame: usize, settings: &FillSettings) -> Result<Filling> {
        let here = &self.symmetries[frame];
        let moved: Vec<MovedView> = (0..self.frames()).flat_map(|moment| self.moved(input, moment, here)).collect();
        let gaussians = input.gaussians.at(input.scene.times[frame]);
        let views: Vec<MaskedView> = moved.iter().map(MovedView::masked).collect();
        let mut filling = fill_outlines(&gaussians, &views, here, settings).map_err(Error::filling(frame))?;
        let views: Vec<ColouredView> = moved.iter().map(MovedView::coloured).collect();
        filling.carve(&views, here, &settings.tuning);
        Ok(filling)
    }

    /// The views of a moment, moved to where they would have seen the body with its planes `here`.
    fn moved<'a>(
        &'a self,
        input: &'a FillInput,
        moment: usize,
        here: &'a Symmetry,
    ) -> impl Iterator<Item = MovedView<'a>> + 'a {
        let pictures =
            input.cameras(moment).iter().zip(&self.pictures[moment]).filter(|(_, (_, mask))| mask.area() > 0.0);
        pictures.filter_map(move |(camera, (picture, mask))| {
            let camera = here.camera_at_rest(&self.symmetries[moment], camera)?;
            Some(MovedView { moment, camera, picture, mask })
        })
    }
}

/// A view whose camera was moved.
struct MovedView<'a> {
    moment: usize,
    camera: Camera,
    picture: &'a Picture,
    mask: &'a Mask,
}

impl MovedView<'_> {
    fn masked(&self) -> MaskedView<'_> {
        MaskedView { camera: &self.camera, mask: Some(&self.mask.coverage) }
    }

    fn coloured(&self) -> ColouredView<'_> {
        let MovedView { moment, camera, picture, mask } = self;
        ColouredView { camera, picture, mask: &mask.coverage, moment: *moment }
    }
}
