//! What a machine's vector type must be able to do, and most of it from one intrinsic each.

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

/// Implements [`Vector`] for a vector of f32: the operations that are one intrinsic by its name, then the others.
///
/// SAFETY of the expansion: an intrinsic needs the instructions named in `features`, and a value of the type exists
/// only below [`dispatch`](crate::dispatch), which has checked for them. Pointers: as the trait's methods ask of their
/// callers.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
macro_rules! f32_vector {
    (
        $vector:ty, lanes: $lanes:literal, mask: $mask:ty, features: $features:literal,
        of: $of:ident, load: $load:ident, store: $store:ident,
        unary: { $($unary:ident = $unary_op:expr),* $(,)? },
        binary: { $($binary:ident = $binary_op:expr),* $(,)? },
        compare: { $($compare:ident = $compare_op:expr),* $(,)? },
        others: { $($others:tt)* }
    ) => {
        impl Vector for $vector {
            type Scalar = f32;
            type Mask = $mask;
            const LANES: usize = $lanes;

            #[inline(always)]
            fn of(value: f32) -> Self {
                unsafe { $of(value) }
            }
            #[inline(always)]
            unsafe fn load(from: *const f32) -> Self {
                unsafe { $load(from) }
            }
            #[inline(always)]
            unsafe fn store(self, to: *mut f32) {
                unsafe { $store(to, self) }
            }
            $(
                #[inline(always)]
                fn $unary(self) -> Self {
                    unsafe { $unary_op(self) }
                }
            )*
            $(
                #[inline(always)]
                fn $binary(self, b: Self) -> Self {
                    unsafe { $binary_op(self, b) }
                }
            )*
            $(
                #[inline(always)]
                fn $compare(self, b: Self) -> $mask {
                    unsafe { $compare_op(self, b) }
                }
            )*
            #[inline(always)]
            fn exp(self) -> Self {
                crate::polynomial::exp(self)
            }
            #[inline(always)]
            fn ln(self) -> Self {
                crate::polynomial::ln(self)
            }
            #[inline(always)]
            fn recip(self) -> Self {
                Self::of(1.0).div(self)
            }
            #[inline(always)]
            fn outlined<C: $crate::Call>(call: C) -> C::Output {
                #[inline(never)]
                #[target_feature(enable = $features)]
                fn outlined<C: $crate::Call>(call: C) -> C::Output {
                    call.run()
                }
                unsafe { outlined(call) }
            }
            $($others)*
        }
    };
}
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
pub(crate) use f32_vector;

/// `1 / sqrt(x)` from an estimate y of it, by one Newton step: `y (3/2 - x y^2 / 2)`.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
pub(crate) fn refined_rsqrt<V: Vector<Scalar = f32>>(x: V, estimate: V) -> V {
    let half = x.mul(V::of(-0.5)).mul(estimate);
    estimate.mul(half.mul_add(estimate, V::of(1.5)))
}
