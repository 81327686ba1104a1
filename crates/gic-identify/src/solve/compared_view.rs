//! A mask and the drawing of a motion, where they are compared.

use std::cell::LazyCell;

use gic_scene::Camera;

use crate::forward::drawing::Shown;
use crate::forward::footprint::IsotropicGaussians;
use crate::forward::occlusion::Occlusion;
use crate::forward::outline_window::outline_window;
use crate::forward::silhouette::{coverage, coverage_nearby};
use crate::observe::mask_view::{MaskView, pool};

/// The pixels of a view that particles or its mask cover, averaged in blocks.
pub(crate) struct ComparedView {
    device: usize,
    camera: Camera,
    pooling: usize,
    /// What the particles cover of each pixel, in [0, 1].
    coverage: Vec<f32>,
    /// What the mask covers of each block, in [0, 1].
    pub observed: Vec<f32>,
    /// What the particles cover of each block, in [0, 1].
    pub drawn: Vec<f32>,
}

impl ComparedView {
    /// Outside of it neither what is `shown` nor the mask of `view` are, and a step of the finite differences moves
    /// nothing there by a pixel, so that it only saves time. Blocks have `pooling` pixels to a side.
    pub(crate) fn new(view: &MaskView, shown: &Shown, pooling: usize) -> ComparedView {
        let window =
            shown.seen(view.device, &view.camera, |gaussians, camera| outline_window(view, gaussians, camera, pooling));
        let camera = window.camera(&view.camera);
        let pooled = |picture: &[f32]| pool(picture, camera.width, camera.height, pooling);
        let observed = pooled(&window.cut(&view.mask, view.camera.width));
        let coverage = shown.seen(view.device, &camera, coverage);
        let drawn = pooled(&coverage);
        ComparedView { device: view.device, camera, pooling, coverage, observed, drawn }
    }

    /// Draws motions that are less than a pixel away from that which is shown: what they cover of each block, in
    /// [0, 1].
    pub(crate) fn nearby(&self) -> impl Fn(&Shown) -> Vec<f32> {
        let occlusion = LazyCell::new(|| Occlusion::of(&self.coverage, self.camera.width));
        move |shown| {
            let drawn = |gaussians: IsotropicGaussians, camera: &Camera| coverage_nearby(gaussians, camera, &occlusion);
            pool(&shown.seen(self.device, &self.camera, drawn), self.camera.width, self.camera.height, self.pooling)
        }
    }
}
