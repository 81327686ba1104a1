//! The observations, prepared once: masks at the resolution at which they are compared, surfaces with normals.

use std::collections::BTreeSet;

use crate::observe::extracted_surface::ObservedSurface;
use crate::observe::mask_view::{MaskView, pixel_size};
use crate::{Input, Target, Tuning};

/// One observed time.
#[derive(Clone, Debug)]
pub(crate) struct ObservedFrame {
    /// Simulated frame at this time.
    pub simulated_frame: usize,
    /// Time of that frame [s].
    pub time_s: f64,
    /// Masks; empty when they are not used.
    pub views: Vec<MaskView>,
    /// Extracted surface; `None` when it is not used or empty.
    pub surface: Option<ObservedSurface>,
}

/// All observations.
#[derive(Clone, Debug)]
pub(crate) struct ObservedVideo {
    /// In ascending time; the first is frame 0.
    pub frames: Vec<ObservedFrame>,
}

impl ObservedVideo {
    /// Prepares what `target` uses, without the cameras in `excluded`.
    pub(crate) fn new(input: &Input, target: Target, excluded: &[usize], tuning: &Tuning) -> ObservedVideo {
        let pooling = working_pooling(input);
        let frames = input
            .observations
            .iter()
            .map(|observation| {
                let views = observation
                    .views
                    .iter()
                    .filter(|view| target.masks() && !excluded.contains(&view.camera))
                    .map(|view| {
                        let (camera, device) = (&input.cameras[view.camera], input.device_of(view.camera));
                        MaskView::new(device, camera, &view.mask, pooling)
                    })
                    .collect();
                let surface = (target.surfaces() && !observation.surface.is_empty())
                    .then(|| ObservedSurface::new(&observation.surface, input.grid_spacing_m, &tuning.surfaces));
                let simulated_frame = input.frame_of(observation);
                ObservedFrame { simulated_frame, time_s: simulated_frame as f64 / input.frame_rate_hz, views, surface }
            })
            .collect();
        ObservedVideo { frames }
    }

    /// From the observation `free` on, what no view sees of the extracted surfaces does not count: it lies where it was
    /// expected, with the volume of the first frame. In free flight before, that is where it is.
    pub(crate) fn discount_unseen(&mut self, input: &Input, free: usize) {
        for (frame, observation) in self.frames.iter_mut().zip(&input.observations).skip(free) {
            if let Some(surface) = &mut frame.surface {
                surface.discount_doubtful(&observation.surface_doubts);
            }
        }
    }
}

/// Pixels are pooled until the Gaussians' standard deviation is about one pixel: finer pixels only cost time, because
/// the rendered outline is no sharper than that.
fn working_pooling(input: &Input) -> usize {
    let centre = input.centre();
    let used: BTreeSet<usize> = input.observations.iter().flat_map(|o| &o.views).map(|view| view.camera).collect();
    let mut sizes: Vec<f64> =
        used.into_iter().filter_map(|camera| pixel_size(&input.cameras[camera], centre)).collect();
    let mut scales = input.scales.clone();
    if sizes.is_empty() || scales.is_empty() {
        return 1;
    }
    sizes.sort_by(f64::total_cmp);
    scales.sort_by(f32::total_cmp);
    let ratio = f64::from(scales[scales.len() / 2]) / sizes[sizes.len() / 2];
    (ratio.round() as usize).max(1)
}
