//! Adaptive density control (Kerbl et al. 2023, section 5.2): where more Gaussians are made, and which go.

use gic_optimize::Moments;
use gic_splat::{logit, sigmoid};
use glam::{Quat, Vec3};
use rand::{Rng, RngExt};

use super::parameters::{ParameterMoments, Parameters};
use crate::DensitySettings;
use crate::tuning::SPLIT_SHRINKAGE;

/// Sums of the gradients of projected centres since the last density step.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct ScreenGradients {
    pub(crate) sum: Vec<f32>,
    pub(crate) views: Vec<f32>,
}

impl ScreenGradients {
    pub(crate) fn zeros(n: usize) -> ScreenGradients {
        ScreenGradients { sum: vec![0.0; n], views: vec![0.0; n] }
    }

    /// Adds one view, scaled to the units of the threshold.
    pub(crate) fn add(&mut self, screen: &[f32], unit: f64) {
        for ((sum, views), g) in self.sum.iter_mut().zip(&mut self.views).zip(screen) {
            if *g > 0.0 {
                *sum += unit as f32 * g;
                *views += 1.0;
            }
        }
    }

    fn mean(&self, i: usize) -> f32 {
        self.sum[i] / self.views[i].max(1.0)
    }
}

/// How much a density step changed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) struct DensityChange {
    pub(crate) cloned: usize,
    pub(crate) split: usize,
    pub(crate) pruned: usize,
}

/// Adds Gaussians where the projected centres are pulled hardest and removes transparent ones.
///
/// Small Gaussians are cloned, large ones split into two smaller ones drawn from their own distribution. At most
/// `room` Gaussians are added, the hardest pulled first.
pub(crate) fn control_density(
    p: &mut Parameters,
    moments: &mut ParameterMoments,
    screen: &ScreenGradients,
    settings: &DensitySettings,
    (extent, max_gaussians): (f64, usize),
    rng: &mut impl Rng,
) -> DensityChange {
    let n = p.len();
    let opaque = |i: usize| f64::from(sigmoid(p.opacity_logits[i])) >= settings.min_opacity;
    let finite = |i: usize| p.positions[i].iter().all(|x| x.is_finite()) && p.widest(i).is_finite();
    let mut kept: Vec<usize> = (0..n).filter(|&i| opaque(i) && finite(i)).collect();
    let pruned = n - kept.len();
    let mut pulled: Vec<usize> =
        kept.iter().copied().filter(|&i| f64::from(screen.mean(i)) > settings.gradient_threshold).collect();
    pulled.sort_by(|&a, &b| screen.mean(b).total_cmp(&screen.mean(a)).then(a.cmp(&b)));
    pulled.truncate(max_gaussians.saturating_sub(kept.len()));
    pulled.sort_unstable();
    let large = |i: usize| p.widest(i) > settings.split_above * extent;
    let (split, cloned): (Vec<usize>, Vec<usize>) = pulled.into_iter().partition(|&i| large(i));
    kept.retain(|i| split.binary_search(i).is_err());
    let mut rows: Vec<usize> = kept.clone();
    rows.extend(&cloned);
    let first_half = rows.len();
    rows.extend(split.iter().flat_map(|&i| [i, i]));
    let history: Vec<Option<usize>> = (0..rows.len()).map(|row| kept.get(row).copied()).collect();
    p.select(&rows);
    let axes = p.axes();
    moments.select(&history, (axes, p.sh_degree));
    for i in first_half..p.len() {
        let log_scales = &mut p.log_scales[i * axes..(i + 1) * axes];
        let offset = core::array::from_fn(|axis| log_scales[axis % axes].exp() * normal(rng));
        let offset = p.rotations.get(i).map_or(offset, |q| turned(*q, offset));
        for (x, d) in p.positions[i].iter_mut().zip(offset) {
            *x += d;
        }
        log_scales.iter_mut().for_each(|s| *s -= SPLIT_SHRINKAGE.ln());
    }
    DensityChange { cloned: cloned.len(), split: split.len(), pruned }
}

/// Lowers every opacity to at most `opacity` and forgets its history, so that what is not needed can fade (3DGS).
pub(crate) fn reset_opacity(p: &mut Parameters, moments: &mut ParameterMoments, opacity: f64) {
    let ceiling = logit(opacity) as f32;
    p.opacity_logits.iter_mut().for_each(|x| *x = x.min(ceiling));
    moments.opacity_logits = Moments::zeros(p.len());
}

/// A vector turned by a quaternion (w, x, y, z) of any length.
fn turned([w, x, y, z]: [f32; 4], v: [f32; 3]) -> [f32; 3] {
    (Quat::from_xyzw(x, y, z, w).normalize() * Vec3::from_array(v)).to_array()
}

/// A standard normal number (Box and Muller).
fn normal(rng: &mut impl Rng) -> f32 {
    let u: f32 = rng.random_range(f32::MIN_POSITIVE..1.0);
    let v: f32 = rng.random();
    (-2.0 * u.ln()).sqrt() * (core::f32::consts::TAU * v).cos()
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::super::parameters::tests::random_parameters;
    use super::*;

    #[test]
    fn density_control_clones_splits_and_prunes() {
        let mut rng = ChaCha8Rng::seed_from_u64(2);
        let mut p = random_parameters(4, (1, 0), &mut rng);
        p.opacity_logits = vec![2.0, 2.0, 2.0, -9.0];
        p.log_scales = vec![0.01f32.ln(), 0.2f32.ln(), 0.01f32.ln(), 0.01f32.ln()];
        let before = p.clone();
        let mut moments = ParameterMoments::zeros(&p);
        moments.log_scales.first = vec![1.0, 2.0, 3.0, 4.0];
        let mut screen = ScreenGradients::zeros(4);
        screen.add(&[1.0, 1.0, 0.1, 1.0], 1.0);
        let settings = DensitySettings { gradient_threshold: 0.5, split_above: 0.1, ..DensitySettings::default() };
        let change = control_density(&mut p, &mut moments, &screen, &settings, (1.0, 100), &mut rng);
        assert_eq!(change, DensityChange { cloned: 1, split: 1, pruned: 1 });
        // Kept 0 and 2, the clone of 0, and the halves of 1, which are new Gaussians without history.
        assert_eq!(p.positions[..3], [before.positions[0], before.positions[2], before.positions[0]]);
        assert_eq!(moments.log_scales.first, [1.0, 3.0, 0.0, 0.0, 0.0]);
        for half in 3..5 {
            assert!((p.log_scales[half] - (0.2f32 / SPLIT_SHRINKAGE).ln()).abs() < 1e-6);
            assert_ne!(p.positions[half], before.positions[1]);
        }
    }

    #[test]
    fn ellipsoids_are_split_along_themselves() {
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let mut p = random_parameters(1, (3, 0), &mut rng);
        p.opacity_logits = vec![2.0];
        // Long along its own x axis, which a quarter turn about z makes the world's y axis.
        p.log_scales = vec![0.2f32.ln(), 1e-4f32.ln(), 1e-4f32.ln()];
        p.rotations = vec![[0.5, 0.0, 0.0, 0.5]];
        let before = p.clone();
        let mut moments = ParameterMoments::zeros(&p);
        let mut screen = ScreenGradients::zeros(1);
        screen.add(&[1.0], 1.0);
        let settings = DensitySettings { gradient_threshold: 0.5, split_above: 0.1, ..DensitySettings::default() };
        let change = control_density(&mut p, &mut moments, &screen, &settings, (1.0, 100), &mut rng);
        assert_eq!((change.split, p.len()), (1, 2));
        for half in 0..2 {
            assert_eq!(p.rotations[half], before.rotations[0]);
            let offset: [f32; 3] = core::array::from_fn(|k| p.positions[half][k] - before.positions[0][k]);
            assert!(offset[1].abs() > 1e-3 && offset[0].abs() < 1e-3 && offset[2].abs() < 1e-3, "{offset:?}");
            for axis in 0..3 {
                let expected = before.log_scales[axis] - SPLIT_SHRINKAGE.ln();
                assert!((p.log_scales[3 * half + axis] - expected).abs() < 1e-6);
            }
        }
        assert_eq!(moments.rotations.first.len(), 8);
    }

    #[test]
    fn density_control_keeps_to_its_limit_and_prefers_the_hardest_pulled() {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let mut p = random_parameters(5, (1, 1), &mut rng);
        p.opacity_logits = vec![2.0; 5];
        let before = p.clone();
        let mut moments = ParameterMoments::zeros(&p);
        let mut screen = ScreenGradients::zeros(5);
        screen.add(&[1.0, 3.0, 2.0, 5.0, 4.0], 1.0);
        let settings = DensitySettings { gradient_threshold: 0.5, split_above: 10.0, ..DensitySettings::default() };
        let change = control_density(&mut p, &mut moments, &screen, &settings, (1.0, 7), &mut rng);
        assert_eq!((change.cloned, p.len()), (2, 7));
        assert_eq!(p.positions[5..], [before.positions[3], before.positions[4]]);
        assert_eq!(p.sh_rest.len(), 7 * 3);
    }
}
