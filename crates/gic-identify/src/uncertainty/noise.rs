//! Weights from the data's own noise, so that nothing is tuned per scene.
//!
//! What limits an estimate is not the noise of pixels but a shape and a simulation that are slightly wrong: errors that
//! are common to an outline and last over frames, and that grow once something is touched. Two figures measure that
//! from the gradients of whole blocks (pictures, surfaces) at a fit. The effective noise of a frame is the scatter of
//! its blocks' gradients over their curvature: a coherent error along an outline counts as one error. The inflation is
//! the same ratio for whole frames, with lags, before and after contact: it is one where frames err independently. The
//! weight is the inverse of both, so that the sum of squares is about one for each independent piece of information,
//! and priors act with the strength that they claim.
//!
//! With a block's gradient `g = J^T r` and curvature `h = diag J^T J`, the noise of frame f is the mean over unknowns
//! of `sum g^2 / sum h` over the blocks of f and of its neighbours. The inflation is the mean of `diag M / sum w h`,
//! where M is the scatter of whole frames' weighted gradients.

use crate::solve::residual_block::{Modality, ResidualBlock, Weights};
use crate::tuning::NoiseTuning;
use crate::uncertainty::interval::{groups, scatter};

/// Weights for blocks that were linearised at a fit; `free` leading observations are free flight. No weight exceeds its
/// ceiling.
pub(crate) fn effective_weights(
    blocks: &[ResidualBlock],
    unknowns: usize,
    free: usize,
    ceilings: &Weights,
    tuning: &NoiseTuning,
) -> Weights {
    let mut weights = ceilings.clone();
    for modality in [Modality::Mask, Modality::Surface] {
        let own: Vec<ResidualBlock> = blocks.iter().filter(|c| c.modality == modality).cloned().collect();
        let (flying, touching): (Vec<ResidualBlock>, Vec<ResidualBlock>) =
            own.into_iter().partition(|c| c.observation < free);
        for phase in [flying, touching] {
            weigh_phase(&phase, modality, unknowns, (ceilings, tuning), &mut weights);
        }
    }
    weights.inflate_surface_errors(free, tuning.surface_error_inflation);
    weights
}

impl Weights {
    /// From the observation `free` on, surfaces count as little as their errors want, which are larger than they show.
    pub(crate) fn inflate_surface_errors(&mut self, free: usize, factor: f64) {
        self.error_inflation[free..].fill(factor);
        self.surface[free..].iter_mut().for_each(|weight| *weight /= factor * factor);
    }
}

fn weigh_phase(
    phase: &[ResidualBlock],
    modality: Modality,
    unknowns: usize,
    (ceilings, tuning): (&Weights, &NoiseTuning),
    weights: &mut Weights,
) {
    let (Some(first), Some(last)) =
        (phase.iter().map(|c| c.observation).min(), phase.iter().map(|c| c.observation).max())
    else {
        return;
    };
    let slots = |weights: &mut Weights, o: usize, value: f64| match modality {
        Modality::Mask => weights.mask[o] = value,
        Modality::Surface => weights.surface[o] = value,
    };
    let ceiling = |o: usize| match modality {
        Modality::Mask => ceilings.mask[o],
        Modality::Surface => ceilings.surface[o],
    };
    // The first surface is what distances are measured relative to: it says nothing of their noise.
    let telling = |c: &&ResidualBlock| modality == Modality::Mask || c.observation > 0 || last == 0;
    let lags = (last + 1 - first) / tuning.frames_per_lag;
    for o in first..=last {
        // A frame alone is a small sample: its neighbours, whose errors resemble its own, count, too.
        let near: Vec<&ResidualBlock> =
            phase.iter().filter(|c| c.observation.abs_diff(o) <= lags).filter(telling).collect();
        let noise = noise(&near, unknowns);
        slots(weights, o, 1.0 / noise.max(1.0 / ceiling(o)));
    }
    let inflation = inflation(phase, unknowns, weights, tuning.frames_per_lag);
    for o in first..=last {
        let weight = match modality {
            Modality::Mask => weights.mask[o],
            Modality::Surface => weights.surface[o],
        };
        slots(weights, o, weight / inflation);
    }
}

/// Scatter of the blocks' gradients over their curvature, mean over the unknowns that they feel.
fn noise(blocks: &[&ResidualBlock], unknowns: usize) -> f64 {
    mean_ratio(unknowns, |k| {
        blocks.iter().fold((0.0, 0.0), |(s, h), c| (s + c.gradient[k].powi(2), h + c.hessian[(k, k)]))
    })
}

/// How many times more whole frames' gradients scatter than their curvature says.
fn inflation(phase: &[ResidualBlock], unknowns: usize, weights: &Weights, frames_per_lag: usize) -> f64 {
    let frames = groups(phase, &|c| weights.of(c), unknowns, &|c| c.observation);
    let middle = scatter(&frames, frames.len() / frames_per_lag);
    let ratio = mean_ratio(unknowns, |k| {
        let curvature: f64 = phase.iter().map(|c| c.hessian[(k, k)] * weights.of(c)).sum();
        (middle[(k, k)], curvature)
    });
    ratio.max(1.0)
}

/// Mean of scatter over curvature for the unknowns that have any curvature.
fn mean_ratio(unknowns: usize, of: impl Fn(usize) -> (f64, f64)) -> f64 {
    let ratios: Vec<f64> =
        (0..unknowns).map(of).filter(|(_, curvature)| *curvature > 0.0).map(|(s, h)| s / h).collect();
    ratios.iter().sum::<f64>() / ratios.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};

    const CAMERAS: usize = 11;
    const FRAMES: usize = 14;
    const FREE: usize = 5;

    /// Clusters of 40 residuals of one unknown with noise of deviation `own`, and an error of deviation `common` that
    /// is the same for all cameras of a frame after contact.
    fn blocks(own: f64, common: f64) -> Vec<ResidualBlock> {
        let mut random = rand_chacha::ChaCha8Rng::seed_from_u64(9);
        let mut gauss = move || (0..12).map(|_| random.random::<f64>()).sum::<f64>() - 6.0;
        let mut list = Vec::new();
        for frame in 0..FRAMES {
            let shared = if frame < FREE { 0.0 } else { common * gauss() };
            for camera in 0..CAMERAS {
                let mut block = ResidualBlock::new(Modality::Mask, frame, Some(camera), 2);
                (0..40).for_each(|_| block.add(own * gauss() + shared, &[1.0, 0.0], 1.0));
                list.push(block.finish());
            }
        }
        list
    }

    #[test]
    fn independent_noise_is_found() {
        let ceilings = Weights::uniform(1e6, 1e6, FRAMES);
        let weights = effective_weights(&blocks(0.1, 0.0), 2, FREE, &ceilings, &NoiseTuning::default());
        // Variance 0.01, from a small sample: 33 blocks a frame with its neighbours.
        let mean = weights.mask.iter().sum::<f64>() / FRAMES as f64;
        assert!(mean < 150.0 && mean > 50.0, "{:?}", weights.mask);
        // After contact surfaces count as little as their true errors want.
        assert_eq!(weights.surface[..FREE], ceilings.surface[..FREE]);
        assert_eq!(
            weights.surface[FREE],
            ceilings.surface[FREE] / NoiseTuning::default().surface_error_inflation.powi(2)
        );
    }

    #[test]
    fn errors_that_a_frame_shares_count_as_one() {
        let ceilings = Weights::uniform(1e6, 1e6, FRAMES);
        let weights = effective_weights(&blocks(0.1, 0.1), 2, FREE, &ceilings, &NoiseTuning::default());
        let mean = |w: &[f64]| w.iter().sum::<f64>() / w.len() as f64;
        let (flying, touching) = (mean(&weights.mask[..FREE]), mean(&weights.mask[FREE..]));
        // A frame's mean is known to 0.1, not to 0.1 / sqrt(440).
        let information = touching * (40 * CAMERAS) as f64;
        assert!(information < 400.0 && information > 25.0, "{information}");
        assert!(flying > 20.0 * touching, "{flying} {touching}");
    }
}
