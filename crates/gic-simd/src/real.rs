//! The scalar trait and its two plain instances.

use core::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

/// A real number, or lanes of them that do the same thing at once.
///
/// Comparisons give a [`Real::Mask`] (one flag per lane) instead of a `bool`: code over `Real` selects, it does not
/// branch.
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
    /// Natural exponential. SIMD lanes are accurate to 2 ulp for x in [-87, 88] and clamp x to it; NaN stays NaN.
    fn exp(self) -> Self;
    /// Natural logarithm. SIMD lanes are accurate to 2 ulp for positive normal numbers; anything else gives a NaN
    /// (plain numbers give minus infinity for zero).
    fn ln(self) -> Self;
    /// The size of `self` with the sign of `sign`.
    fn copysign(self, sign: Self) -> Self;
    /// `self < other`; false for NaN.
    fn lt(self, other: Self) -> Self::Mask;
    /// `self <= other`; false for NaN.
    fn le(self, other: Self) -> Self::Mask;
    /// `if mask { yes } else { no }`, lane by lane.
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    /// Both flags, lane by lane.
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// At least one of the flags, lane by lane.
    fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// The opposite flag, lane by lane.
    fn not(a: Self::Mask) -> Self::Mask;
    /// The flags as bits, lane 0 lowest.
    fn bits(mask: Self::Mask) -> u32;
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
    /// Whether any lane's flag is set.
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        Self::bits(mask) != 0
    }
    /// `1 / self`, to 2 ulp.
    #[inline(always)]
    fn recip(self) -> Self {
        Self::one() / self
    }
    /// `1 / sqrt(self)` for positive normal numbers, to 3 ulp.
    #[inline(always)]
    fn rsqrt(self) -> Self {
        Self::one() / self.sqrt()
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
            fn copysign(self, sign: Self) -> Self {
                <$t>::copysign(self, sign)
            }
            #[inline(always)]
            fn and(a: bool, b: bool) -> bool {
                a & b
            }
            #[inline(always)]
            fn or(a: bool, b: bool) -> bool {
                a | b
            }
            #[inline(always)]
            fn not(a: bool) -> bool {
                !a
            }
            #[inline(always)]
            fn bits(mask: bool) -> u32 {
                u32::from(mask)
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

/// A plain number: f32 or f64.
pub trait Scalar: Real<Mask = bool> + Default {
    /// The number in f64.
    fn to_f64(self) -> f64;
    /// The nearest number of this type.
    fn from_f64(value: f64) -> Self;
}

impl Scalar for f32 {
    #[inline(always)]
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        value as f32
    }
}

impl Scalar for f64 {
    #[inline(always)]
    fn to_f64(self) -> f64 {
        self
    }
    #[inline(always)]
    fn from_f64(value: f64) -> Self {
        value
    }
}
