//! Isotropic elastoplasticity in principal logarithmic (Hencky) strains, and its derivative.
//!
//! With `F_trial F_trial^T = Q diag(s^2) Q^T` and the strains `e = ln s`, a [`ReturnMap`] shortens the deviator of e by
//! a factor and changes its trace; then
//!
//! ```text
//! tau   = Q diag(2 mu e' + lambda tr e') Q^T
//! F_new = Q diag(exp(e') / s) Q^T F_trial
//! ```
//!
//! Neither needs V of a singular value decomposition. (The paper prints the stress with the Green strain; its published
//! simulator, and the exactness of the return maps, need the Hencky form.)
//!
//! Backward, with `B = F_trial F_trial^T` and `lambda = s^2`, a matrix `Y = Q diag(y_i(lambda)) Q^T` is an isotropic
//! function of B. In the frame Q its derivative maps diagonals by `dy_k / d lambda_i` and off-diagonals by the divided
//! differences `(y_i - y_j) / (lambda_i - lambda_j)`, which have finite limits where eigenvalues meet. They are
//! evaluated below without cancellation.

use gic_simd::Real;

use super::law::{Coefficients, Law, LawAdjoint, MAX_COEFFICIENTS, Rules, Updated, trial, trial_adjoint};
use crate::math::eigen::Eigen;
use crate::math::mat3::{Mat3, each};

/// Singular values are raised to this before the logarithm, and so in F_new: a crushed or inverted particle recovers.
const MIN_STRETCH: f64 = 0.05;

/// Divided differences whose argument is smaller than this come from a power series, which is true to 1e-12 there; the
/// quotient would lose digits.
const SERIES_RANGE: f64 = 0.1;

/// Principal Hencky strains of a trial state.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Strain<R> {
    /// Strains less their mean.
    pub(crate) deviator: [R; 3],
    /// Sum of the strains.
    pub(crate) trace: R,
    /// Mean of the squared stretches, `tr(sigma^2) / 3`.
    pub(crate) mean_square_stretch: R,
}

/// Where a return map takes a strain.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Returned<R> {
    /// The new deviator is the old one times this.
    pub(crate) scale: R,
    /// The new trace.
    pub(crate) trace: R,
}

/// Derivatives of a loss with respect to what went into [`ReturnMap::project`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct ReturnAdjoint<R> {
    pub(crate) strain: Strain<R>,
    pub(crate) coefficients: [R; MAX_COEFFICIENTS],
}

/// A plastic return map that keeps the direction of the deviator.
pub(crate) trait ReturnMap<R: Real>: Copy + Send + Sync {
    /// From the law's coefficients, of which the first two are mu, lambda.
    fn new(coefficients: &Coefficients, rules: Rules) -> Self;
    /// From the trial strain to the new one.
    fn project(&self, dt: R, strain: &Strain<R>) -> Returned<R>;
    /// The reverse of [`ReturnMap::project`], given the derivatives with respect to its results.
    fn project_adjoint(&self, dt: R, strain: &Strain<R>, bar: &Returned<R>) -> ReturnAdjoint<R>;
}

/// What the published simulator adds to a squared norm.
const REFERENCE_NORM_FLOOR: f64 = 1e-8;

/// A vector's length as the rules define it, and how to divide by it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Norm<R> {
    /// The length.
    pub(crate) value: R,
    /// Its reciprocal; large but finite for a vanishing vector.
    pub(crate) recip: R,
}

impl<R: Real> Norm<R> {
    #[inline(always)]
    pub(crate) fn of(v: &[R; 3], rules: Rules) -> Self {
        let square = v[0].mul_add(v[0], v[1].mul_add(v[1], v[2] * v[2]));
        match rules {
            Rules::Exact => {
                let value = square.sqrt();
                Norm { value, recip: R::one() / value.max(R::splat(1e-15)) }
            }
            Rules::Reference => {
                let value = (square + R::splat(REFERENCE_NORM_FLOOR)).sqrt();
                Norm { value, recip: R::one() / value }
            }
        }
    }

    /// From the derivative with respect to the length to that with respect to the vector.
    #[inline(always)]
    pub(crate) fn adjoint(&self, v: &[R; 3], value_bar: R) -> [R; 3] {
        let factor = value_bar * self.recip;
        each(*v, |x| x * factor)
    }
}

/// A Hencky-elastic material with a return map.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Hencky<R, M> {
    mu: R,
    lambda: R,
    map: M,
}

/// A trial state in principal axes.
struct Principal<R> {
    /// Axes, and squared singular values.
    eigen: Eigen<R>,
    /// Reciprocals of the singular values; the smallest is negative where F is inverted.
    stretch_recip: [R; 3],
    /// 1, or raised / true singular value where that was raised.
    raise: [R; 3],
    /// Logarithms of the (raised) singular values.
    log: [R; 3],
    strain: Strain<R>,
}

impl<R: Real> Principal<R> {
    #[inline(always)]
    fn of(f: &Mat3<R>) -> Self {
        let eigen = Eigen::of_symmetric(&f.times_transposed(f));
        let smallest = eigen.values[0].min(eigen.values[1]).min(eigen.values[2]);
        let inverted = f.det().lt(R::zero());
        let least_square = R::splat(MIN_STRETCH * MIN_STRETCH);

        let mut stretch_recip = [R::one(); 3];
        let mut raise = [R::one(); 3];
        let mut log = [R::zero(); 3];
        let mut mean_square_stretch = R::zero();
        for i in 0..3 {
            let square = eigen.values[i];
            let negative = R::and(inverted, square.le(smallest));
            let size = square.max(R::splat(1e-12)).rsqrt();
            stretch_recip[i] = R::select(negative, -size, size);
            let raised = R::or(negative, square.lt(least_square));
            raise[i] = R::select(raised, stretch_recip[i] * R::splat(MIN_STRETCH), R::one());
            let square = R::select(raised, least_square, square);
            log[i] = square.ln() * R::splat(0.5);
            mean_square_stretch += square * R::splat(1.0 / 3.0);
        }
        let trace = log[0] + log[1] + log[2];
        let mean = trace * R::splat(1.0 / 3.0);
        let strain = Strain { deviator: each(log, |e| e - mean), trace, mean_square_stretch };
        Principal { eigen, stretch_recip, raise, log, strain }
    }

    /// Whether a singular value was raised.
    #[inline(always)]
    fn is_raised(&self, i: usize) -> R::Mask {
        R::or(self.raise[i].lt(R::one()), R::one().lt(self.raise[i]))
    }

    /// `lambda_i - lambda_j`, kept away from zero.
    #[inline(always)]
    fn gap(&self, i: usize, j: usize) -> R {
        let gap = self.eigen.values[i] - self.eigen.values[j];
        gap.abs().max(R::splat(1e-6)).copysign(gap)
    }

    /// `(log_i - log_j) / (lambda_i - lambda_j)`.
    ///
    /// With x = (lambda_i - lambda_j) / (lambda_i + lambda_j) the difference of the logarithms is atanh(x), so this is
    /// `(atanh(x) / x) / (lambda_i + lambda_j)`.
    #[inline(always)]
    fn log_slope(&self, i: usize, j: usize) -> R {
        let (a, b) = (self.eigen.values[i], self.eigen.values[j]);
        let sum_recip = R::one() / (a + b);
        let x = (a - b) * sum_recip;
        let rise = self.log[i] - self.log[j];
        let near = x.abs().lt(R::splat(SERIES_RANGE));
        let square = x * x;
        let mut series = R::splat(1.0 / 11.0);
        for odd in [9.0, 7.0, 5.0, 3.0, 1.0] {
            series = series.mul_add(square, R::splat(1.0 / odd));
        }
        let smooth = R::select(near, series, rise / R::select(near, R::one(), x)) * sum_recip;
        let raised = R::or(self.is_raised(i), self.is_raised(j));
        R::select(raised, rise / self.gap(i, j), smooth)
    }

    /// `(raise_i - raise_j) / (lambda_i - lambda_j)`; where both were raised, `raise = MIN_STRETCH / s`.
    #[inline(always)]
    fn raise_slope(&self, i: usize, j: usize) -> R {
        let both = R::and(self.is_raised(i), self.is_raised(j));
        let (ri, rj) = (self.stretch_recip[i], self.stretch_recip[j]);
        // 1 / (s_i s_j (s_i + s_j)) = (r_i r_j)^2 / (r_i + r_j).
        let sum = (ri + rj).abs().max(R::splat(1e-6)).copysign(ri + rj);
        let both_slope = -(ri * rj) * (ri * rj) / sum * R::splat(MIN_STRETCH);
        R::select(both, both_slope, (self.raise[i] - self.raise[j]) / self.gap(i, j))
    }
}

/// The new state in principal axes.
struct Plastic<R> {
    returned: Returned<R>,
    /// New strains e'.
    log: [R; 3],
    /// What the return map adds to the strains, e' - e: exactly zero where it does nothing.
    shift: [R; 3],
    /// exp(shift).
    shrink: [R; 3],
    /// F_new = Q diag(1 + stretch) Q^T F_trial.
    stretch: [R; 3],
}

impl<R: Real> Plastic<R> {
    #[inline(always)]
    fn of(principal: &Principal<R>, returned: Returned<R>) -> Self {
        let Strain { deviator, trace, .. } = principal.strain;
        let third = R::splat(1.0 / 3.0);
        let mean_shift = (returned.trace - trace) * third;
        let shorten = returned.scale - R::one();
        let shift = each(deviator, |e| shorten.mul_add(e, mean_shift));
        let shrink = [shift[0].exp(), shift[1].exp(), shift[2].exp()];
        Plastic {
            returned,
            log: each(deviator, |e| returned.scale.mul_add(e, returned.trace * third)),
            shift,
            shrink,
            stretch: each([0, 1, 2], |i: usize| shrink[i].mul_add(principal.raise[i], -R::one())),
        }
    }

    /// `(shrink_i - shrink_j) / (shift_i - shift_j)`: the mean of the two times `tanh(d/2) / (d/2)`, d the difference
    /// of the shifts.
    #[inline(always)]
    fn shrink_slope(&self, i: usize, j: usize) -> R {
        let d = self.shift[i] - self.shift[j];
        let near = d.abs().lt(R::splat(SERIES_RANGE));
        let square = d * d;
        let mut series = R::splat(-17.0 / 20160.0);
        for term in [1.0 / 120.0, -1.0 / 12.0, 1.0] {
            series = series.mul_add(square, R::splat(term));
        }
        let mean = (self.shrink[i] + self.shrink[j]) * R::splat(0.5);
        let far = (self.shrink[i] - self.shrink[j]) / R::select(near, R::one(), d);
        R::select(near, mean * series, far)
    }
}

impl<R: Real, M: ReturnMap<R>> Hencky<R, M> {
    #[inline(always)]
    fn stress(&self, principal: &Principal<R>, plastic: &Plastic<R>) -> Mat3<R> {
        let pressure_term = self.lambda * plastic.returned.trace;
        let two_mu = self.mu + self.mu;
        principal.eigen.compose(each(plastic.log, |e| two_mu.mul_add(e, pressure_term)))
    }

    /// The adjoint on the diagonal: derivatives with respect to the eigenvalues of B, and to the coefficients.
    #[inline(always)]
    fn diagonal_adjoint(
        &self,
        dt: R,
        principal: &Principal<R>,
        plastic: &Plastic<R>,
        stretch_bar: [R; 3],
        tau_bar: [R; 3],
    ) -> ([R; 3], [R; MAX_COEFFICIENTS]) {
        let third = R::splat(1.0 / 3.0);
        let Strain { deviator, .. } = principal.strain;
        let two_mu = self.mu + self.mu;
        let tau_bar_sum = sum(tau_bar);
        let log_bar = each(tau_bar, |bar| two_mu * bar);
        let shift_bar = each([0, 1, 2], |i: usize| stretch_bar[i] * principal.raise[i] * plastic.shrink[i]);

        let returned_bar = Returned {
            scale: dot(deviator, each([0, 1, 2], |i: usize| log_bar[i] + shift_bar[i])),
            trace: self.lambda.mul_add(tau_bar_sum, (sum(log_bar) + sum(shift_bar)) * third),
        };
        let map = self.map.project_adjoint(dt, &principal.strain, &returned_bar);

        let scale = plastic.returned.scale;
        let shorten = scale - R::one();
        let deviator_bar =
            each([0, 1, 2], |i: usize| map.strain.deviator[i] + scale * log_bar[i] + shorten * shift_bar[i]);
        let all_bar = map.strain.trace - (sum(shift_bar) + sum(deviator_bar)) * third;
        let square_bar = map.strain.mean_square_stretch * third;

        let mut eigenvalue_bar = [R::zero(); 3];
        for i in 0..3 {
            // d log / d lambda = 1 / (2 lambda), d square / d lambda = 1;
            // where raised, only d raise / d lambda = -raise / (2 lambda).
            let half_recip = principal.stretch_recip[i] * principal.stretch_recip[i] * R::splat(0.5);
            let free = (deviator_bar[i] + all_bar).mul_add(half_recip, square_bar);
            let raised = -(stretch_bar[i] * plastic.shrink[i] * principal.raise[i] * half_recip);
            eigenvalue_bar[i] = R::select(principal.is_raised(i), raised, free);
        }
        let mut coefficients = map.coefficients;
        let log = plastic.log;
        coefficients[0] += dot(tau_bar, each(log, |e| e + e));
        coefficients[1] += tau_bar_sum * plastic.returned.trace;
        (eigenvalue_bar, coefficients)
    }
}

impl<R: Real, M: ReturnMap<R>> Law<R> for Hencky<R, M> {
    const LONG: bool = true;

    #[inline(always)]
    fn new(coefficients: &Coefficients, rules: Rules) -> Self {
        Hencky {
            mu: R::splat(coefficients.0[0]),
            lambda: R::splat(coefficients.0[1]),
            map: M::new(coefficients, rules),
        }
    }

    #[inline(always)]
    fn update(&self, dt: R, c: &Mat3<R>, f: &Mat3<R>) -> Updated<R> {
        let f_trial = trial(dt, c, f);
        let principal = Principal::of(&f_trial);
        let plastic = Plastic::of(&principal, self.map.project(dt, &principal.strain));
        let tau = self.stress(&principal, &plastic);
        // As an addition: where the return map does nothing, the rounding of Q cannot touch F.
        let f = f_trial + principal.eigen.compose(plastic.stretch).times(&f_trial);
        Updated { f, tau }
    }

    #[inline(always)]
    fn update_adjoint(&self, dt: R, c: &Mat3<R>, f: &Mat3<R>, f_new_bar: &Mat3<R>, tau_bar: &Mat3<R>) -> LawAdjoint<R> {
        let f_trial = trial(dt, c, f);
        let principal = Principal::of(&f_trial);
        let plastic = Plastic::of(&principal, self.map.project(dt, &principal.strain));
        let eigen = &principal.eigen;

        // In the frame Q: derivatives with respect to diag(stretch) and diag(tau), symmetric.
        let stretch_bar = eigen.rotate_in(&f_new_bar.times_transposed(&f_trial).symmetric_part());
        let tau_bar = eigen.rotate_in(&tau_bar.symmetric_part());
        let diagonal = |m: &Mat3<R>| [m.at(0, 0), m.at(1, 1), m.at(2, 2)];
        let (eigenvalue_bar, coefficients) =
            self.diagonal_adjoint(dt, &principal, &plastic, diagonal(&stretch_bar), diagonal(&tau_bar));

        let two_mu_scale = (self.mu + self.mu) * plastic.returned.scale;
        let shorten = plastic.returned.scale - R::one();
        let half = R::splat(0.5);
        let mut b_bar = Mat3::diagonal(eigenvalue_bar);
        for (i, j) in [(0, 1), (0, 2), (1, 2)] {
            let log_slope = principal.log_slope(i, j);
            let raise_mean = (principal.raise[i] + principal.raise[j]) * half;
            let shrink_mean = (plastic.shrink[i] + plastic.shrink[j]) * half;
            let tau_slope = two_mu_scale * log_slope;
            let stretch_slope = (raise_mean * shorten * plastic.shrink_slope(i, j))
                .mul_add(log_slope, shrink_mean * principal.raise_slope(i, j));
            let value = tau_bar.at(i, j).mul_add(tau_slope, stretch_bar.at(i, j) * stretch_slope);
            b_bar.0[3 * i + j] = value;
            b_bar.0[3 * j + i] = value;
        }

        // dB = dF F^T + F dF^T, and F_new = F + (stretch) F.
        let b_bar = eigen.rotate_out(&b_bar);
        let f_trial_bar =
            *f_new_bar + eigen.compose(plastic.stretch).times(f_new_bar) + (b_bar + b_bar).times(&f_trial);
        let (c_bar, f_bar) = trial_adjoint(dt, c, f, &f_trial_bar);
        LawAdjoint { c: c_bar, f: f_bar, coefficients, tau: self.stress(&principal, &plastic) }
    }
}

#[inline(always)]
fn sum<R: Real>(v: [R; 3]) -> R {
    v[0] + v[1] + v[2]
}

#[inline(always)]
pub(super) fn dot<R: Real>(a: [R; 3], b: [R; 3]) -> R {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}
