//! The loss of one picture (paper eq. 5) and its gradient with respect to the picture.
//!
//! `L = (w_color sum |C - C*| / 3 + w_ssim sum (1 - SSIM) + w_mask sum |A - A*|) / area`, with sums over the window's
//! pixels, C and A the rendered colour and alpha, C* and A* the picture and its mask, SSIM after Wang et al. 2004.

use gic_metrics::{MetricError, ssim_with_gradient};
use gic_splat::{ImageGradients, Rendered};
use rayon::prelude::*;

use crate::LossWeights;
use crate::tuning::MIN_AREA_SHARE;

/// Pixels per parallel task.
const PIXELS_PER_TASK: usize = 1 << 13;

/// Loss of one picture.
pub struct PictureLoss {
    /// Weighted sum of the picture terms.
    pub value: f64,
    /// Sum of squared colour differences, and how many there are.
    pub squared: (f64, usize),
    /// d value / d picture.
    pub gradient: ImageGradients,
}

/// PSNR [dB] of a sum of squared colour differences and their number.
pub fn psnr((squared, count): (f64, usize)) -> f64 {
    -10.0 * (squared / count.max(1) as f64).log10()
}

/// Compares a rendered window with its target colour and mask; `area` is the object's area in the picture [pixels].
///
/// # Errors
/// [`MetricError`] where the sizes do not belong together.
pub fn picture_loss(
    rendered: &Rendered,
    (color, mask): (&[[f32; 3]], &[f32]),
    (width, height): (usize, usize),
    area: f64,
    weights: &LossWeights,
) -> Result<PictureLoss, MetricError> {
    let pixels = width * height;
    let area = area.max(MIN_AREA_SHARE * pixels as f64).max(1.0);
    let step = (weights.color / (3.0 * area)) as f32;
    let mut d_color = vec![[0.0f32; 3]; pixels];
    let sums: Vec<(f64, f64)> = d_color
        .par_chunks_mut(PIXELS_PER_TASK)
        .zip(rendered.color.par_chunks(PIXELS_PER_TASK))
        .zip(color.par_chunks(PIXELS_PER_TASK))
        .map(|((slopes, got), wanted)| {
            let mut sums = (0.0, 0.0);
            for ((slope, got), wanted) in slopes.iter_mut().zip(got).zip(wanted) {
                let difference: [f32; 3] = core::array::from_fn(|c| got[c] - wanted[c]);
                sums.0 += f64::from(difference.iter().map(|d| d.abs()).sum::<f32>());
                sums.1 += f64::from(difference.iter().map(|d| d * d).sum::<f32>());
                *slope = difference.map(|d| step * sign(d));
            }
            sums
        })
        .collect();
    let (absolute, squared) = sums.iter().fold((0.0, 0.0), |(a, b), (c, d)| (a + c, b + d));
    let mut value = weights.color * absolute / (3.0 * area);
    if weights.ssim > 0.0 {
        let (ssim, d_ssim) = ssim_with_gradient(&rendered.color, color, width, height, None)?;
        // The metric is a mean over the window; ours is a sum over its pixels divided by the object's area.
        let scale = weights.ssim * pixels as f64 / area;
        value += scale * (1.0 - ssim);
        d_color.par_chunks_mut(PIXELS_PER_TASK).zip(d_ssim.par_chunks(PIXELS_PER_TASK)).for_each(|(d, s)| {
            let pairs = d.as_flattened_mut().iter_mut().zip(s.as_flattened());
            pairs.for_each(|(d, s)| *d -= scale as f32 * s);
        });
    }
    let step = (weights.mask / area) as f32;
    let mut d_alpha = vec![0.0f32; pixels];
    let sums: Vec<f64> = d_alpha
        .par_chunks_mut(PIXELS_PER_TASK)
        .zip(rendered.alpha.par_chunks(PIXELS_PER_TASK))
        .zip(mask.par_chunks(PIXELS_PER_TASK))
        .map(|((slopes, got), wanted)| {
            let mut sum = 0.0;
            for ((slope, got), wanted) in slopes.iter_mut().zip(got).zip(wanted) {
                sum += f64::from((got - wanted).abs());
                *slope = step * sign(got - wanted);
            }
            sum
        })
        .collect();
    value += weights.mask * sums.iter().sum::<f64>() / area;
    let gradient = ImageGradients { color: d_color, alpha: d_alpha, depth: Vec::new() };
    Ok(PictureLoss { value, squared: (squared, 3 * pixels), gradient })
}

/// Derivative of the absolute value; 0 at 0.
fn sign(x: f32) -> f32 {
    if x > 0.0 {
        1.0
    } else if x < 0.0 {
        -1.0
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gradient_agrees_with_finite_differences() {
        let (width, height) = (9, 7);
        let n = width * height;
        let wave = |i: usize, k: f32| 0.5 + 0.4 * (i as f32 * k).sin();
        let color: Vec<[f32; 3]> = (0..n).map(|i| [wave(i, 0.31), wave(i, 0.17), wave(i, 0.23)]).collect();
        let mask: Vec<f32> = (0..n).map(|i| wave(i, 0.41)).collect();
        let camera = gic_scene::Camera {
            width,
            height,
            focal: glam::DVec2::ONE,
            principal: glam::DVec2::ZERO,
            world_from_camera: glam::DMat3::IDENTITY,
            centre: glam::DVec3::ZERO,
        };
        let nothing = gic_splat::Gaussians::colorless(vec![], vec![], vec![]);
        let mut rendered = gic_splat::render(&nothing, &camera, &gic_splat::RenderSettings::default());
        rendered.color = (0..n).map(|i| [wave(i, 0.12), wave(i, 0.53), wave(i, 0.07)]).collect();
        rendered.alpha = (0..n).map(|i| wave(i, 0.29)).collect();
        let weights = LossWeights { color: 0.8, ssim: 0.3, mask: 0.7, ..LossWeights::default() };
        let loss = |r: &Rendered| picture_loss(r, (&color, &mask), (width, height), 20.0, &weights).unwrap();
        let gradient = loss(&rendered).gradient;
        // Steps that are wide for f32 but smaller than every difference, so that no absolute value is crossed.
        let h = 1e-3f32;
        for i in (0..n).step_by(5) {
            for c in 0..3 {
                let kept = rendered.color[i][c];
                if (kept - color[i][c]).abs() < 2.0 * h {
                    continue;
                }
                rendered.color[i][c] = kept + h;
                let above = loss(&rendered).value;
                rendered.color[i][c] = kept - h;
                let below = loss(&rendered).value;
                rendered.color[i][c] = kept;
                let expected = (above - below) / (2.0 * f64::from(h));
                let got = f64::from(gradient.color[i][c]);
                assert!((got - expected).abs() < 2e-4 * (1.0 + expected.abs()), "{i} {c}: {got} against {expected}");
            }
            let kept = rendered.alpha[i];
            if (kept - mask[i]).abs() < 2.0 * h {
                continue;
            }
            rendered.alpha[i] = kept + h;
            let above = loss(&rendered).value;
            rendered.alpha[i] = kept - h;
            let below = loss(&rendered).value;
            rendered.alpha[i] = kept;
            let expected = (above - below) / (2.0 * f64::from(h));
            assert!((f64::from(gradient.alpha[i]) - expected).abs() < 1e-4, "alpha {i}");
        }
    }
}
