//! The frequency encoding of positions and time (paper A.1).

use super::Scalar;

/// Frequencies of one coordinate and how strong each is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Encoding {
    pub(super) frequencies: usize,
    /// Amplitude of each frequency relative to the one below.
    pub(super) falloff: f64,
}

impl Encoding {
    /// How many numbers one coordinate becomes.
    pub(super) const fn len(self) -> usize {
        1 + 2 * self.frequencies
    }

    /// Writes `x` and `a^k sin(2^k pi x), a^k cos(2^k pi x), k = 0 .. frequencies` for one coordinate, a the falloff.
    ///
    /// The paper prints the sines and cosines alone, with a = 1; its release, like NeRF, also passes `x` itself, and so
    /// does this. The higher frequencies come from the lower by doubling the angle, in f64, so that one sine and one
    /// cosine are evaluated per coordinate.
    pub(super) fn encode<T: Scalar>(self, x: T, out: &mut [T]) {
        debug_assert_eq!(out.len(), self.len());
        out[0] = x;
        let (mut sin, mut cos) = (core::f64::consts::PI * x.to_f64()).sin_cos();
        let mut amplitude = 1.0;
        for pair in out[1..].chunks_exact_mut(2) {
            pair[0] = T::of(amplitude * sin);
            pair[1] = T::of(amplitude * cos);
            (sin, cos) = (2.0 * sin * cos, 1.0 - 2.0 * sin * sin);
            amplitude *= self.falloff;
        }
    }
}

/// Gradient with respect to the coordinate, from the encoding that [`Encoding::encode`] gave and the gradient with
/// respect to it.
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
            Encoding { frequencies: 10, falloff: 0.5 }.encode(x, &mut encoded);
            assert_eq!(encoded[0], x);
            for k in 0..10 {
                let angle = f64::from(1 << k) * core::f64::consts::PI * x;
                let amplitude = 0.5f64.powi(k);
                let at = 1 + 2 * k as usize;
                assert!((encoded[at] - amplitude * angle.sin()).abs() < 1e-11, "sin, x {x}, k {k}");
                assert!((encoded[at + 1] - amplitude * angle.cos()).abs() < 1e-11, "cos, x {x}, k {k}");
            }
        }
    }

    #[test]
    fn gradient_agrees_with_finite_differences() {
        let weights: Vec<f64> = (0..13).map(|i| (f64::from(i) * 1.7).sin()).collect();
        let loss = |x: f64| {
            let mut encoded = [0.0; 13];
            Encoding { frequencies: 6, falloff: 0.8 }.encode(x, &mut encoded);
            (encoded.iter().zip(&weights).map(|(e, w)| e * w).sum::<f64>(), encoded)
        };
        for x in [-0.7, 0.11, 0.5] {
            let expected = (loss(x + 1e-6).0 - loss(x - 1e-6).0) / 2e-6;
            let got = encode_backward(&loss(x).1, &weights);
            assert!((got - expected).abs() < 1e-6 * (1.0 + expected.abs()), "x {x}: {got} against {expected}");
        }
    }
}
