//! Depth maps of the Gaussians, and what they tell of the surface: how obliquely it is seen, and where it may have gaps
//! between the Gaussians that draw it.

use gic_scene::Camera;
use gic_splat::{Gaussians, RenderSettings, render};

/// D / A [m] where the Gaussians are solid and the mask covers, else infinite.
pub(super) fn depth_map(gaussians: &Gaussians, camera: &Camera, mask: &[f32]) -> Vec<f32> {
    let rendered = render(gaussians, camera, &RenderSettings::default());
    let depth = |i: usize| {
        let alpha = rendered.alpha[i];
        if alpha >= 0.5 && mask[i] > 0.0 { rendered.depth[i] / alpha } else { f32::INFINITY }
    };
    (0..mask.len()).map(depth).collect()
}

/// Pixels where the surface [m] lies behind its morphological opening by more than the Gaussians' median scale [m]. The
/// opening fills every hole no wider than a Gaussian, which ends at `extent` scales to each side, and leaves slopes and
/// steps as they are.
pub(super) fn small_holes(depth: &[f32], camera: &Camera, scale: f64, extent: f64) -> Vec<bool> {
    let solid = depth.iter().filter(|d| d.is_finite());
    let mean = solid.clone().map(|&d| f64::from(d)).sum::<f64>() / solid.count().max(1) as f64;
    let half_width = extent * scale * camera.focal.x / mean.max(f64::MIN_POSITIVE);
    let half_width = half_width.ceil().min(camera.width as f64) as usize;
    let nearest = square_window(depth, camera.width, half_width, |a, b| if b < a { b } else { a });
    let opened = square_window(&nearest, camera.width, half_width, |a, b| if b > a { b } else { a });
    depth.iter().zip(&opened).map(|(&d, &o)| d - o > scale as f32).collect()
}

/// The least or largest value in a square of `half_width` pixels to each side of each pixel.
fn square_window(values: &[f32], width: usize, half_width: usize, of: impl Fn(f32, f32) -> f32) -> Vec<f32> {
    let join = |joined: &mut [f32], others: &[f32]| {
        joined.iter_mut().zip(others).for_each(|(j, &other)| *j = of(*j, other));
    };
    let widen = |values: &[f32], stride: usize| {
        let (mut joined, count) = (values.to_vec(), values.len());
        for shift in (1..=half_width).map(|k| k * stride).filter(|&shift| shift < count) {
            join(&mut joined[shift..], &values[..count - shift]);
            join(&mut joined[..count - shift], &values[shift..]);
        }
        joined
    };
    let rows: Vec<f32> = values.chunks_exact(width).flat_map(|row| widen(row, 1)).collect();
    widen(&rows, width)
}

/// Cosine between ray and surface normal from the slope of the depth map: a pixel is z / f wide at depth z.
pub(super) fn cosines(depth: &[f32], camera: &Camera) -> Vec<f32> {
    let (w, h) = (camera.width, camera.height);
    let slope = |a: f32, b: f32, z: f32, focal: f64| -> f32 {
        let s = (a - b) * 0.5 * focal as f32 / z;
        if s.is_finite() { s } else { 0.0 }
    };
    (0..w * h)
        .map(|i| {
            let z = depth[i];
            if !z.is_finite() {
                return 1.0;
            }
            let (x, y) = (i % w, i / w);
            let sx = if x > 0 && x + 1 < w { slope(depth[i + 1], depth[i - 1], z, camera.focal.x) } else { 0.0 };
            let sy = if y > 0 && y + 1 < h { slope(depth[i + w], depth[i - w], z, camera.focal.y) } else { 0.0 };
            1.0 / (1.0 + sx * sx + sy * sy).sqrt()
        })
        .collect()
}
