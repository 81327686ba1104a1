//! Sand: Hencky elasticity with a Drucker-Prager cone without cohesion (Klar et al. 2016).
//!
//! With e_hat the deviator of the Hencky strain e, and alpha the slope of the cone:
//!
//! ```text
//! tr e > 0:  e' = 0, no stress
//! else:      e_hat' = e_hat min(1, limit / |e_hat|),   limit = -(3 lambda + 2 mu) / (2 mu) alpha tr e,   tr e' = tr e
//! ```

use gic_simd::Real;

use super::hencky::{Hencky, Norm, ReturnAdjoint, ReturnMap, Returned, Strain};
use super::law::{Coefficients, MAX_COEFFICIENTS, Rules};

/// Sand; coefficients mu, lambda [Pa], alpha.
pub(crate) type Sand<R> = Hencky<R, DruckerPrager<R>>;

/// The Drucker-Prager return map.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DruckerPrager<R> {
    alpha: R,
    /// (3 lambda + 2 mu) / (2 mu).
    steepness: R,
    /// Derivatives of the steepness with respect to (mu, lambda).
    steepness_slope: [R; 2],
    rules: Rules,
}

/// Which part of the map a strain falls in, and its deviator's length.
struct Case<R: Real> {
    norm: Norm<R>,
    expands: R::Mask,
    /// Compressed, and outside of the cone.
    yields: R::Mask,
    /// The longest deviator that the compression bears.
    limit: R,
}

impl<R: Real> DruckerPrager<R> {
    #[inline(always)]
    fn case(&self, strain: &Strain<R>) -> Case<R> {
        let norm = Norm::of(&strain.deviator, self.rules);
        let expands = R::zero().lt(strain.trace);
        let limit = -(self.steepness * self.alpha * strain.trace);
        let yields = R::and(R::not(expands), limit.lt(norm.value));
        Case { norm, expands, yields, limit }
    }
}

impl<R: Real> ReturnMap<R> for DruckerPrager<R> {
    #[inline(always)]
    fn new(coefficients: &Coefficients, rules: Rules) -> Self {
        let [mu, lambda, alpha, _] = coefficients.0;
        DruckerPrager {
            alpha: R::splat(alpha),
            steepness: R::splat(1.0 + 1.5 * lambda / mu),
            steepness_slope: [R::splat(-1.5 * lambda / (mu * mu)), R::splat(1.5 / mu)],
            rules,
        }
    }

    #[inline(always)]
    fn project(&self, _dt: R, strain: &Strain<R>) -> Returned<R> {
        let Case { norm, expands, yields, limit } = self.case(strain);
        let compressed = R::select(yields, limit * norm.recip, R::one());
        Returned {
            scale: R::select(expands, R::zero(), compressed),
            trace: R::select(expands, R::zero(), strain.trace),
        }
    }

    #[inline(always)]
    fn project_adjoint(&self, _dt: R, strain: &Strain<R>, bar: &Returned<R>) -> ReturnAdjoint<R> {
        let Case { norm, expands, yields, limit } = self.case(strain);
        // scale = limit / norm while it yields, limit = -steepness alpha trace.
        let limit_bar = R::select(yields, bar.scale * norm.recip, R::zero());
        let norm_bar = -(limit_bar * limit * norm.recip);
        let trace_bar = bar.trace - limit_bar * self.steepness * self.alpha;
        let steepness_bar = -(limit_bar * self.alpha * strain.trace);
        let mut coefficients = [R::zero(); MAX_COEFFICIENTS];
        coefficients[0] = steepness_bar * self.steepness_slope[0];
        coefficients[1] = steepness_bar * self.steepness_slope[1];
        coefficients[2] = -(limit_bar * self.steepness * strain.trace);
        ReturnAdjoint {
            strain: Strain {
                deviator: norm.adjoint(&strain.deviator, norm_bar),
                trace: R::select(expands, R::zero(), trace_bar),
                mean_square_stretch: R::zero(),
            },
            coefficients,
        }
    }
}
