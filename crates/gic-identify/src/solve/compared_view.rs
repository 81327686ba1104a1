//! A mask and the drawing of a motion, where they are compared.

use gic_scene::Camera;

use crate::forward::drawing::Shown;
use crate::forward::outline_window::outline_window;
use crate::forward::silhouette::coverage;
use crate::observe::mask_view::{MaskView, pool};

/// The pixels of a view that particles or its mask cover, averaged in blocks.
pub(crate) struct ComparedView {
    device: usize,
    camera: Camera,
    pooling: usize,
    /// What the mask covers of each block, in [0, 1].
    pub observed: Vec<f32>,
}

impl ComparedView {
    /// Outside of it neither what is `shown` nor the mask of `view` are, and a step of the finite differences moves
    /// nothing there by a pixel, so that it only saves time. Blocks have `pooling` pixels to a side.
    pub(crate) fn new(view: &MaskView, shown: &Shown, pooling: usize) -> ComparedView {
        let window =
            shown.seen(view.device, &view.camera, |gaussians, camera| outline_window(view, gaussians, camera, pooling));
        let camera = window.camera(&view.camera);
        let observed = pool(&window.cut(&view.mask, view.camera.width), camera.width, camera.height, pooling);
        ComparedView { device: view.device, camera, pooling, observed }
    }

    /// What is shown covers of each block, in [0, 1].
    pub(crate) fn drawn(&self, shown: &Shown) -> Vec<f32> {
        let drawn = shown.seen(self.device, &self.camera, coverage);
        pool(&drawn, self.camera.width, self.camera.height, self.pooling)
    }
}
