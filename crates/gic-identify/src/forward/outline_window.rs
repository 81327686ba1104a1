//! Which pixels of a view are compared.

use gic_scene::Camera;
use gic_simd::{Kernel, Lanes, Level, dispatch};

use crate::forward::footprint::{IsotropicGaussians, Projection};
use crate::observe::mask_view::{MaskView, Window};

/// The pixels that the particles, as `camera` sees them, or the mask of `view` cover, in whole blocks of `block`
/// pixels.
pub(crate) fn outline_window(view: &MaskView, gaussians: IsotropicGaussians, camera: &Camera, block: usize) -> Window {
    let drawn = dispatch(Level::active(), Extent { gaussians, camera, known: view.covered });
    drawn.aligned(block, (view.camera.width, view.camera.height))
}

/// The pixels that particles cover, besides those known.
struct Extent<'a> {
    gaussians: IsotropicGaussians<'a>,
    camera: &'a Camera,
    known: Window,
}

impl Kernel for Extent<'_> {
    type Output = Window;

    #[inline(always)]
    fn run<L: Lanes<Scalar = f32>>(self) -> Window {
        let (projection, mut window) = (Projection::new(self.camera), self.known);
        for first in (0..self.gaussians.positions.len()).step_by(L::LANES) {
            for (_, footprint) in projection.footprints::<L>(&self.gaussians, first).seen() {
                window.join(footprint.columns, footprint.rows);
            }
        }
        window
    }
}
