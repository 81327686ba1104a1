//! The scalar trait and its two plain instances.

use core::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// A real number, or lanes of them that do the same thing at once.
///
/// Comparisons give a [`Real::Mask`] (one flag per lane) instead of a `bool`: code over `Real` selects, it does not branch.
pub trait Real:
    Copy
    + Send
    + Sync
    + core::fmt::Debug
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + SubAssign
    + MulAssign
    + DivAssign
    + 'static
{
    /// One flag per lane.
    type Mask: Copy;
    /// How many numbers are in a value.
    const LANES: usize;

    /// The same number in every lane.
    fn splat(value: f64) -> Self;
    /// `self * a + b`, fused where the machine can.
    fn mul_add(self, a: Self, b: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// The smaller of two; a NaN in `self` gives `other`.
    fn min(self, other: Self) -> Self;
    /// The larger of two; a NaN in `self` gives `other`.
    fn max(self, other: Self) -> Self;
    /// The largest whole number not above.
    fn floor(self) -> Self;
    /// Natural exponential; lanes of f32 are accurate to 2 ulp for |x| < 80 and clamp outside.
    fn exp(self) -> Self;
    /// Natural logarithm; accurate to 2 ulp for positive normal numbers.
    fn ln(self) -> Self;
    /// `self < other`; false for NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// `self <= other`; false for NaN.
    fn le(self, other: Self) -> Self::Mask;
    /// `if mask { yes } else { no }`, lane by lane.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    /// Whether any lane's flag is set.
    fn any(mask: Self::Mask) -> bool;
    /// Sum over the lanes in a fixed order, in f64.
    fn sum_lanes(self) -> f64;
    /// The number in a lane.
    fn lane(self, index: usize) -> f64;

    /// Zero in every lane.
    #[inline(always)]
    fn zero() -> Self {
        Self::splat(0.0)
    }
    /// One in every lane.
    #[inline(always)]
    fn one() -> Self {
        Self::splat(1.0)
    }
}

macro_rules! plain_real {
    ($t:ty) => {
        impl Real for $t {
            type Mask = bool;
            const LANES: usize = 1;

            #[inline(always)]
            fn splat(value: f64) -> Self {
                value as $t
            }
            #[inline(always)]
            fn mul_add(self, a: Self, b: Self) -> Self {
                // Not `mul_add` of std: without FMA hardware that is a slow library call.
                self * a + b
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                <$t>::sqrt(self)
            }
            #[inline(always)]
            fn abs(self) -> Self {
                <$t>::abs(self)
            }
            #[inline(always)]
            fn min(self, other: Self) -> Self {
                if self < other { self } else { other }
            }
            #[inline(always)]
            fn max(self, other: Self) -> Self {
                if self > other { self } else { other }
            }
            #[inline(always)]
            fn floor(self) -> Self {
                <$t>::floor(self)
            }
            #[inline(always)]
            fn exp(self) -> Self {
                <$t>::exp(self)
            }
            #[inline(always)]
            fn ln(self) -> Self {
                <$t>::ln(self)
            }
            #[inline(always)]
            fn lt(self, other: Self) -> bool {
                self < other
            }
            #[inline(always)]
            fn le(self, other: Self) -> bool {
                self <= other
            }
            #[inline(always)]
            fn select(mask: bool, yes: Self, no: Self) -> Self {
                if mask { yes } else { no }
            }
            #[inline(always)]
            fn any(mask: bool) -> bool {
                mask
            }
            #[inline(always)]
            fn sum_lanes(self) -> f64 {
                f64::from(self)
            }
            #[inline(always)]
            fn lane(self, _index: usize) -> f64 {
                f64::from(self)
            }
        }
    };
}

plain_real!(f32);
plain_real!(f64);
