//! Eigen-decomposition of symmetric 3x3 matrices, branch-free, so that it runs in SIMD lanes.

use gic_simd::Real;

use crate::math::mat3::Mat3;

/// `A = Q diag(values) Q^T`; the eigenvectors are the columns of Q, in no particular order.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Eigen<R> {
    pub(crate) values: [R; 3],
    pub(crate) vectors: Mat3<R>,
}

impl<R: Real> Eigen<R> {
    /// Cyclic Jacobi rotations. Convergence is quadratic: four sweeps reach the last bits of f64 for any spread of
    /// eigenvalues, and three mostly do in f32; a sweep is left out where what it would remove is below the rounding in
    /// all lanes.
    #[inline(always)]
    pub(crate) fn of_symmetric(a: &Mat3<R>) -> Self {
        let mut s =
            Packed { diagonal: [a.at(0, 0), a.at(1, 1), a.at(2, 2)], off: [a.at(1, 2), a.at(0, 2), a.at(0, 1)] };
        let mut vectors = Mat3::identity();
        for _ in 0..4 {
            if !s.is_coupled() {
                break;
            }
            s.rotate::<0, 1, 2>(&mut vectors);
            s.rotate::<0, 2, 1>(&mut vectors);
            s.rotate::<1, 2, 0>(&mut vectors);
        }
        Eigen { values: s.diagonal, vectors }
    }

    /// `Q diag(d) Q^T`.
    #[inline(always)]
    pub(crate) fn compose(&self, d: [R; 3]) -> Mat3<R> {
        let scaled = Mat3::from_fn(|i, j| self.vectors.at(i, j) * d[j]);
        scaled.times_transposed(&self.vectors)
    }

    /// `Q M Q^T`.
    #[inline(always)]
    pub(crate) fn rotate_out(&self, m: &Mat3<R>) -> Mat3<R> {
        self.vectors.times(m).times_transposed(&self.vectors)
    }

    /// `Q^T M Q`.
    #[inline(always)]
    pub(crate) fn rotate_in(&self, m: &Mat3<R>) -> Mat3<R> {
        self.vectors.transposed_times(m).times(&self.vectors)
    }
}

/// A symmetric matrix; `off[k]` is the element in neither row nor column k.
struct Packed<R> {
    diagonal: [R; 3],
    off: [R; 3],
}

impl<R: Real> Packed<R> {
    /// Whether the elements off the diagonal still count beside the trace, in any lane.
    #[inline(always)]
    fn is_coupled(&self) -> bool {
        let trace = self.diagonal[0] + self.diagonal[1] + self.diagonal[2];
        let off = self.off[0].abs() + self.off[1].abs() + self.off[2].abs();
        // A NaN counts as done: more sweeps would not help it.
        R::any(trace.lt(trace + off))
    }

    /// Rotates the plane (P, Q) so that its off-diagonal element vanishes; K is the third axis. The columns of
    /// `vectors` follow.
    ///
    /// With d = a_qq - a_pp, h = sqrt(d^2 + 4 a_pq^2), the angle is below 45 degrees where cos(2 angle) = |d| / h,
    /// sin(2 angle) = 2 a_pq sign(d) / h. By half-angle formulas, without divisions: this chain is what a decomposition
    /// waits for.
    #[inline(always)]
    fn rotate<const P: usize, const Q: usize, const K: usize>(&mut self, vectors: &mut Mat3<R>) {
        let apq = self.off[K];
        let d = self.diagonal[Q] - self.diagonal[P];
        // The bound is far below the rounding of eigenvalues near one, and its square still a normal f32: h is never
        // zero, and without coupling the angle is.
        let size = d.abs().max(R::splat(1e-15));
        let twice = apq + apq;
        let hypotenuse_recip = size.mul_add(size, twice * twice).rsqrt();
        let half = R::splat(0.5);
        let cos_squared = (size * half).mul_add(hypotenuse_recip, half);
        let cos_recip = cos_squared.rsqrt();
        let cos = cos_squared * cos_recip;
        let sin = (apq * R::one().copysign(d)) * (hypotenuse_recip * cos_recip);
        let tan = sin * cos_recip;

        self.diagonal[P] -= tan * apq;
        self.diagonal[Q] = tan.mul_add(apq, self.diagonal[Q]);
        self.off[K] = R::zero();
        // a_pk is off[Q], a_qk is off[P].
        let (apk, aqk) = (self.off[Q], self.off[P]);
        self.off[Q] = cos * apk - sin * aqk;
        self.off[P] = sin.mul_add(apk, cos * aqk);
        for i in 0..3 {
            let (vp, vq) = (vectors.at(i, P), vectors.at(i, Q));
            vectors.0[3 * i + P] = cos * vp - sin * vq;
            vectors.0[3 * i + Q] = sin.mul_add(vp, cos * vq);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn largest(m: &Mat3<f64>) -> f64 {
        m.0.iter().fold(0.0, |largest, x| x.abs().max(largest))
    }

    fn widen<R: Real>(m: &Mat3<R>) -> Mat3<f64> {
        Mat3(m.0.map(|x| x.lane(0)))
    }

    /// Checks A = Q diag Q^T and Q^T Q = I to `tolerance` times the largest eigenvalue.
    fn check<R: Real>(a: &Mat3<f64>, tolerance: f64) {
        let eigen = Eigen::of_symmetric(&Mat3(a.0.map(R::splat)));
        let q = widen(&eigen.vectors);
        let back = Eigen { values: [0.0; 3], vectors: q }.compose(eigen.values.map(|x| x.lane(0)));
        assert!(largest(&(back - *a)) <= tolerance * largest(a), "{a:?} became {back:?}");
        let orthogonal = q.transposed_times(&q) - Mat3::identity();
        assert!(largest(&orthogonal) <= tolerance, "{a:?}: eigenvectors {q:?}");
    }

    fn check_both(a: &Mat3<f64>) {
        check::<f64>(a, 1e-14);
        check::<f32>(a, 3e-6);
    }

    #[test]
    fn coinciding_eigenvalues_are_no_exception() {
        check_both(&Mat3::identity());
        check_both(&Mat3::diagonal([2.0, 2.0, 0.5]));
        check_both(&Mat3::diagonal([1.0, 1.0 + 1e-12, 1.0 - 1e-12]));
        // 1 + 2 n n^T with n = (1, 1, 1) / sqrt 3: eigenvalues 1, 1, 3.
        check_both(&Mat3::from_fn(|i, j| 2.0 / 3.0 + if i == j { 1.0 } else { 0.0 }));
        check_both(&Mat3::from_fn(|_, _| 1.0));
    }

    #[test]
    fn a_decomposition_of_the_identity_is_exact() {
        let eigen = Eigen::of_symmetric(&Mat3::<f32>::identity());
        assert_eq!(eigen.values, [1.0; 3]);
        assert_eq!(eigen.vectors.0, Mat3::<f32>::identity().0);
    }

    proptest! {
        #[test]
        fn decompositions_multiply_back(f in prop::array::uniform9(-1.5_f64..1.5)) {
            let f = Mat3(f);
            check_both(&f.times_transposed(&f));
        }

        #[test]
        fn decompositions_near_the_identity_multiply_back(
            f in prop::array::uniform9(-1.0_f64..1.0), size in -12.0_f64..-1.0,
        ) {
            let f = Mat3::identity().add_scaled(10.0_f64.powf(size), &Mat3(f));
            check_both(&f.times_transposed(&f));
        }
    }
}
