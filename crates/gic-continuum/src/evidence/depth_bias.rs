//! How far the rendered depth of a surface lies from the centres of the Gaussians that draw it.

use crate::tuning::Tuning;

/// Median distance of the Gaussians' centres behind the rendered depth, perpendicular to the surface [m], by
/// obliqueness.
///
/// Accumulated depth is not that of the centres: seen at an angle, the Gaussians that lie nearer to the camera along
/// the slope are composited first and draw it towards the camera, by a good part of a standard deviation.
#[derive(Clone, Debug)]
pub(super) struct DepthBias(Vec<f32>);

impl DepthBias {
    /// No bias.
    pub(super) fn none() -> DepthBias {
        DepthBias(vec![0.0])
    }

    /// Measured on `centres`, given by the cosine of the surface that is seen in front of each and by how far each lies
    /// behind it [m]; those further away than Gaussians of a median scale [m] reach are hidden or stray. Ranges without
    /// centres take the nearest that has some.
    pub(super) fn measure(centres: impl Iterator<Item = (f32, f32)>, scale: f64, tuning: &Tuning) -> DepthBias {
        let window = (tuning.gaussians.extent * scale) as f32;
        let bins = tuning.depth.obliqueness_bins;
        let mut samples: Vec<Vec<f32>> = vec![Vec::new(); bins];
        for (cosine, behind) in centres.filter(|(_, behind)| behind.abs() <= window) {
            samples[bin(cosine, bins)].push(behind);
        }
        let median = |mut s: Vec<f32>| {
            s.sort_by(f32::total_cmp);
            (!s.is_empty()).then(|| s[s.len() / 2])
        };
        let mut medians: Vec<Option<f32>> = samples.into_iter().map(median).collect();
        for i in 1..bins {
            medians[i] = medians[i].or(medians[i - 1]);
        }
        for i in (0..bins - 1).rev() {
            medians[i] = medians[i].or(medians[i + 1]);
        }
        DepthBias(medians.into_iter().map(|m| m.unwrap_or(0.0)).collect())
    }

    /// Least and largest of the biases [m].
    pub(super) fn range(&self) -> [f32; 2] {
        self.0.iter().fold([f32::INFINITY, f32::NEG_INFINITY], |[low, high], &b| [low.min(b), high.max(b)])
    }

    /// The bias at an obliqueness, linear between the middles of the ranges.
    pub(super) fn at(&self, cosine: f32) -> f32 {
        let bins = self.0.len();
        if bins < 2 {
            return self.0[0];
        }
        let t = (sine(cosine) * bins as f32 - 0.5).clamp(0.0, (bins - 1) as f32);
        let low = (t as usize).min(bins - 2);
        self.0[low] + (t - low as f32) * (self.0[low + 1] - self.0[low])
    }
}

/// The range of obliqueness that holds a cosine between ray and normal.
fn bin(cosine: f32, bins: usize) -> usize {
    ((sine(cosine) * bins as f32) as usize).min(bins - 1)
}

/// Sine between ray and normal, from their cosine.
fn sine(cosine: f32) -> f32 {
    (1.0 - cosine * cosine).max(0.0).sqrt()
}
