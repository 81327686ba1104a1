//! 3x3 matrices over any [`Real`].

use core::ops::{Add, AddAssign, Mul, Sub};

use gic_simd::Real;

/// A 3x3 matrix, row-major: element (i, j) is `m[3 * i + j]`.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mat3<R>(pub(crate) [R; 9]);

impl<R: Real> Mat3<R> {
    /// All zeros.
    #[inline(always)]
    pub(crate) fn zero() -> Self {
        Mat3([R::zero(); 9])
    }

    /// The identity.
    #[inline(always)]
    pub(crate) fn identity() -> Self {
        Self::diagonal([R::one(); 3])
    }

    /// A diagonal matrix.
    #[inline(always)]
    pub(crate) fn diagonal(d: [R; 3]) -> Self {
        let z = R::zero();
        Mat3([d[0], z, z, z, d[1], z, z, z, d[2]])
    }

    /// Element (row, column).
    #[inline(always)]
    pub(crate) fn at(&self, row: usize, column: usize) -> R {
        self.0[3 * row + column]
    }

    /// The matrix with each element `f(i, j)`.
    #[inline(always)]
    pub(crate) fn from_fn(f: impl Fn(usize, usize) -> R) -> Self {
        let mut m = [R::zero(); 9];
        for i in 0..3 {
            for j in 0..3 {
                m[3 * i + j] = f(i, j);
            }
        }
        Mat3(m)
    }

    /// `self^T`.
    #[inline(always)]
    pub(crate) fn transpose(&self) -> Self {
        Self::from_fn(|i, j| self.at(j, i))
    }

    /// `self + self^T`.
    #[inline(always)]
    pub(crate) fn plus_transpose(&self) -> Self {
        Self::from_fn(|i, j| self.at(i, j) + self.at(j, i))
    }

    /// `(self + self^T) / 2`.
    #[inline(always)]
    pub(crate) fn symmetric_part(&self) -> Self {
        self.plus_transpose() * R::splat(0.5)
    }

    /// `self * other`.
    #[inline(always)]
    pub(crate) fn times(&self, other: &Self) -> Self {
        Self::from_fn(|i, j| dot(self.row(i), other.column(j)))
    }

    /// `self * other^T`.
    #[inline(always)]
    pub(crate) fn times_transposed(&self, other: &Self) -> Self {
        Self::from_fn(|i, j| dot(self.row(i), other.row(j)))
    }

    /// `self^T * other`.
    #[inline(always)]
    pub(crate) fn transposed_times(&self, other: &Self) -> Self {
        Self::from_fn(|i, j| dot(self.column(i), other.column(j)))
    }

    /// `self * v`.
    #[inline(always)]
    pub(crate) fn times_vec(&self, v: [R; 3]) -> [R; 3] {
        [dot(self.row(0), v), dot(self.row(1), v), dot(self.row(2), v)]
    }

    /// `self + scale * other`.
    #[inline(always)]
    pub(crate) fn add_scaled(&self, scale: R, other: &Self) -> Self {
        Self::from_fn(|i, j| scale.mul_add(other.at(i, j), self.at(i, j)))
    }

    /// `self + value * identity`.
    #[inline(always)]
    pub(crate) fn add_diagonal(&self, value: R) -> Self {
        let mut m = *self;
        for i in 0..3 {
            m.0[4 * i] += value;
        }
        m
    }

    /// Sum of the diagonal.
    #[inline(always)]
    pub(crate) fn trace(&self) -> R {
        self.0[0] + self.0[4] + self.0[8]
    }

    /// Sum of the products of equal elements, `tr(self^T other)`.
    #[inline(always)]
    pub(crate) fn double_dot(&self, other: &Self) -> R {
        let mut sum = self.0[0] * other.0[0];
        for i in 1..9 {
            sum = self.0[i].mul_add(other.0[i], sum);
        }
        sum
    }

    /// The cofactor matrix, `det(self) self^-T`: the derivative of [`Mat3::det`].
    #[inline(always)]
    pub(crate) fn cofactor(&self) -> Self {
        let m = &self.0;
        let minor = |a: usize, b: usize, c: usize, d: usize| m[a] * m[b] - m[c] * m[d];
        Mat3([
            minor(4, 8, 5, 7),
            minor(5, 6, 3, 8),
            minor(3, 7, 4, 6),
            minor(2, 7, 1, 8),
            minor(0, 8, 2, 6),
            minor(1, 6, 0, 7),
            minor(1, 5, 2, 4),
            minor(2, 3, 0, 5),
            minor(0, 4, 1, 3),
        ])
    }

    /// The determinant.
    #[inline(always)]
    pub(crate) fn det(&self) -> R {
        let m = &self.0;
        let c = [m[4] * m[8] - m[5] * m[7], m[5] * m[6] - m[3] * m[8], m[3] * m[7] - m[4] * m[6]];
        dot(self.row(0), c)
    }

    #[inline(always)]
    fn row(&self, i: usize) -> [R; 3] {
        [self.0[3 * i], self.0[3 * i + 1], self.0[3 * i + 2]]
    }

    #[inline(always)]
    fn column(&self, j: usize) -> [R; 3] {
        [self.0[j], self.0[3 + j], self.0[6 + j]]
    }
}

impl<R: Real> Add for Mat3<R> {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        Self::from_fn(|i, j| self.at(i, j) + other.at(i, j))
    }
}

impl<R: Real> AddAssign for Mat3<R> {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

impl<R: Real> Sub for Mat3<R> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        Self::from_fn(|i, j| self.at(i, j) - other.at(i, j))
    }
}

impl<R: Real> Mul<R> for Mat3<R> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, scale: R) -> Self {
        Self::from_fn(|i, j| self.at(i, j) * scale)
    }
}

/// `values.map(f)` for lanes: std's `map` would compile the closure on its own, without the level's instructions. Only
/// for closures of a few operations: the compiler would do the same to a long one (write a loop instead).
#[inline(always)]
pub(crate) fn each<A: Copy, B>(values: [A; 3], f: impl Fn(A) -> B) -> [B; 3] {
    [f(values[0]), f(values[1]), f(values[2])]
}

#[inline(always)]
fn dot<R: Real>(a: [R; 3], b: [R; 3]) -> R {
    a[0].mul_add(b[0], a[1].mul_add(b[1], a[2] * b[2]))
}

#[cfg(test)]
mod tests {
    use super::*;

    const A: Mat3<f64> = Mat3([2.0, -1.0, 0.5, 0.3, 1.7, -0.2, 0.9, 0.4, 1.1]);
    const B: Mat3<f64> = Mat3([1.0, 0.2, -0.5, 0.7, 0.6, 0.1, -0.3, 2.0, 1.4]);

    fn close(a: &Mat3<f64>, b: &Mat3<f64>) {
        for i in 0..9 {
            assert!((a.0[i] - b.0[i]).abs() < 1e-14, "element {i}: {} against {}", a.0[i], b.0[i]);
        }
    }

    #[test]
    fn transposed_products_agree_with_explicit_transposes() {
        close(&A.times_transposed(&B), &A.times(&B.transpose()));
        close(&A.transposed_times(&B), &A.transpose().times(&B));
        close(&A.times(&B).transpose(), &B.transpose().times(&A.transpose()));
    }

    #[test]
    fn the_cofactor_matrix_inverts() {
        close(&A.times_transposed(&A.cofactor()), &Mat3::diagonal([A.det(); 3]));
        assert!((A.times(&B).det() - A.det() * B.det()).abs() < 1e-14);
    }

    #[test]
    fn double_dot_is_the_trace_of_the_product() {
        assert!((A.double_dot(&B) - A.transposed_times(&B).trace()).abs() < 1e-14);
    }
}
