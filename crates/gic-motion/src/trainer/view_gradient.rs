//! One picture of a step: drawn where something is, compared, and its gradient.

use gic_splat::{GaussianGradients, Gaussians, RenderSettings, backward, render};

use super::training::Training;
use crate::MotionError;
use crate::pictures::{Target, drawn_bounds, picture_loss, windowed};

pub(super) struct ViewGradient {
    pub(super) loss: f64,
    pub(super) squared: (f64, usize),
    pub(super) slope: GaussianGradients,
    pub(super) screen_unit: f64,
}

impl Training<'_> {
    /// Loss and gradient of one view, rendered where its mask or the Gaussians are.
    pub(super) fn view_gradient(
        &self,
        target: &Target,
        gaussians: &Gaussians,
        degree: usize,
    ) -> Result<ViewGradient, MotionError> {
        let window = drawn_bounds(gaussians, &target.camera).union(target.bounds);
        if window.is_empty() {
            return Ok(ViewGradient {
                loss: 0.0,
                squared: (0.0, 0),
                slope: GaussianGradients::zeros(gaussians),
                screen_unit: 0.0,
            });
        }
        let camera = windowed(&target.camera, window);
        let mut settings = RenderSettings { max_sh_degree: degree, ..RenderSettings::pictures() };
        // The same width on the object, whatever the size of the pixels: nothing changes when they do.
        settings.dilation /= target.pixel.powi(2) as f32;
        let rendered = render(gaussians, &camera, &settings);
        let (color, mask) = target.crop(window);
        let size = (camera.width, camera.height);
        let loss = picture_loss(&rendered, (&color, &mask), size, target.area, &self.settings.loss)?;
        let slope = backward(gaussians, &camera, &settings, &rendered, &loss.gradient);
        let (width, height) = (target.camera.width as f64, target.camera.height as f64);
        // To the loss averaged over the picture, per half of its width: the units in which 3DGS states its threshold.
        let screen_unit = target.area.max(1.0) / (width * height) * width / 2.0;
        Ok(ViewGradient { loss: loss.value, squared: loss.squared, slope, screen_unit })
    }
}
