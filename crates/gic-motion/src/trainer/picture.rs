//! One picture of a step: drawn where something is, compared, and its gradient.

use gic_scene::Camera;
use gic_splat::{GaussianGradients, Gaussians, RenderSettings, backward, render};
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::Trainer;
use crate::MotionError;
use crate::loss::picture_loss;
use crate::parameters;
use crate::targets::{Bounds, Target, windowed};

/// Gaussians per parallel task, at least.
const PER_TASK: usize = 2048;

pub(super) struct ViewGradient {
    pub(super) loss: f64,
    pub(super) squared: (f64, usize),
    pub(super) slope: GaussianGradients,
    pub(super) screen_unit: f64,
}

impl Trainer<'_> {
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

/// The pixels that Gaussians within three standard deviations can touch.
pub(crate) fn drawn_bounds(gaussians: &Gaussians, camera: &Camera) -> Bounds {
    let scales = parameters::flat_scales(&gaussians.shape);
    let axes = scales.len() / gaussians.len().max(1);
    let reached = |(i, position): (usize, &[f32; 3])| {
        let scale = scales[i * axes..(i + 1) * axes].iter().copied().fold(0.0, f32::max);
        let (pixel, depth) = camera.project(DVec3::from_array(position.map(f64::from)))?;
        let reach = 3.0 * f64::from(scale) / depth * camera.focal.max_element() + 1.0;
        (reach.is_finite() && pixel.is_finite()).then(|| (pixel - reach, pixel + reach))
    };
    let nothing = || (DVec2::INFINITY, DVec2::NEG_INFINITY);
    let both = |a: (DVec2, DVec2), b: (DVec2, DVec2)| (a.0.min(b.0), a.1.max(b.1));
    let positions = gaussians.positions.par_iter().with_min_len(PER_TASK).enumerate();
    let (low, high) = positions.filter_map(reached).reduce(nothing, both);
    // Casting saturates, so infinities give an empty window.
    let clamp = |x: f64, end: usize| (x.max(0.0) as usize).min(end);
    let bounds = Bounds {
        x0: clamp(low.x.floor(), camera.width),
        y0: clamp(low.y.floor(), camera.height),
        x1: clamp(high.x.ceil(), camera.width),
        y1: clamp(high.y.ceil(), camera.height),
    };
    if bounds.is_empty() { Bounds::EMPTY } else { bounds }
}
