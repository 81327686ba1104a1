//! Numbers, one or many at a time, behind one trait.
//!
//! A formula written once over [`Real`] runs as plain `f64` (the oracle), plain `f32` (the scalar twin) and as SIMD lanes of
//! `f32` (the fast path). [`dispatch`] picks the widest lanes of the machine at run time.

mod level;
mod real;

pub use level::{Kernel, Level, dispatch};
pub use real::Real;
