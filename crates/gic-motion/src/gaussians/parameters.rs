//! The canonical Gaussians in the coordinates that Adam works in, with their moments and density control.

use std::mem;

use gic_optimize::Moments;
use gic_splat::{GaussianGradients, Gaussians, Shape, logit, sigmoid};
use glam::{Quat, Vec3};
use rand::{Rng, RngExt};
use rayon::prelude::*;

use crate::tuning::{SH_REST_SLOWDOWN, SPLIT_SHRINKAGE};
use crate::{DensitySettings, LearningRates};

/// Gaussians per parallel task, at least.
const GAUSSIANS_PER_TASK: usize = 1024;
/// Coefficients per parallel task.
const COEFFICIENTS_PER_TASK: usize = 1 << 14;

/// Gaussians with opacity as a logit and scales as logarithms.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Parameters {
    /// Centres [m].
    pub(crate) positions: Vec<[f32; 3]>,
    /// Logarithms of the standard deviations [ln m], shape [n, 1], or [n, 3] where there are rotations.
    pub(crate) log_scales: Vec<f32>,
    /// Quaternions (w, x, y, z) of any length from local to world axes, shape [n, 4]; empty for isotropic Gaussians.
    pub(crate) rotations: Vec<[f32; 4]>,
    pub(crate) opacity_logits: Vec<f32>,
    /// Degree-0 coefficients.
    pub(crate) sh_dc: Vec<[f32; 3]>,
    /// Coefficients of degree 1 and above, [n, (degree + 1)^2 - 1, 3].
    pub(crate) sh_rest: Vec<[f32; 3]>,
    /// The degree that `sh_rest` has room for.
    pub(crate) sh_degree: usize,
}

/// Gradient with respect to [`Parameters`], same shapes; `sh_dc` and `sh_rest` lie together as in [`Gaussians::sh`].
#[derive(Clone, Debug, Default)]
pub(crate) struct ParameterGradient {
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) log_scales: Vec<f32>,
    pub(crate) rotations: Vec<[f32; 4]>,
    pub(crate) opacity_logits: Vec<f32>,
    /// Shape [n, (degree + 1)^2, 3]; empty before the first view.
    pub(crate) sh: Vec<[f32; 3]>,
}

/// Coefficients beyond the first, per Gaussian.
pub(crate) fn rest_per_gaussian(sh_degree: usize) -> usize {
    (sh_degree + 1) * (sh_degree + 1) - 1
}

/// One attribute of all Gaussians, in parallel.
fn each<T: Sync>(attribute: &[T]) -> impl IndexedParallelIterator<Item = (usize, &T)> {
    attribute.par_iter().with_min_len(GAUSSIANS_PER_TASK).enumerate()
}

impl Parameters {
    pub(crate) fn len(&self) -> usize {
        self.positions.len()
    }

    /// Scales per Gaussian: 1, or 3 with a rotation.
    pub(crate) fn axes(&self) -> usize {
        if self.rotations.is_empty() { 1 } else { 3 }
    }

    /// The largest standard deviation of Gaussian `i` [m].
    fn widest(&self, i: usize) -> f64 {
        let axes = self.axes();
        let log_scales = &self.log_scales[i * axes..(i + 1) * axes];
        f64::from(log_scales.iter().copied().fold(f32::NEG_INFINITY, f32::max)).exp()
    }

    /// The Gaussians to draw, displaced by `residuals` (metres, and added to the logarithm of the scale) if given.
    pub(crate) fn gaussians(&self, residuals: Option<&[[f32; 4]]>) -> Gaussians {
        let residual = |i: usize| residuals.map_or([0.0; 4], |r| r[i]);
        let sh_rest = rest_per_gaussian(self.sh_degree);
        let mut sh = vec![[0.0; 3]; self.len() * (sh_rest + 1)];
        sh.par_chunks_mut(sh_rest + 1).with_min_len(GAUSSIANS_PER_TASK).enumerate().for_each(|(i, sh)| {
            sh[0] = self.sh_dc[i];
            sh[1..].copy_from_slice(&self.sh_rest[i * sh_rest..(i + 1) * sh_rest]);
        });
        Gaussians {
            positions: each(&self.positions)
                .map(|(i, x)| core::array::from_fn(|axis| x[axis] + residual(i)[axis]))
                .collect(),
            opacities: each(&self.opacity_logits).map(|(_, &x)| sigmoid(x)).collect(),
            shape: self.shape(residual),
            sh_degree: self.sh_degree,
            sh,
        }
    }

    fn shape(&self, residual: impl Fn(usize) -> [f32; 4] + Sync) -> Shape {
        let scale = |i: usize, log_scale: f32| (log_scale + residual(i)[3]).exp();
        if self.rotations.is_empty() {
            return Shape::Isotropic { scales: each(&self.log_scales).map(|(i, &s)| scale(i, s)).collect() };
        }
        let scales = self.log_scales.par_chunks_exact(3).with_min_len(GAUSSIANS_PER_TASK).enumerate();
        Shape::Anisotropic {
            scales: scales.map(|(i, s)| core::array::from_fn(|axis| scale(i, s[axis]))).collect(),
            rotations: self.rotations.clone(),
        }
    }

    /// Adds the gradient of drawn Gaussians to `gradient` and to the residuals' gradient, by the chain rule. The residuals' stands
    /// for the drawn positions as well; how those follow from the canonical ones is the motion's business. Takes the harmonics'
    /// gradient out of `slope`: it is most of all numbers.
    pub(crate) fn pull_back(
        &self,
        drawn: &Gaussians,
        slope: &mut GaussianGradients,
        gradient: &mut ParameterGradient,
        d_residuals: &mut [[f32; 4]],
    ) {
        let (scales, d_scales) = (drawn.shape.flat_scales(), slope.shape.flat_scales());
        if let Shape::Anisotropic { rotations, .. } = &slope.shape {
            let sums = gradient.rotations.as_flattened_mut().iter_mut();
            sums.zip(rotations.as_flattened()).for_each(|(sum, d)| *sum += d);
        }
        let axes = self.axes();
        let sums = (gradient.log_scales.par_chunks_mut(axes), d_residuals.par_iter_mut(), &mut gradient.opacity_logits);
        sums.into_par_iter().with_min_len(GAUSSIANS_PER_TASK).enumerate().for_each(
            |(i, (log_scales, residual, logit))| {
                for (axis, sum) in log_scales.iter_mut().enumerate() {
                    let d_log_scale = d_scales[i * axes + axis] * scales[i * axes + axis];
                    *sum += d_log_scale;
                    residual[3] += d_log_scale;
                }
                for axis in 0..3 {
                    residual[axis] += slope.positions[i][axis];
                }
                let opacity = drawn.opacities[i];
                *logit += slope.opacities[i] * opacity * (1.0 - opacity);
            },
        );
        if gradient.sh.is_empty() {
            gradient.sh = mem::take(&mut slope.sh);
        } else {
            let pairs =
                gradient.sh.par_chunks_mut(COEFFICIENTS_PER_TASK).zip(slope.sh.par_chunks(COEFFICIENTS_PER_TASK));
            pairs.for_each(|(sums, d)| {
                sums.as_flattened_mut().iter_mut().zip(d.as_flattened()).for_each(|(sum, d)| *sum += d);
            });
        }
    }

    fn select(&mut self, rows: &[usize]) {
        let (sh_rest, axes) = (rest_per_gaussian(self.sh_degree), self.axes());
        self.positions = rows.iter().map(|&i| self.positions[i]).collect();
        self.log_scales = rows.iter().flat_map(|&i| &self.log_scales[i * axes..(i + 1) * axes]).copied().collect();
        if !self.rotations.is_empty() {
            self.rotations = rows.iter().map(|&i| self.rotations[i]).collect();
        }
        self.opacity_logits = rows.iter().map(|&i| self.opacity_logits[i]).collect();
        self.sh_dc = rows.iter().map(|&i| self.sh_dc[i]).collect();
        self.sh_rest = rows.iter().flat_map(|&i| &self.sh_rest[i * sh_rest..(i + 1) * sh_rest]).copied().collect();
    }
}

impl ParameterGradient {
    pub(crate) fn zeros(p: &Parameters) -> ParameterGradient {
        ParameterGradient {
            positions: vec![[0.0; 3]; p.len()],
            log_scales: vec![0.0; p.log_scales.len()],
            rotations: vec![[0.0; 4]; p.rotations.len()],
            opacity_logits: vec![0.0; p.len()],
            sh: Vec::new(),
        }
    }
}

/// Adam's moments of every attribute.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct ParameterMoments {
    pub(crate) positions: Moments,
    pub(crate) log_scales: Moments,
    pub(crate) rotations: Moments,
    pub(crate) opacity_logits: Moments,
    pub(crate) sh_dc: Moments,
    pub(crate) sh_rest: Moments,
}

impl ParameterMoments {
    pub(crate) fn zeros(p: &Parameters) -> ParameterMoments {
        ParameterMoments {
            positions: Moments::zeros(3 * p.len()),
            log_scales: Moments::zeros(p.log_scales.len()),
            rotations: Moments::zeros(4 * p.rotations.len()),
            opacity_logits: Moments::zeros(p.len()),
            sh_dc: Moments::zeros(3 * p.len()),
            sh_rest: Moments::zeros(3 * p.sh_rest.len()),
        }
    }

    /// One step of Adam on every attribute; `fraction` of the training is over, `extent` is the object's size [m]. With `alike`,
    /// all positions are scaled by the same number.
    pub(crate) fn update(
        &mut self,
        p: &mut Parameters,
        g: &ParameterGradient,
        rates: &LearningRates,
        (step, fraction): (usize, f64),
        (extent, alike): (f64, bool),
    ) {
        use gic_optimize::decayed;
        let rate = |ends| decayed(ends, fraction);
        let feature = rate(rates.feature);
        let (positions, d_positions) = (p.positions.as_flattened_mut(), g.positions.as_flattened());
        let rate_of_positions = rate(rates.position) * extent;
        match alike {
            true => self.positions.update_alike(positions, d_positions, rate_of_positions, step),
            false => self.positions.update(positions, d_positions, rate_of_positions, step),
        }
        self.log_scales.update(&mut p.log_scales, &g.log_scales, rate(rates.scale), step);
        let (rotations, d_rotations) = (p.rotations.as_flattened_mut(), g.rotations.as_flattened());
        self.rotations.update(rotations, d_rotations, rate(rates.rotation), step);
        self.opacity_logits.update(&mut p.opacity_logits, &g.opacity_logits, rate(rates.opacity), step);
        let (sh, width) = (g.sh.as_flattened(), 3 * (rest_per_gaussian(p.sh_degree) + 1));
        self.sh_dc.update_columns(p.sh_dc.as_flattened_mut(), (sh, width), 0..3, feature, step);
        self.sh_rest.update_columns(
            p.sh_rest.as_flattened_mut(),
            (sh, width),
            3..width,
            feature / SH_REST_SLOWDOWN,
            step,
        );
    }

    /// The history of `rows` of parameters that have `axes` scales and the degree `sh_degree`.
    fn select(&mut self, rows: &[Option<usize>], (axes, sh_degree): (usize, usize)) {
        self.positions.select(rows, 3);
        self.log_scales.select(rows, axes);
        if axes == 3 {
            self.rotations.select(rows, 4);
        }
        self.opacity_logits.select(rows, 1);
        self.sh_dc.select(rows, 3);
        self.sh_rest.select(rows, 3 * rest_per_gaussian(sh_degree));
    }
}

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

/// Adds Gaussians where the projected centres are pulled hardest and removes transparent ones (3DGS, section 5.2).
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

    use super::*;

    /// Adds a step to one number of the parameters or residuals.
    type Nudge = dyn Fn(&mut Parameters, &mut [[f32; 4]], usize, f32);

    fn random_parameters(n: usize, (axes, sh_degree): (usize, usize), rng: &mut ChaCha8Rng) -> Parameters {
        let mut number = |low: f32, high: f32| rng.random_range(low..high);
        Parameters {
            positions: (0..n).map(|_| core::array::from_fn(|_| number(-1.0, 1.0))).collect(),
            log_scales: (0..n * axes).map(|_| number(-3.0, -1.0)).collect(),
            rotations: (0..if axes == 3 { n } else { 0 })
                .map(|_| core::array::from_fn(|_| number(-1.0, 1.0)))
                .collect(),
            opacity_logits: (0..n).map(|_| number(-2.0, 2.0)).collect(),
            sh_dc: (0..n).map(|_| core::array::from_fn(|_| number(-1.0, 1.0))).collect(),
            sh_rest: (0..n * rest_per_gaussian(sh_degree))
                .map(|_| core::array::from_fn(|_| number(-1.0, 1.0)))
                .collect(),
            sh_degree,
        }
    }

    #[test]
    fn pulling_back_agrees_with_finite_differences() {
        pulling_back(1);
        pulling_back(3);
    }

    fn pulling_back(axes: usize) {
        let mut rng = ChaCha8Rng::seed_from_u64(9);
        let n = 4;
        let mut p = random_parameters(n, (axes, 1), &mut rng);
        let mut residuals: Vec<[f32; 4]> =
            (0..n).map(|_| core::array::from_fn(|_| rng.random_range(-0.5..0.5))).collect();
        let drawn = p.gaussians(Some(&residuals));
        let mut slope = GaussianGradients::zeros(&drawn);
        let mut fill = |values: &mut [f32]| values.iter_mut().for_each(|v| *v = rng.random_range(-1.0..1.0));
        fill(slope.positions.as_flattened_mut());
        fill(&mut slope.opacities);
        fill(slope.sh.as_flattened_mut());
        match &mut slope.shape {
            Shape::Isotropic { scales } => fill(scales),
            Shape::Anisotropic { scales, rotations } => {
                fill(scales.as_flattened_mut());
                fill(rotations.as_flattened_mut());
            }
        }
        let turns = |shape: &Shape| match shape {
            Shape::Isotropic { .. } => Vec::new(),
            Shape::Anisotropic { rotations, .. } => rotations.as_flattened().to_vec(),
        };

        let dot = |a: &[f32], b: &[f32]| a.iter().zip(b).map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
        let loss = |p: &Parameters, residuals: &[[f32; 4]]| {
            let g = p.gaussians(Some(residuals));
            dot(g.positions.as_flattened(), slope.positions.as_flattened())
                + dot(&g.opacities, &slope.opacities)
                + dot(g.shape.flat_scales(), slope.shape.flat_scales())
                + dot(&turns(&g.shape), &turns(&slope.shape))
                + dot(g.sh.as_flattened(), slope.sh.as_flattened())
        };
        let (mut gradient, mut d_residuals) = (ParameterGradient::zeros(&p), vec![[0.0; 4]; n]);
        p.pull_back(&drawn, &mut slope.clone(), &mut gradient, &mut d_residuals);
        let mut twice = gradient.clone();
        p.pull_back(&drawn, &mut slope.clone(), &mut twice, &mut d_residuals.clone());
        assert!(twice.sh.iter().flatten().zip(gradient.sh.iter().flatten()).all(|(twice, once)| *twice == 2.0 * once));
        let width = rest_per_gaussian(p.sh_degree) + 1;
        let h = 1e-2f32;
        let mut check = |got: &[f32], name: &str, field: &Nudge| {
            for (i, got) in got.iter().enumerate() {
                field(&mut p, &mut residuals, i, h);
                let above = loss(&p, &residuals);
                field(&mut p, &mut residuals, i, -2.0 * h);
                let below = loss(&p, &residuals);
                field(&mut p, &mut residuals, i, h);
                let expected = (above - below) / (2.0 * f64::from(h));
                assert!((f64::from(*got) - expected).abs() < 2e-4, "{name} {i}: {got} against {expected}");
            }
        };
        check(&gradient.log_scales, "scale", &|p, _, i, h| p.log_scales[i] += h);
        check(gradient.rotations.as_flattened(), "rotation", &|p, _, i, h| p.rotations.as_flattened_mut()[i] += h);
        check(&gradient.opacity_logits, "opacity", &|p, _, i, h| p.opacity_logits[i] += h);
        let sh_dc: Vec<[f32; 3]> = gradient.sh.iter().copied().step_by(width).collect();
        let sh_rest: Vec<[f32; 3]> = gradient.sh.chunks_exact(width).flat_map(|sh| &sh[1..]).copied().collect();
        check(sh_dc.as_flattened(), "feature", &|p, _, i, h| p.sh_dc.as_flattened_mut()[i] += h);
        check(sh_rest.as_flattened(), "detail", &|p, _, i, h| p.sh_rest.as_flattened_mut()[i] += h);
        check(d_residuals.as_flattened(), "residual", &|_, r, i, h| r.as_flattened_mut()[i] += h);
    }

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
