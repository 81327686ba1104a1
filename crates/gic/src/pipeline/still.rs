//! The frames in which the object still has the shape that it has in the first, by its outlines alone.
//!
//! Where cameras are so few that the reconstructed surface shows no symmetry, the outlines may: then each frame of flight shows the same body from
//! as many sides again, and all of them together say where it is not.

use gic_continuum::{ColouredView, FillSettings, Filling, MaskedView, Symmetry, fill_outlines};
use gic_scene::{Camera, Mask, Picture};

use super::source::{Source, mean};
use crate::error::{Error, Result};

/// The first frames, of which all show the same body.
pub(super) struct Still {
    /// The body's mirror planes in each of them.
    symmetries: Vec<Symmetry>,
    pictures: Vec<Vec<(Picture, Mask)>>,
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
        let mut still = Still { symmetries: vec![first], pictures: vec![source.pictures(0)?] };
        for frame in 1..source.scene.times.len() {
            let masks = source.masks(frame)?;
            let views = source.masked_views(frame, &masks);
            let Some(symmetry) = still.symmetries[0].followed(&views, centre(frame) - start) else { break };
            still.symmetries.push(symmetry);
            still.pictures.push(source.pictures(frame)?);
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
        let moved: Vec<Moved> = (0..self.frames()).flat_map(|moment| self.moved(source, moment, here)).collect();
        let gaussians = source.gaussians.at(source.scene.times[frame]);
        let views: Vec<MaskedView> = moved.iter().map(Moved::masked).collect();
        let mut filling = fill_outlines(&gaussians, &views, here, settings).map_err(Error::filling(frame))?;
        let views: Vec<ColouredView> = moved.iter().map(Moved::coloured).collect();
        filling.carve(&views, here);
        Ok(filling)
    }

    /// The views of a moment, moved to where they would have seen the body with its planes `here`.
    fn moved<'a>(
        &'a self,
        source: &'a Source,
        moment: usize,
        here: &'a Symmetry,
    ) -> impl Iterator<Item = Moved<'a>> + 'a {
        let cameras = source.scene.views_at(moment).iter().map(|view| source.scene.camera_of(view));
        let pictures = cameras.zip(&self.pictures[moment]).filter(|(_, (_, mask))| mask.area() > 0.0);
        pictures.filter_map(move |(camera, (picture, mask))| {
            let camera = here.camera_at_rest(&self.symmetries[moment], camera)?;
            Some(Moved { moment, camera, picture, mask })
        })
    }
}

/// A view whose camera was moved.
struct Moved<'a> {
    moment: usize,
    camera: Camera,
    picture: &'a Picture,
    mask: &'a Mask,
}

impl Moved<'_> {
    fn masked(&self) -> MaskedView<'_> {
        MaskedView { camera: &self.camera, mask: Some(&self.mask.coverage) }
    }

    fn coloured(&self) -> ColouredView<'_> {
        let Moved { moment, camera, picture, mask } = self;
        ColouredView { camera, picture, mask: &mask.coverage, moment: *moment }
    }
}
