//! Constitutive laws: from the old deformation gradient and the velocity gradient to the new one and the stress, and
//! back.
//!
//! Every law does the same two things in a substep (and their derivatives in reverse):
//! 1. trial: `F_trial = (I + dt C) F`, with C the affine velocity gradient of the particle;
//! 2. return map (plastic laws): `F_trial -> F_new`, then the Kirchhoff stress `tau(F_new)` [Pa].
//!
//! The grid then receives the affine term `-dt * rest volume * 4/dx^2 * tau + m C`.

use gic_simd::Real;

use crate::math::mat3::Mat3;

/// The most coefficients that a law has.
pub(crate) const MAX_COEFFICIENTS: usize = 4;

/// The numbers that a law's kernel sees, in the law's own order. Every law starts with mu, lambda.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Coefficients(pub(crate) [f64; MAX_COEFFICIENTS]);

/// Whose numerics a law follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Rules {
    /// Norms are exact. The default.
    #[default]
    Exact,
    /// The published simulator's: norms of strains and stresses are `sqrt(x.x + 1e-8)`, so strains below 1e-4 are taken
    /// for larger than they are and a plastic material creeps back from the yield surface each substep. For comparisons
    /// with it.
    Reference,
}

/// What a law makes of a particle in a substep.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Updated<R> {
    /// The new (elastic) deformation gradient.
    pub(crate) f: Mat3<R>,
    /// The Kirchhoff stress [Pa], symmetric.
    pub(crate) tau: Mat3<R>,
}

/// Derivatives of a loss with respect to what went into [`Law::update`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct LawAdjoint<R> {
    /// With respect to the velocity gradient C.
    pub(crate) c: Mat3<R>,
    /// With respect to the old deformation gradient F.
    pub(crate) f: Mat3<R>,
    /// With respect to the coefficients, per lane, in the order of [`Coefficients`]; those that the law does not have
    /// are zero.
    pub(crate) coefficients: [R; MAX_COEFFICIENTS],
    /// The Kirchhoff stress [Pa] of [`Law::update`], which is computed on the way.
    pub(crate) tau: Mat3<R>,
}

/// A constitutive law over lanes of particles of one material.
///
/// All methods are branch-free and `#[inline(always)]`, so that they take the instruction set of the kernel they are
/// called from.
pub(crate) trait Law<R: Real>: Copy + Send + Sync {
    /// Whether its code is long enough to be worth a function of its own (see [`gic_simd::Lanes::outlined`]).
    const LONG: bool;

    /// Prepares the law. The coefficients are assumed valid (`Material::validate`).
    fn new(coefficients: &Coefficients, rules: Rules) -> Self;

    /// One substep: old F and velocity gradient C [1/s] to new F and Kirchhoff stress [Pa]. `dt` is in seconds.
    fn update(&self, dt: R, c: &Mat3<R>, f: &Mat3<R>) -> Updated<R>;

    /// The reverse of [`Law::update`] at the same `dt, c, f`: recomputes what it needs, and turns the derivatives of a
    /// loss with respect to (F_new, tau) into those with respect to (C, F, coefficients).
    ///
    /// `tau_bar` need not be symmetric; only its symmetric part counts.
    fn update_adjoint(&self, dt: R, c: &Mat3<R>, f: &Mat3<R>, f_new_bar: &Mat3<R>, tau_bar: &Mat3<R>) -> LawAdjoint<R>;
}

/// `(I + dt C) F`.
#[inline(always)]
pub(super) fn trial<R: Real>(dt: R, c: &Mat3<R>, f: &Mat3<R>) -> Mat3<R> {
    f.add_scaled(dt, &c.times(f))
}

/// From the derivative with respect to the trial gradient to those with respect to (C, F).
#[inline(always)]
pub(super) fn trial_adjoint<R: Real>(dt: R, c: &Mat3<R>, f: &Mat3<R>, trial_bar: &Mat3<R>) -> (Mat3<R>, Mat3<R>) {
    let c_bar = trial_bar.times_transposed(f) * dt;
    let f_bar = trial_bar.add_scaled(dt, &c.transposed_times(trial_bar));
    (c_bar, f_bar)
}
