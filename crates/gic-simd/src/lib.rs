//! Numbers, one or many at a time, behind one trait.
//!
//! A formula written once over [`Real`] runs as plain `f64` (the oracle), plain `f32` (the scalar twin) and as SIMD
//! lanes of `f32` (the fast path). Code that also moves numbers between memory and lanes is a [`Kernel`], written over
//! [`Lanes`]; [`dispatch`] runs it with the lanes of a [`Level`], and [`oracle`] runs the same code on f64.
//!
//! # Safety of the intrinsics
//!
//! The lanes' operations are safe functions that use instructions which not every machine has. This is sound because
//! the lane types are private to this crate: the only road to one is the type parameter of [`Kernel::run`], and
//! [`dispatch`], the only caller with SIMD lanes, first makes sure that the machine has the level's instructions.
//!
//! # Speed
//!
//! A kernel is fast only if all of its code is inlined into the function that has the level's instructions enabled:
//! mark `run` and what it calls `#[inline(always)]`, and call [`dispatch`] inside each thread's task, not around a
//! parallel iterator (closures that another crate calls are compiled on their own, without the instructions). For the
//! same reason keep lanes out of closures handed to std, as in `array.map`.

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod f32_vector;
mod lanes;
mod level;
mod packed;
mod plain;
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
mod polynomial;
mod prefetch;
mod real;
mod vector;

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(target_arch = "aarch64")]
mod neon;

pub use lanes::{Call, Lanes, MAX_LANES};
pub use level::{Kernel, Level, LevelError, dispatch, oracle};
pub use prefetch::prefetch;
pub use real::{Real, Scalar};
