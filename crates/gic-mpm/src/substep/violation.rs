//! Why a substep cannot be completed.

use gic_simd::Scalar;
use glam::DVec3;

use super::state::State;

/// Why a segment cannot be completed.
#[derive(Clone, Debug)]
pub(crate) struct Violation {
    pub(crate) kind: ViolationKind,
    pub(crate) particle: usize,
    pub(crate) position: DVec3,
    pub(crate) velocity: DVec3,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum ViolationKind {
    /// |v| dt > dx or NaN: shorter substeps may help.
    TooFast,
    /// Outside of what a grid can hold: nothing helps.
    LeftDomain(&'static str),
}

impl Violation {
    pub(crate) fn too_fast<R: Scalar>(state: &State<R>, particle: usize) -> Self {
        Self::new(ViolationKind::TooFast, state, particle)
    }

    pub(crate) fn left_domain<R: Scalar>(state: &State<R>, particle: usize, reason: &'static str) -> Self {
        Self::new(ViolationKind::LeftDomain(reason), state, particle)
    }

    fn new<R: Scalar>(kind: ViolationKind, state: &State<R>, particle: usize) -> Self {
        Self { kind, particle, position: state.position_of(particle), velocity: state.velocity_of(particle) }
    }
}
