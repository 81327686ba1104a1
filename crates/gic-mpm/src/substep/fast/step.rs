//! What the passes share: the law over lanes, the particles' measures, buffers between lanes and rows.
//!
//! The equations are in [`crate::substep::scalar`].

use gic_simd::{Call, Lanes, Scalar, prefetch};

use super::block::{BLOCK, Block};
use super::gather::G2pSums;
use super::scatter::P2gRow;
use super::stencils::Stencils;
use crate::laws::law::{Law, LawAdjoint, Rules, Updated};
use crate::laws::with_law;
use crate::math::mat3::{Mat3, each};
use crate::substep::prepared_world::PreparedBody;

/// What the passes over all chunks of a substep share.
#[derive(Clone, Copy)]
pub(super) struct Step<'a> {
    pub(super) body: &'a PreparedBody,
    pub(super) rules: Rules,
    /// Grid spacing [m].
    pub(super) spacing: f64,
    /// Length of the substep [s].
    pub(super) dt: f64,
}

impl Step<'_> {
    /// The factor from tau to its part of A, times dx because offsets are in units of dx.
    fn stress_factor(&self) -> f64 {
        -self.dt * self.body.volume * 4.0 / self.spacing
    }

    /// The factor from C to its part of A, times dx likewise.
    fn inertia_factor(&self) -> f64 {
        self.body.mass * self.spacing
    }

    /// D dx = 4 / dx.
    pub(super) fn apic_factor(&self) -> f64 {
        4.0 / self.spacing
    }

    /// The law over lanes. The match on the material is inside the loops over particles, where it costs nothing, so
    /// that all laws share the compiled transfers.
    #[inline(always)]
    pub(super) fn law<L: Lanes>(&self, c: &Mat3<L>, f: &Mat3<L>) -> Updated<L> {
        let (dt, coefficients, rules) = (L::splat(self.dt), &self.body.coefficients, self.rules);
        with_law!(self.body.material, AnyLaw => {
            let call = Update { law: AnyLaw::<L>::new(coefficients, rules), dt, c, f };
            if <AnyLaw<L> as Law<L>>::LONG { L::outlined(call) } else { call.run() }
        })
    }

    /// The adjoint of the law over lanes.
    #[inline(always)]
    pub(super) fn law_adjoint<L: Lanes>(
        &self,
        c: &Mat3<L>,
        f: &Mat3<L>,
        f_bar: &Mat3<L>,
        tau_bar: &Mat3<L>,
    ) -> LawAdjoint<L> {
        let (dt, coefficients, rules) = (L::splat(self.dt), &self.body.coefficients, self.rules);
        with_law!(self.body.material, AnyLaw => {
            let call = UpdateAdjoint { law: AnyLaw::<L>::new(coefficients, rules), dt, c, f, f_bar, tau_bar };
            if <AnyLaw<L> as Law<L>>::LONG { L::outlined(call) } else { call.run() }
        })
    }

    /// The mass of particles, and the factors from C and tau to their parts of A dx.
    #[inline(always)]
    pub(super) fn measures<L: Lanes>(&self, factor: L) -> Measures<L> {
        Measures {
            mass: L::splat(self.body.mass) * factor,
            inertia: L::splat(self.inertia_factor()) * factor,
            stress: L::splat(self.stress_factor()) * factor,
        }
    }
}

/// What a particle's mass and volume weigh.
pub(super) struct Measures<L> {
    pub(super) mass: L,
    pub(super) inertia: L,
    pub(super) stress: L,
}

impl<L: Lanes> Measures<L> {
    /// `m v` and `A dx`.
    #[inline(always)]
    pub(super) fn momenta(&self, velocity: [L; 3], c: &Mat3<L>, tau: &Mat3<L>) -> ([L; 3], Mat3<L>) {
        let affine = (*c * self.inertia).add_scaled(self.stress, tau);
        (each(velocity, |v| v * self.mass), affine)
    }
}

/// A call of [`Law::update`].
struct Update<'a, L, A> {
    law: A,
    dt: L,
    c: &'a Mat3<L>,
    f: &'a Mat3<L>,
}

impl<L: Lanes, A: Law<L>> Call for Update<'_, L, A> {
    type Output = Updated<L>;

    #[inline(always)]
    fn run(self) -> Updated<L> {
        self.law.update(self.dt, self.c, self.f)
    }
}

/// A call of [`Law::update_adjoint`].
struct UpdateAdjoint<'a, L, A> {
    law: A,
    dt: L,
    c: &'a Mat3<L>,
    f: &'a Mat3<L>,
    f_bar: &'a Mat3<L>,
    tau_bar: &'a Mat3<L>,
}

impl<L: Lanes, A: Law<L>> Call for UpdateAdjoint<'_, L, A> {
    type Output = LawAdjoint<L>;

    #[inline(always)]
    fn run(self) -> LawAdjoint<L> {
        self.law.update_adjoint(self.dt, self.c, self.f, self.f_bar, self.tau_bar)
    }
}

/// Buffers between lanes and rows.
pub(super) struct Scratch<T> {
    pub(super) stencils: Stencils<T>,
    pub(super) row: P2gRow<T>,
    pub(super) sums: G2pSums<T>,
    pub(super) slope_sums: G2pSums<T>,
}

impl<T: Scalar> Scratch<T> {
    pub(super) fn new() -> Self {
        Self { stencils: Stencils::new(), row: P2gRow::new(), sums: G2pSums::new(), slope_sums: G2pSums::new() }
    }
}

/// Where the packs (lanes) of a block start and how many of their particles are real.
#[inline(always)]
pub(super) fn packs<L: Lanes>(block: usize, particles: usize) -> impl Iterator<Item = (usize, usize)> {
    let left = particles - (block * BLOCK).min(particles);
    (0..BLOCK).step_by(L::LANES).take_while(move |&at| at < left).map(move |at| (at, (left - at).min(L::LANES)))
}

/// Asks for the block after `b`, which comes from main memory.
#[inline(always)]
pub(super) fn prefetch_next<T>(blocks: &[Block<T>], b: usize) {
    if let Some(next) = blocks.get(b + 1) {
        prefetch(next);
    }
}
