//! The quadratic B-spline stencil: which 3 x 3 x 3 nodes a particle touches, and with what weights.
//!
//! Lengths are in units of the grid spacing. Along one axis a particle at `x` touches the nodes `base .. base + 3` with
//! `base = floor(x - 1/2)`; `offset = x - base` lies in [1/2, 3/2).

use gic_simd::Real;

/// How far a particle's stencil reaches [cells]: what comes nearer to an obstacle touches it.
pub const STENCIL_REACH_CELLS: f64 = 1.5;

/// The first of the three nodes that a particle at `x` touches, and the particle's offset from it.
#[inline(always)]
pub(crate) fn base_and_offset<R: Real>(x: R) -> (R, R) {
    let base = (x - R::splat(0.5)).floor();
    (base, x - base)
}

/// Weights of the three nodes; they sum to 1 and reproduce linear functions.
#[inline(always)]
pub(crate) fn weights<R: Real>(offset: R) -> [R; 3] {
    let half = R::splat(0.5);
    let (a, b, c) = (R::splat(1.5) - offset, offset - R::one(), offset - half);
    [half * a * a, R::splat(0.75) - b * b, half * c * c]
}

/// Derivatives of [`weights`] with respect to the offset.
#[inline(always)]
pub(crate) fn slopes<R: Real>(offset: R) -> [R; 3] {
    let c = offset - R::splat(0.5);
    [offset - R::splat(1.5), R::splat(2.0) - offset - offset, c]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn weights_partition_unity_and_reproduce_position(x in -50.0f64..50.0) {
            let (base, offset) = base_and_offset(x);
            let w = weights(offset);
            prop_assert!((0.5..1.5).contains(&offset));
            prop_assert!((w.iter().sum::<f64>() - 1.0).abs() < 1e-14);
            let mean: f64 = (0..3).map(|i| w[i] * (base + i as f64)).sum();
            prop_assert!((mean - x).abs() < 1e-12);
            // The second moment of the kernel, 1/4, is what makes 4 / dx^2 the APIC factor.
            let second: f64 = (0..3).map(|i| w[i] * (base + i as f64 - x).powi(2)).sum();
            prop_assert!((second - 0.25).abs() < 1e-12);
        }

        #[test]
        fn slopes_are_the_derivative_of_the_weights(offset in 0.5f64..1.5) {
            let h = 1e-6;
            let (plus, minus, slope) = (weights(offset + h), weights(offset - h), slopes(offset));
            for i in 0..3 {
                prop_assert!(((plus[i] - minus[i]) / (2.0 * h) - slope[i]).abs() < 1e-9);
            }
        }
    }
}
