//! Exponential and logarithm of f32 lanes, from their power series on a reduced range.

use crate::vector::Vector;

/// Access to the bits of f32 lanes.
pub(crate) trait Bits: Vector<Scalar = f32> {
    /// `(m, e)` with `self = m 2^e`, m in [sqrt(1/2), sqrt(2)), e a whole number; for positive normal numbers.
    ///
    /// In integers: `e = (bits - SQRT_HALF) >> 23` (arithmetic), `m = bits - (e << 23)`.
    fn split(self) -> (Self, Self);
    /// `self 2^n` for a whole number n, as long as neither it nor the result is zero, subnormal or infinite.
    fn scale(self, n: Self) -> Self;
}

/// The bits of sqrt(1/2).
pub(crate) const SQRT_HALF: i32 = 0x3f35_04f3;

/// ln 2 = HI + LO; HI has few enough bits that `n * HI` is exact for the exponents of f32.
const LN2_HI: f32 = 355.0 / 512.0;
const LN2_LO: f32 = -2.121_944_4e-4;

/// exp(x) = 2^n exp(r), n = round(x / ln 2), |r| <= ln(2)/2, with the Taylor series of exp(r) to r^7 (next term: 5e-9
/// relative).
#[inline(always)]
pub(crate) fn exp<V: Bits>(x: V) -> V {
    // The bounds come first, so that a NaN in x gets through both.
    let x = V::of(88.0).min(V::of(-87.0).max(x));
    let n = x.mul_add(V::of(core::f32::consts::LOG2_E), V::of(0.5)).floor();
    let r = n.mul_add(V::of(-LN2_HI), x);
    let r = n.mul_add(V::of(-LN2_LO), r);
    let mut series = V::of(1.0 / 5040.0);
    for factorial in [720.0_f32, 120.0, 24.0, 6.0, 2.0] {
        series = series.mul_add(r, V::of(1.0 / factorial));
    }
    let result = series.mul_add(r.mul(r), r).add(V::of(1.0)).scale(n);
    V::select(x.le(x), result, x)
}

/// ln(m 2^e) = e ln 2 + ln(1 + f), f = m - 1; with s = f / (2 + f), ln(1 + f) = 2 atanh(s) = f - s (f - R),
/// R = 2 (s^2/3 + s^4/5 + s^6/7 + s^8/9 ...), |s| <= 0.172 (next term: 4e-9 relative).
#[inline(always)]
pub(crate) fn ln<V: Bits>(x: V) -> V {
    let (m, e) = x.split();
    let f = m.sub(V::of(1.0));
    let s = f.div(f.add(V::of(2.0)));
    let z = s.mul(s);
    let mut series = V::of(2.0 / 9.0);
    for odd in [7.0_f32, 5.0, 3.0] {
        series = series.mul_add(z, V::of(2.0 / odd));
    }
    let correction = s.mul(f.sub(series.mul(z)));
    let small = e.mul(V::of(LN2_LO)).sub(correction);
    let result = e.mul_add(V::of(LN2_HI), f.add(small));
    let normal = V::and(V::of(f32::MIN_POSITIVE).le(x), x.le(V::of(f32::MAX)));
    V::select(normal, result, V::of(f32::NAN))
}
