//! Viscoelastic solid: neo-Hookean elasticity and a damping in proportion to it (Kelvin-Voigt).
//!
//! ```text
//! tau = tau_elastic(F) + t_r (2 mu D + lambda tr(D) I),    D = (C + C^T) / 2
//! ```
//!
//! Both Lame moduli are delayed by the same retardation time t_r [s]: a vibration of angular frequency w is damped by
//! the ratio w t_r / 2, whatever the shape. The power lost per rest volume, `t_r (2 mu D:D + lambda tr(D)^2)`, is never
//! negative.

use gic_simd::Real;

use super::elastic::Elastic;
use super::law::{Coefficients, Law, LawAdjoint, Rules, Updated};
use crate::math::mat3::Mat3;

/// Kelvin-Voigt solid; coefficients mu, lambda [Pa] and the retardation time [s].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Viscoelastic<R> {
    elastic: Elastic<R>,
    mu: R,
    lambda: R,
    retardation: R,
}

impl<R: Real> Viscoelastic<R> {
    /// `2 mu S + lambda tr(S) I` of a symmetric S.
    #[inline(always)]
    fn stiffened(&self, symmetric: &Mat3<R>) -> Mat3<R> {
        (*symmetric * (self.mu + self.mu)).add_diagonal(self.lambda * symmetric.trace())
    }
}

impl<R: Real> Law<R> for Viscoelastic<R> {
    const LONG: bool = false;

    #[inline(always)]
    fn new(coefficients: &Coefficients, rules: Rules) -> Self {
        let [mu, lambda, retardation, _] = coefficients.0.map(R::splat);
        Viscoelastic { elastic: Elastic::new(coefficients, rules), mu, lambda, retardation }
    }

    #[inline(always)]
    fn update(&self, dt: R, c: &Mat3<R>, f: &Mat3<R>) -> Updated<R> {
        let Updated { f, tau } = self.elastic.update(dt, c, f);
        Updated { f, tau: tau.add_scaled(self.retardation, &self.stiffened(&c.symmetric_part())) }
    }

    #[inline(always)]
    fn update_adjoint(&self, dt: R, c: &Mat3<R>, f: &Mat3<R>, f_new_bar: &Mat3<R>, tau_bar: &Mat3<R>) -> LawAdjoint<R> {
        let mut adjoint = self.elastic.update_adjoint(dt, c, f, f_new_bar, tau_bar);
        let (rate, rate_bar) = (c.symmetric_part(), tau_bar.symmetric_part());
        let per_time = self.stiffened(&rate);
        let delayed = self.retardation * rate.double_dot(tau_bar);
        adjoint.c = adjoint.c.add_scaled(self.retardation, &self.stiffened(&rate_bar));
        adjoint.coefficients[0] += delayed + delayed;
        adjoint.coefficients[1] += self.retardation * rate.trace() * tau_bar.trace();
        adjoint.coefficients[2] = per_time.double_dot(tau_bar);
        adjoint.tau = adjoint.tau.add_scaled(self.retardation, &per_time);
        adjoint
    }
}
