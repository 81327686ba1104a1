//! Which lanes this machine has, and running a kernel on them.

use crate::Real;

/// A set of SIMD instructions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Level {
    /// Plain `f32`, one at a time: the twin that the others are tested against.
    Scalar,
}

/// Code that runs over any lanes; write `run` with `#[inline(always)]`, all that it calls likewise.
pub trait Kernel {
    /// What the kernel returns.
    type Output;
    /// Runs the kernel with lanes `L` of f32.
    fn run<L: Real>(self) -> Self::Output;
}

/// Runs a kernel with the lanes of a level.
pub fn dispatch<K: Kernel>(level: Level, kernel: K) -> K::Output {
    match level {
        Level::Scalar => kernel.run::<f32>(),
    }
}
