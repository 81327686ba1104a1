//! Structural similarity (Wang et al. 2004) and its gradient with respect to the first image.
//!
//! Every pixel and channel looks through an 11x11 Gaussian window (sigma 1.5, weights summing to 1). Outside the image
//! both pictures are zero and the weights are not renormalised: the convention of the published Gaussian-splatting
//! code, and exact for pictures over black. With window means `m`, variances `v` and covariance `s`,
//!
//! `S = (2 m_a m_b + C1) (2 s_ab + C2) / ((m_a^2 + m_b^2 + C1) (v_a + v_b + C2))`, `C1 = 0.01^2`, `C2 = 0.03^2`,
//!
//! and the metric is the mean of `S` over pixels and channels. The window is separable; rows run in parallel and are
//! summed in order, so the value does not depend on the number of threads.

use std::ops::Range;

use gic_simd::{Kernel, Lanes, Level, MAX_LANES, Real, dispatch};
use rayon::prelude::*;

use crate::error::same_length;
use crate::{MetricError, Rectangle};

/// Window radius [pixels].
const RADIUS: usize = 5;
/// Window width [pixels].
const TAPS: usize = 2 * RADIUS + 1;
/// Standard deviation of the window [pixels].
const SIGMA: f64 = 1.5;
const C1: f64 = 1e-4;
const C2: f64 = 9e-4;
/// Rows of the gradient per task. Each also compares the rows around its own that windows reach, and needs no room for
/// more.
const BAND: usize = 48;

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
    let level = Level::active();
    let row_sums: Vec<f64> = (pair.region.top..pair.region.bottom)
        .into_par_iter()
        .map_init(|| pair.scratch(), |scratch, y| dispatch(level, Compare { pair: &pair, y, scratch, slopes: None }))
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
    gradient_at(Level::active(), &Pair::new(image, reference, width, height, region)?)
}

fn gradient_at(level: Level, pair: &Pair<'_>) -> Result<(f64, Vec<[f32; 3]>), MetricError> {
    let reached = pair.reached();
    let mut gradient = vec![[0.0f32; 3]; pair.width * pair.height];
    let row_sums: Vec<Vec<f64>> = gradient[reached.top * pair.width..reached.bottom * pair.width]
        .par_chunks_mut(BAND * pair.width)
        .enumerate()
        .map_init(|| Band::new(pair), |band, (i, out)| band.run(level, pair, reached.top + i * BAND, out))
        .collect();
    Ok((pair.mean(&row_sums.concat())?, gradient))
}

/// What one task needs for its rows of the gradient: the slopes of S in them and as far around as windows reach.
struct Band {
    /// Derivatives of S with respect to the three window means that depend on the first image, rows of the region.
    slopes: [Vec<f32>; 3],
    /// One each to compare and to pull back: they leave different numbers zero.
    scratch: [Scratch; 2],
}

impl Band {
    fn new(pair: &Pair<'_>) -> Band {
        let rows = (BAND + 2 * RADIUS).min(pair.region.height());
        Band {
            slopes: std::array::from_fn(|_| vec![0.0; rows * pair.row_length()]),
            scratch: [pair.scratch(), pair.scratch()],
        }
    }

    /// Writes image rows of the gradient from row `top` on; the sums of S along those of them that are in the region.
    fn run(&mut self, level: Level, pair: &Pair<'_>, top: usize, out: &mut [[f32; 3]]) -> Vec<f64> {
        let Band { slopes, scratch: [compared, pulled] } = self;
        let (region, reached, length) = (pair.region, pair.reached(), pair.row_length());
        let bottom = top + out.len() / pair.width;
        let rows = top.saturating_sub(RADIUS).max(region.top)..(bottom + RADIUS).min(region.bottom);
        let mut sums = Vec::with_capacity(BAND);
        for y in rows.clone() {
            let at = (y - rows.start) * length;
            let slopes = slopes.each_mut().map(|slopes| &mut slopes[at..at + length]);
            let sum = dispatch(level, Compare { pair, y, scratch: compared, slopes: Some(slopes) });
            if (top..bottom).contains(&y) {
                sums.push(sum);
            }
        }
        for (row, out) in out.chunks_exact_mut(pair.width).enumerate() {
            let out = out[reached.left..reached.right].as_flattened_mut();
            dispatch(level, PullBack { pair, slopes, rows: rows.clone(), y: top + row, scratch: pulled, out });
        }
        sums
    }
}

/// S at one pixel and channel, and its derivatives with respect to window means of the first image.
struct Similarity<R> {
    value: R,
    /// d S / d E[a], d S / d E[a^2], d S / d E[a b]
    slopes: [R; 3],
}

/// S from the window means `E[a], E[b], E[a^2 + b^2], E[a b]`.
#[inline(always)]
fn similarity<R: Real>([a, b, squares, product]: [R; 4]) -> Similarity<R> {
    let (c1, c2, one, two) = (R::splat(C1), R::splat(C2), R::one(), R::splat(2.0));
    let (mean_squares, mean_product) = (a * a + b * b, a * b);
    let (n1, n2) = (two * mean_product + c1, two * (product - mean_product) + c2);
    let (d1, d2) = (mean_squares + c1, squares - mean_squares + c2);
    let inverse = one / (d1 * d2);
    // 1 / d1 and 1 / d2 without two more divisions.
    let (by_d1, by_d2) = (inverse * d2, inverse * d1);
    let value = n1 * n2 * inverse;
    let to_mean = two * (b * (n2 - n1) * inverse - value * a * (by_d1 - by_d2));
    Similarity { value, slopes: [to_mean, -value * by_d2, two * n1 * inverse] }
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

/// Rows of up to four quantities after the vertical pass (with room for the window at both ends) and after the
/// horizontal one, both with room for lanes that start at the last number.
struct Scratch {
    vertical: [Vec<f32>; 4],
    means: [Vec<f32>; 4],
}

impl Scratch {
    fn new(length: usize) -> Scratch {
        Scratch {
            vertical: std::array::from_fn(|_| vec![0.0; length + 6 * RADIUS + MAX_LANES]),
            means: std::array::from_fn(|_| vec![0.0; length + MAX_LANES]),
        }
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
        let reached = self.reached();
        Scratch::new(3 * (reached.right - reached.left))
    }

    fn mean(&self, row_sums: &[f64]) -> Result<f64, MetricError> {
        let mean = row_sums.iter().sum::<f64>() / (self.row_length() * self.region.height()) as f64;
        if mean.is_finite() { Ok(mean) } else { Err(MetricError::NotFinite { what: "SSIM of the images", index: 0 }) }
    }

    /// The pixels that windows of the region see.
    fn reached(&self) -> Rectangle {
        let region = self.region;
        Rectangle {
            left: region.left.saturating_sub(RADIUS),
            top: region.top.saturating_sub(RADIUS),
            right: (region.right + RADIUS).min(self.width),
            bottom: (region.bottom + RADIUS).min(self.height),
        }
    }
}

/// One row of the region: the sum of S along it, and its slopes.
struct Compare<'a> {
    pair: &'a Pair<'a>,
    y: usize,
    scratch: &'a mut Scratch,
    slopes: Option<[&'a mut [f32]; 3]>,
}

impl Kernel for Compare<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<L: Lanes<Scalar = f32>>(self) -> f64 {
        let Compare { pair, y, scratch, mut slopes } = self;
        window_means::<L>(pair, y, scratch);
        let length = pair.row_length();
        let (mut sum, mut at) = (0.0, 0);
        while at < length {
            let [m0, m1, m2, m3] = &scratch.means;
            let s = similarity([L::load(&m0[at..]), L::load(&m1[at..]), L::load(&m2[at..]), L::load(&m3[at..])]);
            let mut values = [0.0; MAX_LANES];
            s.value.store(&mut values);
            let end = (at + L::LANES).min(length);
            sum += f64::from(values[..end - at].iter().sum::<f32>());
            if let Some(slopes) = &mut slopes {
                for k in 0..3 {
                    store_in(s.slopes[k], &mut slopes[k][at..end]);
                }
            }
            at = end;
        }
        sum
    }
}

/// Window means of a, b, a^2 + b^2 and a b along image row `y`, columns of the region, into `scratch.means`.
#[inline(always)]
fn window_means<L: Lanes<Scalar = f32>>(pair: &Pair<'_>, y: usize, scratch: &mut Scratch) {
    // Columns that the windows reach, clipped to the image; what is clipped stays zero in the scratch rows.
    let Rectangle { left, right, .. } = pair.reached();
    let shift = 3 * (left + RADIUS - pair.region.left);
    let (start, length) = (3 * left, 3 * (right - left));
    let rows = y.saturating_sub(RADIUS)..(y + RADIUS + 1).min(pair.height);
    let mut at = 0;
    while at < length {
        let end = (at + L::LANES).min(length);
        let mut sums = [L::zero(); 4];
        for row in rows.clone() {
            let w = L::of(pair.window[row + RADIUS - y]);
            let span = row * 3 * pair.width + start + at..row * 3 * pair.width + start + end;
            let (a, b) = (load_from(&pair.a[span.clone()]), load_from(&pair.b[span]));
            let (wa, wb): (L, L) = (w * a, w * b);
            sums[0] += wa;
            sums[1] += wb;
            sums[2] = wa.mul_add(a, wb.mul_add(b, sums[2]));
            sums[3] = wa.mul_add(b, sums[3]);
        }
        for k in 0..4 {
            store_in(sums[k], &mut scratch.vertical[k][shift + at..shift + end]);
        }
        at = end;
    }
    for k in 0..4 {
        blur_along::<L>(&scratch.vertical[k], &pair.window, &mut scratch.means[k], pair.row_length());
    }
}

/// Image row `y` of the gradient, from the slopes of S in `rows`: the window is symmetric, so the transpose of a window
/// mean is a window mean.
struct PullBack<'a> {
    pair: &'a Pair<'a>,
    slopes: &'a [Vec<f32>; 3],
    rows: Range<usize>,
    y: usize,
    scratch: &'a mut Scratch,
    out: &'a mut [f32],
}

impl Kernel for PullBack<'_> {
    type Output = ();

    #[inline(always)]
    fn run<L: Lanes<Scalar = f32>>(self) {
        let PullBack { pair, slopes, rows, y, scratch, out } = self;
        let (region, length, left) = (pair.region, pair.row_length(), pair.reached().left);
        // In the scratch row the region starts RADIUS pixels after the first pixel that gets a gradient, `left`, at
        // least virtually: `shift` numbers further to the right when the image border is nearer than that.
        let shift = 3 * (RADIUS + region.left - left);
        let seen = y.saturating_sub(RADIUS).max(rows.start)..(y + RADIUS + 1).min(rows.end);
        for k in 0..3 {
            let mut at = 0;
            while at < length {
                let end = (at + L::LANES).min(length);
                let mut sum = L::zero();
                for row in seen.clone() {
                    let from = (row - rows.start) * length;
                    let slope: L = load_from(&slopes[k][from + at..from + end]);
                    sum = slope.mul_add(L::of(pair.window[row + RADIUS - y]), sum);
                }
                store_in(sum, &mut scratch.vertical[k][shift + at..shift + end]);
                at = end;
            }
            blur_along::<L>(&scratch.vertical[k], &pair.window, &mut scratch.means[k], out.len());
        }
        let scale = L::splat(1.0 / (length * region.height()) as f64);
        let first = 3 * (y * pair.width + left);
        let mut at = 0;
        while at < out.len() {
            let end = (at + L::LANES).min(out.len());
            let [to_mean, to_square, to_product, _] = &scratch.means;
            let a: L = load_from(&pair.a[first + at..first + end]);
            let b: L = load_from(&pair.b[first + at..first + end]);
            let products = b.mul_add(L::load(&to_product[at..]), L::load(&to_mean[at..]));
            let slope = (a + a).mul_add(L::load(&to_square[at..]), products);
            store_in(scale * slope, &mut out[at..end]);
            at = end;
        }
    }
}

/// Window means along a row of interleaved RGB: `out[i] = sum_k window[k] row[i + 3 k]` for i below `length`; both have
/// room for lanes that start there.
#[inline(always)]
fn blur_along<L: Lanes<Scalar = f32>>(row: &[f32], window: &[f32; TAPS], out: &mut [f32], length: usize) {
    let mut at = 0;
    while at < length {
        let mut sum = L::zero();
        let mut tap = 0;
        while tap < TAPS {
            sum = L::load(&row[at + 3 * tap..]).mul_add(L::of(window[tap]), sum);
            tap += 1;
        }
        sum.store(&mut out[at..]);
        at += L::LANES;
    }
}

/// As many lanes as the slice has numbers, zero in the others.
#[inline(always)]
fn load_from<L: Lanes<Scalar = f32>>(from: &[f32]) -> L {
    if from.len() >= L::LANES { L::load(from) } else { L::load_partial(from, 0.0) }
}

/// As many lanes as the slice has room for.
#[inline(always)]
fn store_in<L: Lanes<Scalar = f32>>(lanes: L, to: &mut [f32]) {
    if to.len() >= L::LANES { lanes.store(to) } else { lanes.store_partial(to) }
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
                let slow = ssim_f64(&wide(&a), &wide(&b), width, height, region);
                for level in Level::supported() {
                    let pair = Pair::new(&a, &b, width, height, Some(region)).unwrap();
                    let fast = gradient_at(level, &pair).unwrap().0;
                    assert!((fast - slow).abs() < 2e-5, "{level} {width}x{height} {region:?}: {fast} {slow}");
                }
                let (alone, _) = ssim_with_gradient(&a, &b, width, height, Some(region)).unwrap();
                assert_eq!(ssim(&a, &b, width, height, Some(region)).unwrap(), alone);
            }
        }
    }

    #[test]
    fn gradient_agrees_with_finite_differences() {
        // The last is higher than a band.
        for (width, height) in [(5, 4), (26, 19), (7, BAND + 9)] {
            let (a, b) = pictures(width, height);
            let part = Rectangle { left: width / 3, top: 1, right: width - 1, bottom: height - height / 4 };
            for region in [Rectangle::whole(width, height), part] {
                let pair = Pair::new(&a, &b, width, height, Some(region)).unwrap();
                let gradients: Vec<Vec<[f32; 3]>> =
                    Level::supported().map(|level| gradient_at(level, &pair).unwrap().1).collect();
                let (wide_a, wide_b) = (wide(&a), wide(&b));
                let largest = gradients[0].iter().flatten().fold(0.0f32, |m, g| m.max(g.abs()));
                assert!(largest > 1e-4);
                for pixel in (0..width * height).step_by(if width < 10 { 1 } else { 7 }) {
                    for c in 0..3 {
                        let at = |step: f64| {
                            let mut moved = wide_a.clone();
                            moved[pixel][c] += step;
                            ssim_f64(&moved, &wide_b, width, height, region)
                        };
                        let difference = (at(1e-5) - at(-1e-5)) / 2e-5;
                        for gradient in &gradients {
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
