//! How likely the background gives a pixel's colour: lit, in shadow, or by a stray change.
//!
//! A shadow of depth t takes the share t d_c of the light of channel c, with one tint d for the picture (mean 1): what
//! is left is light from elsewhere, which has a colour of its own. So I = B (1 - t d) + noise, with t between 0 and the
//! deepest shadow, all equally likely.

use std::f32::consts::TAU;

use rayon::prelude::*;

use super::tuning::{
    FEWEST_SHADOW_PIXELS, MAX_SHADOW_DEPTH, MIN_NOISE, MIN_SHADOW_DEPTH, MIN_TINT_SPREAD, MOST_TINT, OBJECT_SHARE,
    REFLECTED_LIGHT, SHADOW_SHARE, STRAY_SHARE, TELLING_DEPTH, TINT_FITS, UNKNOWN_TINT_SPREAD, USUAL_TINT_SPREAD,
};

/// What makes up the difference between a picture and its background, where nothing stands in front.
pub(super) struct Background {
    /// Standard deviation of the difference, for each channel.
    pub(super) noise: [f32; 3],
    /// What a shadow takes of each channel, relative to the mean.
    pub(super) tint: [f32; 3],
    /// Spread of the tint.
    tint_spread: f32,
}

/// A pixel, were it background.
#[derive(Clone, Copy)]
pub(super) struct Shade {
    /// The depth of the shadow that explains it best: 0 lit, 1 black.
    pub(super) depth: f32,
    /// -ln p(colour | background).
    pub(super) cost: f32,
    /// Whether it is rather in shadow than lit or the object.
    is_shadow: bool,
}

impl Background {
    /// Estimates noise and tint from pixels of a picture and of its background.
    pub(super) fn fit(image: &[[f32; 3]], empty: &[[f32; 3]]) -> Background {
        let mut model = Background { noise: noise(image, empty), tint: [1.0; 3], tint_spread: UNKNOWN_TINT_SPREAD };
        for _ in 0..TINT_FITS {
            model = model.refit(image, empty);
        }
        model
    }

    /// All pixels, were they background.
    pub(super) fn shades(&self, image: &[[f32; 3]], empty: &[[f32; 3]]) -> Vec<Shade> {
        image.par_iter().zip(empty).map(|(image, empty)| self.shade(*image, *empty)).collect()
    }

    fn shade(&self, image: [f32; 3], empty: [f32; 3]) -> Shade {
        let mut lit_cost = 0.0;
        let (mut product, mut square) = (0.0, 0.0);
        for c in 0..3 {
            let variance = self.noise[c] * self.noise[c];
            let (loss, taken) = (empty[c] - image[c], empty[c] * self.tint[c]);
            lit_cost += 0.5 * loss * loss / variance + 0.5 * (TAU * variance).ln();
            product += loss * taken / variance;
            square += taken * taken / variance;
        }
        let depth = (product / square.max(1e-9)).clamp(MIN_SHADOW_DEPTH, MAX_SHADOW_DEPTH);
        let (mut shadow_cost, mut information) = (0.0, 1e-9);
        for c in 0..3 {
            let taken = empty[c] * self.tint[c];
            let spread = self.tint_spread * depth * empty[c];
            let variance = self.noise[c] * self.noise[c] + spread * spread + REFLECTED_LIGHT * REFLECTED_LIGHT;
            let residual = image[c] - empty[c] + depth * taken;
            shadow_cost += 0.5 * residual * residual / variance + 0.5 * (TAU * variance).ln();
            information += taken * taken / variance;
        }
        // The integral over all depths: a Gaussian about the best one, as far as it lies within their range.
        let range = MAX_SHADOW_DEPTH;
        let share_of_range = ((TAU / information).sqrt() / range).min(1.0);
        let lit = (1.0 - SHADOW_SHARE).ln() - lit_cost;
        let shadow = SHADOW_SHARE.ln() - shadow_cost + share_of_range.ln();
        let likelihood = add_exponents(add_exponents(lit, shadow), STRAY_SHARE.ln());
        let is_shadow = shadow > add_exponents(lit, OBJECT_SHARE.ln());
        Shade { depth, cost: -likelihood, is_shadow }
    }

    /// With the tint of the pixels that are likely in shadow, and its spread.
    fn refit(&self, image: &[[f32; 3]], empty: &[[f32; 3]]) -> Background {
        let shades = self.shades(image, empty);
        let telling = |shade: &Shade| shade.is_shadow && shade.depth > TELLING_DEPTH;
        let shadows: Vec<(f32, [f32; 3], [f32; 3])> = shades
            .iter()
            .zip(image.iter().zip(empty))
            .filter(|(shade, _)| telling(shade))
            .map(|(shade, (image, empty))| (shade.depth, *image, *empty))
            .collect();
        if shadows.len() < FEWEST_SHADOW_PIXELS {
            return Background { noise: self.noise, tint: [1.0; 3], tint_spread: USUAL_TINT_SPREAD };
        }
        // By medians, because some of these pixels are the object after all.
        let reach = |depth: f32, empty: f32, c: usize| (depth * empty).max(self.noise[c]);
        let tint = [0, 1, 2].map(|c| {
            let taken = shadows.iter().map(|(depth, image, empty)| (empty[c] - image[c]) / reach(*depth, empty[c], c));
            quantile(taken.collect(), 0.5).clamp(1.0 - MOST_TINT, 1.0 + MOST_TINT)
        });
        let mean = tint.iter().sum::<f32>() / 3.0;
        let tint = tint.map(|d| d / mean);
        // The spread with which each residual is one median absolute deviation of noise and spread together: half of
        // the residuals are within that of their median.
        let mut spreads: Vec<f32> = Vec::new();
        for (depth, image, empty) in &shadows {
            for c in 0..3 {
                let residual = BY_MEDIAN * (image[c] - empty[c] * (1.0 - depth * tint[c]));
                let beyond_noise = (residual * residual - self.noise[c] * self.noise[c]).max(0.0).sqrt();
                spreads.push(beyond_noise / (depth * empty[c]).max(MIN_NOISE));
            }
        }
        let tint_spread = quantile(spreads, 0.5).clamp(MIN_TINT_SPREAD, UNKNOWN_TINT_SPREAD);
        Background { noise: self.noise, tint, tint_spread }
    }
}

/// ln(e^a + e^b).
fn add_exponents(a: f32, b: f32) -> f32 {
    let (low, high) = (a.min(b), a.max(b));
    high + (low - high).exp().ln_1p()
}

/// Standard deviations of a normal distribution in its median absolute deviation, inverted.
const BY_MEDIAN: f32 = 1.4826;

/// Standard deviations of what differs between a picture and its background, for each channel.
pub(super) fn noise(image: &[[f32; 3]], empty: &[[f32; 3]]) -> [f32; 3] {
    [0, 1, 2].map(|c| noise_of_channel(image, empty, c))
}

/// Standard deviation by the difference that a quarter of the pixels exceed: fewer are object. The median would do for
/// even noise, but codecs leave none in most of a film and a lot in the rest.
fn noise_of_channel(image: &[[f32; 3]], empty: &[[f32; 3]], c: usize) -> f32 {
    /// Standard deviations of a normal distribution in the third quartile of its absolute deviation, inverted.
    const BY_QUARTILE: f32 = 0.8693;
    let differences = image.iter().zip(empty).map(|(i, b)| (i[c] - b[c]).abs()).collect();
    (BY_QUARTILE * quantile(differences, 0.75)).max(MIN_NOISE)
}

/// The value that this share of the values do not exceed; 0 where there are no values.
fn quantile(mut values: Vec<f32>, share: f64) -> f32 {
    let place = (share * values.len() as f64) as usize;
    if values.is_empty() { 0.0 } else { *values.select_nth_unstable_by(place, f32::total_cmp).1 }
}
