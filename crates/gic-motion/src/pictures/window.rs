//! The part of a picture that Gaussians can touch; outside of it nothing needs to be drawn.

use gic_scene::Camera;
use gic_splat::Gaussians;
use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::Bounds;

/// Gaussians per parallel task, at least.
const GAUSSIANS_PER_TASK: usize = 2048;

/// The pixels that Gaussians within three standard deviations can touch.
pub fn drawn_bounds(gaussians: &Gaussians, camera: &Camera) -> Bounds {
    let scales = gaussians.shape.flat_scales();
    let axes = scales.len() / gaussians.len().max(1);
    let reached = |(i, position): (usize, &[f32; 3])| {
        let scale = scales[i * axes..(i + 1) * axes].iter().copied().fold(0.0, f32::max);
        let (pixel, depth) = camera.project(DVec3::from_array(position.map(f64::from)))?;
        let reach = 3.0 * f64::from(scale) / depth * camera.focal.max_element() + 1.0;
        (reach.is_finite() && pixel.is_finite()).then(|| (pixel - reach, pixel + reach))
    };
    let nothing = || (DVec2::INFINITY, DVec2::NEG_INFINITY);
    let both = |a: (DVec2, DVec2), b: (DVec2, DVec2)| (a.0.min(b.0), a.1.max(b.1));
    let positions = gaussians.positions.par_iter().with_min_len(GAUSSIANS_PER_TASK).enumerate();
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
