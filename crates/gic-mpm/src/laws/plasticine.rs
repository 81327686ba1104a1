//! Plasticine: Hencky elasticity with a von Mises yield surface and instant return.
//!
//! With e_hat the deviator of the Hencky strain:
//!
//! ```text
//! e_hat' = e_hat min(1, limit / |e_hat|),   limit = tau_Y / (2 mu)
//! ```
//!
//! This is the form of GIC. PAC-NeRF's tau_Y is a uniaxial yield stress, `|2 mu e_hat| <= sqrt(2/3) tau_Y`: larger by
//! `sqrt(3/2)` for the same material.

use gic_simd::Real;

use super::hencky::{Hencky, Norm, ReturnAdjoint, ReturnMap, Returned, Strain};
use super::law::{Coefficients, MAX_COEFFICIENTS, Rules};

/// Plasticine; coefficients mu, lambda, tau_Y [Pa].
pub(crate) type Plasticine<R> = Hencky<R, VonMises<R>>;

/// The von Mises return map.
#[derive(Clone, Copy, Debug)]
pub(crate) struct VonMises<R> {
    mu: R,
    /// tau_Y / (2 mu).
    limit: R,
    rules: Rules,
}

impl<R: Real> ReturnMap<R> for VonMises<R> {
    #[inline(always)]
    fn new(coefficients: &Coefficients, rules: Rules) -> Self {
        let [mu, _, yield_stress, _] = coefficients.0;
        VonMises { mu: R::splat(mu), limit: R::splat(yield_stress / (2.0 * mu)), rules }
    }

    #[inline(always)]
    fn project(&self, _dt: R, strain: &Strain<R>) -> Returned<R> {
        let norm = Norm::of(&strain.deviator, self.rules);
        let scale = R::select(self.limit.lt(norm.value), self.limit * norm.recip, R::one());
        Returned { scale, trace: strain.trace }
    }

    #[inline(always)]
    fn project_adjoint(&self, _dt: R, strain: &Strain<R>, bar: &Returned<R>) -> ReturnAdjoint<R> {
        let norm = Norm::of(&strain.deviator, self.rules);
        // scale = limit / norm while it yields.
        let limit_bar = R::select(self.limit.lt(norm.value), bar.scale * norm.recip, R::zero());
        let norm_bar = -(limit_bar * self.limit * norm.recip);
        let mut coefficients = [R::zero(); MAX_COEFFICIENTS];
        coefficients[0] = -(limit_bar * self.limit / self.mu);
        coefficients[2] = limit_bar * R::splat(0.5) / self.mu;
        ReturnAdjoint {
            strain: Strain {
                deviator: norm.adjoint(&strain.deviator, norm_bar),
                trace: bar.trace,
                mean_square_stretch: R::zero(),
            },
            coefficients,
        }
    }
}
