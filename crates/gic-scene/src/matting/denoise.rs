//! Noise goes, edges stay: the bilateral filter (Tomasi and Manduchi 1998, "Bilateral filtering for gray and color
//! images").

use rayon::prelude::*;

use super::tuning::{DENOISE_RADIUS_PX, DENOISE_RANGE};

/// Each pixel becomes the mean of its neighbours, those the more that are as it is but for noise of these deviations.
pub(super) fn denoised(image: &[[f32; 3]], width: usize, noise: [f32; 3]) -> Vec<[f32; 3]> {
    let height = image.len() / width.max(1);
    let near = |at: usize, end: usize| at.saturating_sub(DENOISE_RADIUS_PX)..(at + DENOISE_RADIUS_PX + 1).min(end);
    let at = |i: usize| {
        let (mut sum, mut total) = ([0.0; 3], 0.0);
        for y in near(i / width, height) {
            for x in near(i % width, width) {
                let other = image[y * width + x];
                let deviation = |c: usize| (other[c] - image[i][c]) / (DENOISE_RANGE * noise[c]);
                let squared: f32 = (0..3).map(|c| deviation(c).powi(2)).sum();
                let weight = (-squared / 6.0).exp();
                total += weight;
                (0..3).for_each(|c| sum[c] += weight * other[c]);
            }
        }
        sum.map(|channel| channel / total)
    };
    (0..image.len()).into_par_iter().map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A step of ten deviations between two halves with noise, the sign of which alternates.
    #[test]
    fn noise_goes_and_edges_stay() {
        let (width, height, noise) = (12, 8, 0.02);
        let at = |i: usize| {
            let (x, y) = (i % width, i / width);
            let side = if x < width / 2 { 0.3 } else { 0.5 };
            [side + if (x + y) % 2 == 0 { noise } else { -noise }; 3]
        };
        let image: Vec<[f32; 3]> = (0..width * height).map(at).collect();
        let smooth = denoised(&image, width, [noise; 3]);
        for (i, pixel) in smooth.iter().enumerate() {
            let side = if i % width < width / 2 { 0.3 } else { 0.5 };
            assert!((pixel[0] - side).abs() < 0.5 * noise, "pixel {i}: {}", pixel[0]);
        }
    }
}
