//! The canonical Gaussians in the coordinates that Adam works in, and the chain rule to them.
//!
//! A drawn Gaussian has position x + dx, standard deviation exp(s + ds) and opacity 1 / (1 + exp(-o)), with dx and ds
//! what the motion adds (paper eq. 3).

use std::mem;

use gic_optimize::Moments;
use gic_splat::{GaussianGradients, Gaussians, Shape, sigmoid};
use rayon::prelude::*;

use crate::LearningRates;
use crate::tuning::SH_REST_SLOWDOWN;

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

/// Moves each number of `mean` by a share of the way to that of `value`.
pub(crate) fn mix(mean: &mut [f32], value: &[f32], share: f32) {
    mean.iter_mut().zip(value).for_each(|(mean, value)| *mean += share * (value - *mean));
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
    pub(super) fn widest(&self, i: usize) -> f64 {
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

    /// Adds the gradient of drawn Gaussians to `gradient` and to the residuals' gradient, by the chain rule. The
    /// residuals' stands for the drawn positions as well; how those follow from the canonical ones is the motion's
    /// business. Takes the harmonics' gradient out of `slope`: it is most of all numbers.
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

    /// Moves each number by a share of the way to that of `other`, which has as many Gaussians.
    pub(crate) fn mix(&mut self, other: &Parameters, share: f32) {
        mix(self.positions.as_flattened_mut(), other.positions.as_flattened(), share);
        mix(&mut self.log_scales, &other.log_scales, share);
        mix(self.rotations.as_flattened_mut(), other.rotations.as_flattened(), share);
        mix(&mut self.opacity_logits, &other.opacity_logits, share);
        mix(self.sh_dc.as_flattened_mut(), other.sh_dc.as_flattened(), share);
        mix(self.sh_rest.as_flattened_mut(), other.sh_rest.as_flattened(), share);
    }

    /// Keeps the Gaussians listed in `rows`, in that order.
    pub(super) fn select(&mut self, rows: &[usize]) {
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

    /// One step of Adam on every attribute; `fraction` of the training is over, `extent` is the object's size [m]. With
    /// `alike`, all positions are scaled by the same number.
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
    pub(super) fn select(&mut self, rows: &[Option<usize>], (axes, sh_degree): (usize, usize)) {
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

#[cfg(test)]
pub(super) mod tests {
    use rand::{RngExt, SeedableRng};
    use rand_chacha::ChaCha8Rng;

    use super::*;

    /// Adds a step to one number of the parameters or residuals.
    type Nudge = dyn Fn(&mut Parameters, &mut [[f32; 4]], usize, f32);

    pub(crate) fn random_parameters(n: usize, (axes, sh_degree): (usize, usize), rng: &mut ChaCha8Rng) -> Parameters {
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
}
