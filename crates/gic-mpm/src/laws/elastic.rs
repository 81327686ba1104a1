//! Neo-Hookean elasticity: `tau = mu F F^T + (lambda ln J - mu) I` (paper, appendix "Constitutive Models").

use gic_simd::Real;

use super::law::{Coefficients, Law, LawAdjoint, MAX_COEFFICIENTS, Rules, Updated, trial, trial_adjoint};
use crate::math::mat3::Mat3;

/// J is taken for at least this inside the logarithm: a particle crushed further, or inverted, is pushed back with a
/// large finite pressure.
const MIN_J: f64 = 0.05 * 0.05 * 0.05;

/// Neo-Hookean solid; coefficients mu, lambda [Pa].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Elastic<R> {
    mu: R,
    lambda: R,
}

impl<R: Real> Elastic<R> {
    /// tau, from F F^T and ln J.
    #[inline(always)]
    fn stress(&self, left: &Mat3<R>, log: R) -> Mat3<R> {
        (*left * self.mu).add_diagonal(self.lambda * log - self.mu)
    }
}

impl<R: Real> Law<R> for Elastic<R> {
    const LONG: bool = false;

    #[inline(always)]
    fn new(coefficients: &Coefficients, _rules: Rules) -> Self {
        Elastic { mu: R::splat(coefficients.0[0]), lambda: R::splat(coefficients.0[1]) }
    }

    #[inline(always)]
    fn update(&self, dt: R, c: &Mat3<R>, f: &Mat3<R>) -> Updated<R> {
        let f = trial(dt, c, f);
        let j = f.det().max(R::splat(MIN_J));
        Updated { f, tau: self.stress(&f.times_transposed(&f), j.ln()) }
    }

    #[inline(always)]
    fn update_adjoint(&self, dt: R, c: &Mat3<R>, f: &Mat3<R>, f_new_bar: &Mat3<R>, tau_bar: &Mat3<R>) -> LawAdjoint<R> {
        let f_new = trial(dt, c, f);
        let det = f_new.det();
        let j = det.max(R::splat(MIN_J));
        let trace_bar = tau_bar.trace();

        // d(F F^T) : tau_bar = (tau_bar + tau_bar^T) F : dF, and dJ = cofactor(F) : dF.
        let shear = tau_bar.plus_transpose().times(&f_new) * self.mu;
        let log_bar = R::select(R::splat(MIN_J).lt(det), self.lambda * trace_bar / j, R::zero());
        let f_new_bar = (*f_new_bar + shear).add_scaled(log_bar, &f_new.cofactor());

        let (c_bar, f_bar) = trial_adjoint(dt, c, f, &f_new_bar);
        let (left, log) = (f_new.times_transposed(&f_new), j.ln());
        let mut coefficients = [R::zero(); MAX_COEFFICIENTS];
        coefficients[0] = left.double_dot(tau_bar) - trace_bar;
        coefficients[1] = log * trace_bar;
        let tau = self.stress(&left, log);
        LawAdjoint { c: c_bar, f: f_bar, coefficients, tau }
    }
}
