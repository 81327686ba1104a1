//! What a machine's vector type must be able to do.

use crate::{Call, Scalar};

/// What a vector type must be able to do; see [`Real`](crate::Real) and [`Lanes`](crate::Lanes) for what each means.
pub(crate) trait Vector: Copy + Send + Sync + core::fmt::Debug + 'static {
    type Scalar: Scalar;
    type Mask: Copy;
    const LANES: usize;

    fn of(value: Self::Scalar) -> Self;
    unsafe fn load(from: *const Self::Scalar) -> Self;
    unsafe fn store(self, to: *mut Self::Scalar);

    fn add(self, b: Self) -> Self;
    fn sub(self, b: Self) -> Self;
    fn mul(self, b: Self) -> Self;
    fn div(self, b: Self) -> Self;
    fn neg(self) -> Self;
    fn mul_add(self, a: Self, b: Self) -> Self;
    fn sqrt(self) -> Self;
    fn abs(self) -> Self;
    fn copysign(self, sign: Self) -> Self;
    fn floor(self) -> Self;
    fn min(self, b: Self) -> Self;
    fn max(self, b: Self) -> Self;
    fn exp(self) -> Self;
    fn ln(self) -> Self;
    fn recip(self) -> Self;
    fn rsqrt(self) -> Self;

    fn lt(self, b: Self) -> Self::Mask;
    fn le(self, b: Self) -> Self::Mask;
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn not(a: Self::Mask) -> Self::Mask;
    fn bits(mask: Self::Mask) -> u32;

    fn outlined<C: Call>(call: C) -> C::Output;
    unsafe fn quad(from: *const Self::Scalar) -> Self;
    unsafe fn spread(from: *const Self::Scalar) -> Self;
    unsafe fn strided_quads(from: *const Self::Scalar, stride: usize) -> Self;
    fn transpose(rows: [Self; 4]) -> [Self; 4];
    unsafe fn store_group_sums(rows: [Self; 4], to: *mut Self::Scalar);
}
