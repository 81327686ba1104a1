//! From a start to the pictures: Adam on turn, shift and size, with the rasteriser's gradients.

use gic_metrics::mask_iou;
use gic_motion::LossWeights;
use gic_motion::pictures::{Target, drawn_bounds, picture_loss, windowed};
use gic_optimize::{Moments, decayed};
use gic_splat::{GaussianGradients, Gaussians, RenderSettings, backward, render};
use rayon::prelude::*;

use super::placement::{Placement, UNKNOWNS};
use crate::AppearanceError;
use crate::tuning::{MAX_CHANNEL_GAIN, SIZE_STEP_SHARE};

/// Length of a step: turn [rad], and shift in radii of the object. The size changes half as fast.
#[derive(Clone, Copy)]
pub(crate) struct DescentSchedule {
    pub(crate) steps: usize,
    pub(crate) rates: (f64, f64),
}

/// A placement against the pictures.
pub(crate) struct PlacementScore {
    /// Mean loss over the views.
    pub(crate) loss: f64,
    /// Overlap of alpha and mask in each view.
    pub(crate) iou: Vec<f64>,
}

/// Fits a placement to `views`; `radius` is the scan's, in its units.
pub(crate) fn refine(
    (scan, radius): (&Gaussians, f64),
    views: &[Target],
    start: Placement,
    schedule: DescentSchedule,
    weights: &LossWeights,
) -> Result<Placement, AppearanceError> {
    let mut placement = start;
    let mut moments = Moments::zeros(UNKNOWNS);
    for step in 0..schedule.steps {
        let moved = placement.gaussians(scan);
        let comparisons = compare(&moved, views, weights)?;
        let mut gradient = [0.0; UNKNOWNS];
        for view in &comparisons {
            let one = placement.pull_back_all(&moved, &view.slope);
            gradient.iter_mut().zip(one).for_each(|(s, d)| *s += d);
        }
        let length = placement.scale * radius;
        let units = [1.0, 1.0, 1.0, length, length, length, SIZE_STEP_SHARE];
        // In these units the seven numbers move the pictures alike.
        let gradient: Vec<f32> = gradient.iter().zip(units).map(|(g, unit)| (g * unit) as f32).collect();
        let mut change = [0.0f32; UNKNOWNS];
        let rate = decayed(schedule.rates, step as f64 / schedule.steps as f64);
        moments.update(&mut change, &gradient, rate, step + 1);
        placement = placement.stepped(&std::array::from_fn(|k| f64::from(change[k]) * units[k]));
    }
    Ok(placement)
}

/// Compares a placement with the pictures.
pub(crate) fn score_placement(
    scan: &Gaussians,
    views: &[Target],
    placement: &Placement,
    weights: &LossWeights,
) -> Result<PlacementScore, AppearanceError> {
    let comparisons = compare(&placement.gaussians(scan), views, weights)?;
    let loss = comparisons.iter().map(|view| view.loss).sum::<f64>() / views.len() as f64;
    Ok(PlacementScore { loss, iou: comparisons.into_iter().map(|view| view.iou).collect() })
}

struct ViewComparison {
    loss: f64,
    iou: f64,
    slope: GaussianGradients,
}

fn compare(
    gaussians: &Gaussians,
    views: &[Target],
    weights: &LossWeights,
) -> Result<Vec<ViewComparison>, AppearanceError> {
    views.par_iter().map(|view| compare_view(gaussians, view, weights)).collect()
}

fn compare_view(
    gaussians: &Gaussians,
    target: &Target,
    weights: &LossWeights,
) -> Result<ViewComparison, AppearanceError> {
    let window = drawn_bounds(gaussians, &target.camera).union(target.bounds);
    let camera = windowed(&target.camera, window);
    let mut settings = RenderSettings { max_sh_degree: 0, ..RenderSettings::pictures() };
    settings.dilation /= target.pixel.powi(2) as f32;
    let mut rendered = render(gaussians, &camera, &settings);
    let (color, mask) = target.crop(window);
    let channel_gains = channel_gains(&rendered.color, &color);
    for c in &mut rendered.color {
        *c = std::array::from_fn(|k| c[k] * channel_gains[k]);
    }
    let mut loss = picture_loss(&rendered, (&color, &mask), (camera.width, camera.height), target.area, weights)?;
    for d in &mut loss.gradient.color {
        *d = std::array::from_fn(|k| d[k] * channel_gains[k]);
    }
    let slope = backward(gaussians, &camera, &settings, &rendered, &loss.gradient);
    Ok(ViewComparison { loss: loss.value, iou: mask_iou(&rendered.alpha, &mask)?, slope })
}

/// The factor per colour that brings `drawn` nearest to `wanted`: photographs and video have lights and white balances
/// of their own.
fn channel_gains(drawn: &[[f32; 3]], wanted: &[[f32; 3]]) -> [f32; 3] {
    std::array::from_fn(|k| {
        let (mut both, mut own) = (0.0, 0.0);
        for (d, w) in drawn.iter().zip(wanted) {
            both += f64::from(d[k] * w[k]);
            own += f64::from(d[k] * d[k]);
        }
        if own > 0.0 { (both / own).clamp(1.0 / MAX_CHANNEL_GAIN, MAX_CHANNEL_GAIN) as f32 } else { 1.0 }
    })
}
