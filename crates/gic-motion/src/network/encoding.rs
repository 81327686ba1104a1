//! The frequency encoding of positions and time (paper A.1).

use super::Scalar;

/// How many numbers [`encode`] makes of one coordinate.
pub(super) const fn encoded_len(frequencies: usize) -> usize {
    1 + 2 * frequencies
}

/// Appends `x, sin(2^k pi x), cos(2^k pi x), k = 0 .. frequencies` for one coordinate.
///
/// The paper prints the sines and cosines alone; its release, like NeRF, also passes `x` itself, and so does this. The higher
/// frequencies come from the lower by doubling the angle, in f64, so that one sine and cosine is evaluated per coordinate.
pub(super) fn encode<T: Scalar>(x: T, frequencies: usize, out: &mut [T]) {
    debug_assert_eq!(out.len(), encoded_len(frequencies));
    out[0] = x;
    let (mut sin, mut cos) = (core::f64::consts::PI * x.to_f64()).sin_cos();
    for k in 0..frequencies {
        out[1 + 2 * k] = T::of(sin);
        out[2 + 2 * k] = T::of(cos);
        (sin, cos) = (2.0 * sin * cos, 1.0 - 2.0 * sin * sin);
    }
}

/// Gradient with respect to the coordinate, from the encoding that [`encode`] gave and the gradient with respect to it.
pub(super) fn encode_backward<T: Scalar>(encoded: &[T], gradient: &[T]) -> T {
    let mut total = gradient[0];
    let mut angular = core::f64::consts::PI;
    for (value, slope) in encoded[1..].chunks_exact(2).zip(gradient[1..].chunks_exact(2)) {
        total += T::of(angular) * (value[1] * slope[0] - value[0] * slope[1]);
        angular *= 2.0;
    }
    total
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn doubling_agrees_with_the_formula() {
        for x in [-0.93, -0.2, 0.0, 0.37, 1.0] {
            let mut encoded = [0.0f64; 21];
            encode(x, 10, &mut encoded);
            assert_eq!(encoded[0], x);
            for k in 0..10 {
                let angle = f64::from(1 << k) * core::f64::consts::PI * x;
                assert!((encoded[1 + 2 * k] - angle.sin()).abs() < 1e-11, "sin, x {x}, k {k}");
                assert!((encoded[2 + 2 * k] - angle.cos()).abs() < 1e-11, "cos, x {x}, k {k}");
            }
        }
    }

    #[test]
    fn gradient_agrees_with_finite_differences() {
        let weights: Vec<f64> = (0..13).map(|i| (f64::from(i) * 1.7).sin()).collect();
        let loss = |x: f64| {
            let mut encoded = [0.0; 13];
            encode(x, 6, &mut encoded);
            (encoded.iter().zip(&weights).map(|(e, w)| e * w).sum::<f64>(), encoded)
        };
        for x in [-0.7, 0.11, 0.5] {
            let expected = (loss(x + 1e-6).0 - loss(x - 1e-6).0) / 2e-6;
            let got = encode_backward(&loss(x).1, &weights);
            assert!((got - expected).abs() < 1e-6 * (1.0 + expected.abs()), "x {x}: {got} against {expected}");
        }
    }
}
