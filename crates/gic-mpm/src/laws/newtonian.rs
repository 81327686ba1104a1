//! Newtonian fluid: weakly compressible, viscous. Only the volume ratio J is kept.
//!
//! ```text
//! J <- (1 + dt tr C) J
//! tau = kappa (J - J^-6) I + mu J (C + C^T) / 2
//! ```
//!
//! (The published simulator's form. With Newton's law written as `2 mu D`, the viscosity of this fluid is mu / 2.) The
//! deformation gradient is `diag(J, 1, 1)`, so that its determinant is J as for every other material.

use gic_simd::Real;

use super::law::{Coefficients, Law, LawAdjoint, MAX_COEFFICIENTS, Rules, Updated};
use crate::math::mat3::Mat3;

/// J stays at least this, as in the published simulator.
const MIN_J: f64 = 0.05;

/// Newtonian fluid; coefficients mu [Pa s] and lambda = kappa - 2/3 mu, with kappa the bulk modulus [Pa].
#[derive(Clone, Copy, Debug)]
pub(crate) struct Newtonian<R> {
    mu: R,
    kappa: R,
}

/// New J, whether it is free of its bound, and J^-6.
struct Volume<R: Real> {
    growth: R,
    free: R::Mask,
    j: R,
    j6_recip: R,
}

impl<R: Real> Volume<R> {
    #[inline(always)]
    fn of(dt: R, c: &Mat3<R>, old: R) -> Self {
        let growth = dt.mul_add(c.trace(), R::one());
        let min = R::splat(MIN_J);
        let j = min.max(growth * old);
        let recip = R::one() / j;
        let cube = recip * recip * recip;
        Volume { growth, free: min.lt(j), j, j6_recip: cube * cube }
    }
}

impl<R: Real> Newtonian<R> {
    /// tau, from the strain rate (C + C^T) / 2, J and J^-6.
    #[inline(always)]
    fn stress(&self, rate: &Mat3<R>, j: R, j6_recip: R) -> Mat3<R> {
        (*rate * (self.mu * j)).add_diagonal(self.kappa * (j - j6_recip))
    }
}

impl<R: Real> Law<R> for Newtonian<R> {
    const LONG: bool = false;

    #[inline(always)]
    fn new(coefficients: &Coefficients, _rules: Rules) -> Self {
        let [mu, lambda, ..] = coefficients.0;
        Newtonian { mu: R::splat(mu), kappa: R::splat(lambda + 2.0 / 3.0 * mu) }
    }

    #[inline(always)]
    fn update(&self, dt: R, c: &Mat3<R>, f: &Mat3<R>) -> Updated<R> {
        let Volume { j, j6_recip, .. } = Volume::of(dt, c, f.at(0, 0));
        let tau = self.stress(&c.symmetric_part(), j, j6_recip);
        Updated { f: Mat3::diagonal([j, R::one(), R::one()]), tau }
    }

    #[inline(always)]
    fn update_adjoint(&self, dt: R, c: &Mat3<R>, f: &Mat3<R>, f_new_bar: &Mat3<R>, tau_bar: &Mat3<R>) -> LawAdjoint<R> {
        let old = f.at(0, 0);
        let Volume { growth, free, j, j6_recip } = Volume::of(dt, c, old);
        let trace_bar = tau_bar.trace();
        let rate = c.symmetric_part();
        let shear_bar = rate.double_dot(tau_bar);

        let pressure_slope = self.kappa * (R::splat(6.0) * j6_recip / j + R::one());
        let j_bar = pressure_slope.mul_add(trace_bar, self.mu.mul_add(shear_bar, f_new_bar.at(0, 0)));
        let j_bar = R::select(free, j_bar, R::zero());
        let c_bar = (tau_bar.symmetric_part() * (self.mu * j)).add_diagonal(j_bar * dt * old);

        let kappa_bar = (j - j6_recip) * trace_bar;
        let mut coefficients = [R::zero(); MAX_COEFFICIENTS];
        coefficients[0] = (kappa_bar * R::splat(2.0 / 3.0)) + j * shear_bar;
        coefficients[1] = kappa_bar;
        let z = R::zero();
        let tau = self.stress(&rate, j, j6_recip);
        LawAdjoint { c: c_bar, f: Mat3([j_bar * growth, z, z, z, z, z, z, z, z]), coefficients, tau }
    }
}
