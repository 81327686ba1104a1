//! Non-Newtonian fluid: Hencky elasticity with a viscoplastic return (Herschel-Bulkley with exponent 1; Yue et al.
//! 2015).
//!
//! With the deviatoric stress `s = 2 mu e_hat` it is elastic while `|s| <= sqrt(2/3) tau_Y`; beyond, only part of the
//! excess is taken back in a substep:
//!
//! ```text
//! |s'| = |s| - (|s| - sqrt(2/3) tau_Y) q / (q + eta),   q = 2 mu_hat dt,   mu_hat = mu tr(sigma^2) / 3
//! ```
//!
//! which is implicit in time, so stable for any eta.

use gic_simd::Real;

use super::hencky::{Hencky, Norm, ReturnAdjoint, ReturnMap, Returned, Strain, dot};
use super::law::{Coefficients, MAX_COEFFICIENTS, Rules};
use crate::math::mat3::each;

/// Non-Newtonian fluid; coefficients mu, lambda, tau_Y [Pa], eta [Pa s].
pub(crate) type NonNewtonian<R> = Hencky<R, Viscoplastic<R>>;

/// The viscoplastic return map.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Viscoplastic<R> {
    mu: R,
    /// sqrt(2/3) tau_Y.
    limit: R,
    eta: R,
    rules: Rules,
}

/// What map and derivative share.
struct Flow<R: Real> {
    /// Deviatoric stress [Pa].
    stress: [R; 3],
    norm: Norm<R>,
    yields: R::Mask,
    /// 1 - limit / |s|: the excess over the stress.
    excess: R,
    /// q and 1 / (q + eta).
    q: R,
    recip: R,
}

impl<R: Real> Viscoplastic<R> {
    #[inline(always)]
    fn flow(&self, dt: R, strain: &Strain<R>) -> Flow<R> {
        let two_mu = self.mu + self.mu;
        let stress = each(strain.deviator, |e| two_mu * e);
        let norm = Norm::of(&stress, self.rules);
        let q = two_mu * strain.mean_square_stretch * dt;
        Flow {
            stress,
            norm,
            yields: self.limit.lt(norm.value),
            excess: R::one() - self.limit * norm.recip,
            q,
            recip: R::one() / (q + self.eta),
        }
    }
}

impl<R: Real> ReturnMap<R> for Viscoplastic<R> {
    #[inline(always)]
    fn new(coefficients: &Coefficients, rules: Rules) -> Self {
        let [mu, _, yield_stress, eta] = coefficients.0;
        let limit = (2.0_f64 / 3.0).sqrt() * yield_stress;
        Viscoplastic { mu: R::splat(mu), limit: R::splat(limit), eta: R::splat(eta), rules }
    }

    #[inline(always)]
    fn project(&self, dt: R, strain: &Strain<R>) -> Returned<R> {
        let flow = self.flow(dt, strain);
        let scale = R::one() - flow.excess * flow.q * flow.recip;
        Returned { scale: R::select(flow.yields, scale, R::one()), trace: strain.trace }
    }

    #[inline(always)]
    fn project_adjoint(&self, dt: R, strain: &Strain<R>, bar: &Returned<R>) -> ReturnAdjoint<R> {
        let Flow { stress, norm, yields, excess, q, recip } = self.flow(dt, strain);
        // scale = 1 - excess * returned, returned = q / (q + eta), while it yields.
        let scale_bar = R::select(yields, bar.scale, R::zero());
        let excess_bar = -(scale_bar * q * recip);
        let returned_bar = -(scale_bar * excess) * recip * recip;
        let q_bar = returned_bar * self.eta;
        let eta_bar = -(returned_bar * q);

        let limit_bar = -(excess_bar * norm.recip);
        let norm_bar = excess_bar * self.limit * norm.recip * norm.recip;
        let stress_bar = norm.adjoint(&stress, norm_bar);

        let two_mu = self.mu + self.mu;
        let two_mu_bar = dot(stress_bar, strain.deviator) + q_bar * strain.mean_square_stretch * dt;
        let mut coefficients = [R::zero(); MAX_COEFFICIENTS];
        coefficients[0] = two_mu_bar + two_mu_bar;
        coefficients[2] = limit_bar * R::splat((2.0_f64 / 3.0).sqrt());
        coefficients[3] = eta_bar;
        ReturnAdjoint {
            strain: Strain {
                deviator: each(stress_bar, |bar| two_mu * bar),
                trace: bar.trace,
                mean_square_stretch: q_bar * two_mu * dt,
            },
            coefficients,
        }
    }
}
