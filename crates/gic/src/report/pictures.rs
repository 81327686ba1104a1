//! The film and the twin as every camera would have filmed it, frames that were only predicted included.

use std::collections::BTreeMap;

use gic_scene::{Mask, View};
use gic_twin::events::Events;
use gic_twin::matter::read_particles;
use gic_view::report::{Overlay, TwinDrawing, overlays};
use gic_view::skinned_gaussians::SkinnedGaussians;
use gic_view::video::Video;

use super::STAGE;
use crate::error::{Error, Result};
use crate::pipeline::{IdentifyRecord, Run, TWIN_MATTER};

/// All pictures of a report.
pub(super) struct Pictures {
    pub(super) video: Video,
    /// Per camera and frame.
    pub(super) overlays: Vec<Vec<Option<Overlay>>>,
    /// Mean overlap of the masks in each frame, where it has pictures.
    pub(super) overlap: Vec<Option<f64>>,
    /// Whether the twin has colours of its own.
    pub(super) has_colors: bool,
}

impl Pictures {
    /// # Errors
    /// Missing results, pictures that cannot be read, an interrupt.
    pub(super) fn draw(run: &Run, found: &IdentifyRecord, events: &Events) -> Result<Self> {
        let scene = &found.as_fitted(run.video());
        let moments = scene.moments();
        let frames = scene.times.len();
        let (drawing, appearance) = run.drawing(&run.continuum()?)?;
        let skin = SkinnedGaussians::load(run.folder(), &read_particles(&run.folder().join(TWIN_MATTER))?.positions)?;
        let backgrounds = (0..scene.cameras.len()).map(|camera| scene.load_background(camera));
        let backgrounds =
            backgrounds.collect::<std::result::Result<_, _>>().map_err(Error::stage("reading the empty scene"))?;
        let drawn = TwinDrawing { drawing, appearance, factor: found.splat_factor, skin, backgrounds };
        let mut by_camera: Vec<Vec<Option<Overlay>>> = scene.cameras.iter().map(|_| Vec::new()).collect();
        let (mut video, mut overlap) = (Video::of(scene), Vec::new());
        for frame in 0..frames {
            let masks = video.add_frame(scene, frame)?;
            let mut by_moment: BTreeMap<usize, Vec<(&View, &Mask)>> = BTreeMap::new();
            for seen in scene.views_at(frame).iter().zip(&masks) {
                by_moment.entry(scene.moment_of(&moments, seen.0)).or_default().push(seen);
            }
            let mut views: Vec<Option<Overlay>> = scene.cameras.iter().map(|_| None).collect();
            for (moment, seen) in by_moment {
                let found = overlays(scene, &drawn, &run.predicted(moment)?, &seen)?;
                seen.iter().zip(found).for_each(|((view, _), overlay)| views[view.camera] = Some(overlay));
            }
            let seen: Vec<f64> = views.iter().flatten().map(|overlay| overlay.iou).collect();
            overlap.push((!seen.is_empty()).then(|| seen.iter().sum::<f64>() / seen.len() as f64));
            by_camera.iter_mut().zip(views).for_each(|(camera, overlay)| camera.push(overlay));
            events.step(STAGE, "", frame as u64 + 1, Some(frames as u64), &[]);
            run.stop_if_asked("some pictures of the report")?;
        }
        Ok(Self { video, overlays: by_camera, overlap, has_colors: drawn.skin.is_some() })
    }
}
