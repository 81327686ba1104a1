//! Structural similarity (Wang et al. 2004) and its gradient with respect to the first image.
//!
//! Every pixel and channel looks through an 11x11 Gaussian window (sigma 1.5, weights summing to 1). Outside the image both
//! pictures are zero and the weights are not renormalised: the convention of the published Gaussian-splatting code, and
//! exact for pictures over black. With window means `m`, variances `v` and covariance `s`,
//!
//! `S = (2 m_a m_b + C1) (2 s_ab + C2) / ((m_a^2 + m_b^2 + C1) (v_a + v_b + C2))`, `C1 = 0.01^2`, `C2 = 0.03^2`,
//!
//! and the metric is the mean of `S` over pixels and channels. The window is separable; rows run in parallel and are summed in
//! order, so the value does not depend on the number of threads.

use rayon::prelude::*;

use crate::error::same_length;
use crate::{MetricError, Rectangle};

/// Window radius [pixels].
const RADIUS: usize = 5;
/// Window width [pixels].
const TAPS: usize = 2 * RADIUS + 1;
/// Standard deviation of the window [pixels].
const SIGMA: f64 = 1.5;
const C1: f32 = 1e-4;
const C2: f32 = 9e-4;
/// Numbers worked on at once: eight accumulators of four quantities fit the registers of AVX2.
const CHUNK: usize = 8;

/// Mean structural similarity of two RGB images over the pixels of `region` (the whole image if `None`).
///
/// Windows of pixels near the rectangle's border still see the image outside it.
pub fn ssim(
    image: &[[f32; 3]],
    reference: &[[f32; 3]],
    width: usize,
    height: usize,
    region: Option<Rectangle>,
) -> Result<f64, MetricError> {
    let pair = Pair::new(image, reference, width, height, region)?;
    let row_sums: Vec<f64> = (pair.region.top..pair.region.bottom)
        .into_par_iter()
        .map_init(
            || pair.scratch(),
            |scratch, y| {
                pair.window_means(y, scratch);
                (0..pair.row_length()).map(|i| f64::from(similarity(scratch.means(i)).value)).sum()
            },
        )
        .collect();
    pair.mean(&row_sums)
}

/// [`ssim`] and its gradient with respect to every pixel of `image`, shape [height * width, 3].
pub fn ssim_with_gradient(
    image: &[[f32; 3]],
    reference: &[[f32; 3]],
    width: usize,
    height: usize,
    region: Option<Rectangle>,
) -> Result<(f64, Vec<[f32; 3]>), MetricError> {
    let pair = Pair::new(image, reference, width, height, region)?;
    let length = pair.row_length();
    // Derivatives of S with respect to the three window means that depend on the first image.
    let mut slopes: [Vec<f32>; 3] = std::array::from_fn(|_| vec![0.0; length * pair.region.height()]);
    let mut row_sums = vec![0.0; pair.region.height()];
    let [mean, square, product] = &mut slopes;
    mean.par_chunks_exact_mut(length)
        .zip(square.par_chunks_exact_mut(length))
        .zip(product.par_chunks_exact_mut(length))
        .zip(&mut row_sums)
        .enumerate()
        .for_each_init(
            || pair.scratch(),
            |scratch, (row, (((mean, square), product), sum))| {
                pair.window_means(pair.region.top + row, scratch);
                for i in 0..length {
                    let s = similarity(scratch.means(i));
                    *sum += f64::from(s.value);
                    (mean[i], square[i], product[i]) = (s.to_mean, s.to_square, s.to_product);
                }
            },
        );
    let value = pair.mean(&row_sums)?;
    Ok((value, pair.pull_back(&slopes)))
}

/// S at one pixel and channel, and its derivatives with respect to window means of the first image.
struct Similarity {
    value: f32,
    /// d S / d E[a]
    to_mean: f32,
    /// d S / d E[a^2]
    to_square: f32,
    /// d S / d E[a b]
    to_product: f32,
}

/// S from the window means `E[a], E[b], E[a^2 + b^2], E[a b]`.
#[inline(always)]
fn similarity([a, b, squares, product]: [f32; 4]) -> Similarity {
    let mean_squares = a * a + b * b;
    let (n1, n2) = (2.0 * a * b + C1, 2.0 * (product - a * b) + C2);
    let (d1, d2) = (mean_squares + C1, squares - mean_squares + C2);
    let inverse = 1.0 / (d1 * d2);
    let value = n1 * n2 * inverse;
    Similarity {
        value,
        to_mean: 2.0 * (b * (n2 - n1) * inverse - value * a * (1.0 / d1 - 1.0 / d2)),
        to_square: -value / d2,
        to_product: 2.0 * n1 * inverse,
    }
}

/// One-dimensional Gaussian window; its outer product with itself is the 11x11 window.
fn window() -> [f32; TAPS] {
    let weight = |k: usize| (-(k as f64 - RADIUS as f64).powi(2) / (2.0 * SIGMA * SIGMA)).exp();
    let sum: f64 = (0..TAPS).map(weight).sum();
    std::array::from_fn(|k| (weight(k) / sum) as f32)
}

/// The two images as flat rows of 3 * width numbers, and where to look.
struct Pair<'a> {
    a: &'a [f32],
    b: &'a [f32],
    width: usize,
    height: usize,
    region: Rectangle,
    window: [f32; TAPS],
}

/// Rows of four quantities after the vertical pass (with room for the window at both ends) and after the horizontal one.
struct Scratch {
    vertical: [Vec<f32>; 4],
    means: [Vec<f32>; 4],
}

impl Scratch {
    fn new(length: usize) -> Scratch {
        let rounded = length.next_multiple_of(CHUNK);
        Scratch {
            vertical: std::array::from_fn(|_| vec![0.0; rounded + 6 * RADIUS + CHUNK]),
            means: std::array::from_fn(|_| vec![0.0; rounded]),
        }
    }

    #[inline(always)]
    fn means(&self, i: usize) -> [f32; 4] {
        [self.means[0][i], self.means[1][i], self.means[2][i], self.means[3][i]]
    }
}

impl<'a> Pair<'a> {
    fn new(
        image: &'a [[f32; 3]],
        reference: &'a [[f32; 3]],
        width: usize,
        height: usize,
        region: Option<Rectangle>,
    ) -> Result<Pair<'a>, MetricError> {
        same_length("image", image.len(), width * height)?;
        same_length("reference image", reference.len(), width * height)?;
        let region = Rectangle::resolve(region, width, height)?;
        Ok(Pair { a: image.as_flattened(), b: reference.as_flattened(), width, height, region, window: window() })
    }

    fn row_length(&self) -> usize {
        3 * self.region.width()
    }

    fn scratch(&self) -> Scratch {
        Scratch::new(self.row_length())
    }

    fn mean(&self, row_sums: &[f64]) -> Result<f64, MetricError> {
        let mean = row_sums.iter().sum::<f64>() / (self.row_length() * self.region.height()) as f64;
        if mean.is_finite() { Ok(mean) } else { Err(MetricError::NotFinite { what: "SSIM of the images", index: 0 }) }
    }

    /// Window means of a, b, a^2 + b^2 and a b along image row `y`, columns of the region, into `scratch.means`.
    fn window_means(&self, y: usize, scratch: &mut Scratch) {
        // Columns that the windows reach, clipped to the image; what is clipped stays zero in the scratch rows.
        let first = self.region.left.saturating_sub(RADIUS);
        let last = (self.region.right + RADIUS).min(self.width);
        let shift = 3 * (first + RADIUS - self.region.left);
        let (start, length) = (3 * first, 3 * (last - first));
        let rows = y.saturating_sub(RADIUS)..(y + RADIUS + 1).min(self.height);
        let stride = 3 * self.width;
        let [va, vb, vs, vp] = &mut scratch.vertical;
        let mut at = 0;
        while at < length {
            let n = CHUNK.min(length - at);
            let mut sums = [[0.0f32; CHUNK]; 4];
            for row in rows.clone() {
                let w = self.window[row + RADIUS - y];
                let offset = row * stride + start + at;
                if n == CHUNK {
                    add_moments(&mut sums, w, &self.a[offset..offset + CHUNK], &self.b[offset..offset + CHUNK]);
                } else {
                    let (mut a, mut b) = ([0.0; CHUNK], [0.0; CHUNK]);
                    a[..n].copy_from_slice(&self.a[offset..offset + n]);
                    b[..n].copy_from_slice(&self.b[offset..offset + n]);
                    add_moments(&mut sums, w, &a, &b);
                }
            }
            let to = shift + at..shift + at + n;
            va[to.clone()].copy_from_slice(&sums[0][..n]);
            vb[to.clone()].copy_from_slice(&sums[1][..n]);
            vs[to.clone()].copy_from_slice(&sums[2][..n]);
            vp[to].copy_from_slice(&sums[3][..n]);
            at += n;
        }
        for (vertical, means) in scratch.vertical.iter().zip(&mut scratch.means) {
            blur_along(vertical, &self.window, means);
        }
    }

    /// The gradient from the slopes of S: the window is symmetric, so the transpose of a window mean is a window mean.
    fn pull_back(&self, slopes: &[Vec<f32>; 3]) -> Vec<[f32; 3]> {
        let mut gradient = vec![[0.0f32; 3]; self.width * self.height];
        let region = self.region;
        let left = region.left.saturating_sub(RADIUS);
        let right = (region.right + RADIUS).min(self.width);
        let top = region.top.saturating_sub(RADIUS);
        let bottom = (region.bottom + RADIUS).min(self.height);
        let length = self.row_length();
        // In the scratch row the region starts RADIUS pixels after the first pixel that gets a gradient, `left`, at least
        // virtually: `shift` numbers further to the right when the image border is nearer than that.
        let shift = 3 * (RADIUS + region.left - left);
        let scale = 1.0 / (length * region.height()) as f32;
        gradient[top * self.width..bottom * self.width].par_chunks_exact_mut(self.width).enumerate().for_each_init(
            || Scratch::new(3 * (right - left)),
            |scratch, (row, out)| {
                let y = top + row;
                let rows = y.saturating_sub(RADIUS).max(region.top)..(y + RADIUS + 1).min(region.bottom);
                for (slope, vertical) in slopes.iter().zip(&mut scratch.vertical) {
                    let to = &mut vertical[shift..shift + length];
                    to.fill(0.0);
                    for source in rows.clone() {
                        let w = self.window[source + RADIUS - y];
                        let from = (source - region.top) * length;
                        for (t, s) in to.iter_mut().zip(&slope[from..from + length]) {
                            *t += w * s;
                        }
                    }
                }
                for (vertical, means) in scratch.vertical.iter().zip(&mut scratch.means).take(3) {
                    blur_along(vertical, &self.window, means);
                }
                let [to_mean, to_square, to_product, _] = &scratch.means;
                let at = 3 * (y * self.width + left);
                for (i, g) in out[left..right].as_flattened_mut().iter_mut().enumerate() {
                    *g = scale * (to_mean[i] + 2.0 * self.a[at + i] * to_square[i] + self.b[at + i] * to_product[i]);
                }
            },
        );
        gradient
    }
}

/// Adds `w` times a, b, a^2 + b^2 and a b.
#[inline(always)]
fn add_moments(sums: &mut [[f32; CHUNK]; 4], w: f32, a: &[f32], b: &[f32]) {
    for l in 0..CHUNK {
        let (wa, wb) = (w * a[l], w * b[l]);
        sums[0][l] += wa;
        sums[1][l] += wb;
        sums[2][l] += wa * a[l] + wb * b[l];
        sums[3][l] += wa * b[l];
    }
}

/// Window means along a row of interleaved RGB: `out[i] = sum_k window[k] row[i + 3 k]`; the length of `out` is a whole number
/// of chunks and `row` reaches far enough.
fn blur_along(row: &[f32], window: &[f32; TAPS], out: &mut [f32]) {
    for (chunk, out) in out.chunks_exact_mut(CHUNK).enumerate() {
        let from = &row[chunk * CHUNK..chunk * CHUNK + CHUNK + 6 * RADIUS];
        let mut sum = [0.0f32; CHUNK];
        for (k, w) in window.iter().enumerate() {
            for l in 0..CHUNK {
                sum[l] += w * from[3 * k + l];
            }
        }
        out.copy_from_slice(&sum);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The definition, pixel by pixel in f64: the oracle.
    fn ssim_f64(a: &[[f64; 3]], b: &[[f64; 3]], width: usize, height: usize, region: Rectangle) -> f64 {
        let weight = |d: isize| (-(d as f64).powi(2) / (2.0 * SIGMA * SIGMA)).exp();
        let norm: f64 = (-5..=5).map(weight).sum();
        let mut sum = 0.0;
        for y in region.top..region.bottom {
            for x in region.left..region.right {
                for c in 0..3 {
                    let mut m = [0.0f64; 5];
                    for dy in -5isize..=5 {
                        for dx in -5isize..=5 {
                            let (yy, xx) = (y as isize + dy, x as isize + dx);
                            if yy < 0 || xx < 0 || yy >= height as isize || xx >= width as isize {
                                continue;
                            }
                            let w = weight(dx) * weight(dy) / (norm * norm);
                            let i = yy as usize * width + xx as usize;
                            let (p, q) = (a[i][c], b[i][c]);
                            for (s, v) in m.iter_mut().zip([p, q, p * p, q * q, p * q]) {
                                *s += w * v;
                            }
                        }
                    }
                    let [ma, mb, aa, bb, ab] = m;
                    sum += (2.0 * ma * mb + 1e-4) * (2.0 * (ab - ma * mb) + 9e-4)
                        / ((ma * ma + mb * mb + 1e-4) * (aa - ma * ma + bb - mb * mb + 9e-4));
                }
            }
        }
        sum / (3 * region.width() * region.height()) as f64
    }

    /// A pair of pictures with structure and noise, one over black.
    fn pictures(width: usize, height: usize) -> (Vec<[f32; 3]>, Vec<[f32; 3]>) {
        let mut state = 1u32;
        let mut noise = move || {
            state = state.wrapping_mul(1664525).wrapping_add(1013904223);
            (state >> 8) as f32 / (1 << 24) as f32
        };
        let mut a = Vec::new();
        let mut b = Vec::new();
        for y in 0..height {
            for x in 0..width {
                let t = 0.5 + 0.4 * ((x as f32 * 0.7).sin() * (y as f32 * 0.4).cos());
                let inside = if x * 3 > width { 1.0 } else { 0.0 };
                b.push([t * inside, (1.0 - t) * inside, 0.3 * inside]);
                a.push([t * inside + 0.1 * noise(), 0.8 * (1.0 - t) * inside, 0.2 + 0.2 * noise()]);
            }
        }
        (a, b)
    }

    fn wide(image: &[[f32; 3]]) -> Vec<[f64; 3]> {
        image.iter().map(|p| p.map(f64::from)).collect()
    }

    #[test]
    fn equal_images_score_one() {
        let (_, b) = pictures(23, 17);
        let (value, gradient) = ssim_with_gradient(&b, &b, 23, 17, None).unwrap();
        assert!((value - 1.0).abs() < 1e-5, "{value}");
        assert!(gradient.iter().flatten().all(|g| g.abs() < 1e-4), "the maximum has no slope");
    }

    #[test]
    fn fast_path_agrees_with_the_definition() {
        for (width, height) in [(1, 1), (7, 3), (23, 17), (40, 31)] {
            let (a, b) = pictures(width, height);
            let whole = Rectangle::whole(width, height);
            let part = Rectangle { left: width / 3, top: height / 4, right: width, bottom: height - height / 5 };
            for region in [whole, part] {
                let fast = ssim(&a, &b, width, height, Some(region)).unwrap();
                let slow = ssim_f64(&wide(&a), &wide(&b), width, height, region);
                assert!((fast - slow).abs() < 2e-5, "{width}x{height} {region:?}: {fast} {slow}");
                assert_eq!(fast, ssim_with_gradient(&a, &b, width, height, Some(region)).unwrap().0);
            }
        }
    }

    #[test]
    fn gradient_agrees_with_finite_differences() {
        for (width, height) in [(5, 4), (26, 19)] {
            let (a, b) = pictures(width, height);
            let part = Rectangle { left: width / 3, top: 1, right: width - 1, bottom: height - height / 4 };
            for region in [Rectangle::whole(width, height), part] {
                let (_, gradient) = ssim_with_gradient(&a, &b, width, height, Some(region)).unwrap();
                let (wide_a, wide_b) = (wide(&a), wide(&b));
                let largest = gradient.iter().flatten().fold(0.0f32, |m, g| m.max(g.abs()));
                assert!(largest > 1e-4);
                for pixel in (0..width * height).step_by(if width < 10 { 1 } else { 7 }) {
                    for c in 0..3 {
                        let at = |step: f64| {
                            let mut moved = wide_a.clone();
                            moved[pixel][c] += step;
                            ssim_f64(&moved, &wide_b, width, height, region)
                        };
                        let difference = (at(1e-5) - at(-1e-5)) / 2e-5;
                        let error = (f64::from(gradient[pixel][c]) - difference).abs();
                        assert!(
                            error < 1e-3 * f64::from(largest),
                            "pixel {pixel} channel {c}: {error:e} of {largest:e}"
                        );
                    }
                }
            }
        }
    }

    #[test]
    fn wrong_shapes_are_errors() {
        let (a, b) = pictures(6, 5);
        assert!(ssim(&a, &b[1..], 6, 5, None).is_err());
        assert!(ssim(&a, &b, 5, 5, None).is_err());
        assert!(ssim(&[], &[], 0, 0, None).is_err());
        let mut nan = a.clone();
        nan[3][0] = f32::NAN;
        assert!(matches!(ssim(&nan, &b, 6, 5, None), Err(MetricError::NotFinite { .. })));
    }
}
