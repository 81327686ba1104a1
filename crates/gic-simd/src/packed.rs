//! From a machine's vector type to [`Real`] and [`Lanes`], once for all of them.

use core::ops::{Add, AddAssign, Div, DivAssign, Mul, MulAssign, Neg, Sub, SubAssign};

use crate::vector::Vector;
use crate::{Call, Lanes, MAX_LANES, Real, Scalar};

/// Lanes over a vector type.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub(crate) struct Packed<V>(V);

macro_rules! operator {
    ($trait:ident, $method:ident, $assign_trait:ident, $assign_method:ident) => {
        impl<V: Vector> $trait for Packed<V> {
            type Output = Self;
            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                Packed(self.0.$method(other.0))
            }
        }
        impl<V: Vector> $assign_trait for Packed<V> {
            #[inline(always)]
            fn $assign_method(&mut self, other: Self) {
                self.0 = self.0.$method(other.0);
            }
        }
    };
}

operator!(Add, add, AddAssign, add_assign);
operator!(Sub, sub, SubAssign, sub_assign);
operator!(Mul, mul, MulAssign, mul_assign);
operator!(Div, div, DivAssign, div_assign);

impl<V: Vector> Neg for Packed<V> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Packed(self.0.neg())
    }
}

impl<V: Vector> Packed<V> {
    #[inline(always)]
    fn to_array(self) -> [V::Scalar; MAX_LANES] {
        let mut all = [V::Scalar::default(); MAX_LANES];
        self.store(&mut all);
        all
    }
}

impl<V: Vector> Real for Packed<V> {
    type Mask = V::Mask;
    const LANES: usize = V::LANES;

    #[inline(always)]
    fn splat(value: f64) -> Self {
        Packed(V::of(V::Scalar::from_f64(value)))
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        Packed(self.0.mul_add(a.0, b.0))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Packed(self.0.sqrt())
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Packed(self.0.abs())
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        Packed(self.0.copysign(sign.0))
    }
    #[inline(always)]
    fn min(self, other: Self) -> Self {
        Packed(self.0.min(other.0))
    }
    #[inline(always)]
    fn max(self, other: Self) -> Self {
        Packed(self.0.max(other.0))
    }
    #[inline(always)]
    fn floor(self) -> Self {
        Packed(self.0.floor())
    }
    #[inline(always)]
    fn exp(self) -> Self {
        Packed(self.0.exp())
    }
    #[inline(always)]
    fn ln(self) -> Self {
        Packed(self.0.ln())
    }
    #[inline(always)]
    fn recip(self) -> Self {
        Packed(self.0.recip())
    }
    #[inline(always)]
    fn rsqrt(self) -> Self {
        Packed(self.0.rsqrt())
    }
    #[inline(always)]
    fn lt(self, other: Self) -> V::Mask {
        self.0.lt(other.0)
    }
    #[inline(always)]
    fn le(self, other: Self) -> V::Mask {
        self.0.le(other.0)
    }
    #[inline(always)]
    fn select(mask: V::Mask, yes: Self, no: Self) -> Self {
        Packed(V::select(mask, yes.0, no.0))
    }
    #[inline(always)]
    fn and(a: V::Mask, b: V::Mask) -> V::Mask {
        V::and(a, b)
    }
    #[inline(always)]
    fn or(a: V::Mask, b: V::Mask) -> V::Mask {
        V::or(a, b)
    }
    #[inline(always)]
    fn not(a: V::Mask) -> V::Mask {
        V::not(a)
    }
    #[inline(always)]
    fn bits(mask: V::Mask) -> u32 {
        V::bits(mask)
    }
    #[inline(always)]
    fn sum_lanes(self) -> f64 {
        let all = self.to_array();
        let mut sum = 0.0;
        for i in 0..V::LANES {
            sum += all[i].to_f64();
        }
        sum
    }
    #[inline(always)]
    fn lane(self, index: usize) -> f64 {
        self.to_array()[..V::LANES][index].to_f64()
    }
}

impl<V: Vector> Lanes for Packed<V> {
    type Scalar = V::Scalar;
    const GROUPS: usize = V::LANES / 4;

    #[inline(always)]
    fn outlined<C: Call>(call: C) -> C::Output {
        V::outlined(call)
    }
    #[inline(always)]
    fn of(value: V::Scalar) -> Self {
        Packed(V::of(value))
    }
    #[inline(always)]
    unsafe fn load_at(from: *const V::Scalar) -> Self {
        // SAFETY: the caller keeps the same contract.
        Packed(unsafe { V::load(from) })
    }
    #[inline(always)]
    unsafe fn store_at(self, to: *mut V::Scalar) {
        // SAFETY: the caller keeps the same contract.
        unsafe { self.0.store(to) }
    }
    #[inline(always)]
    unsafe fn quad_at(from: *const V::Scalar) -> Self {
        // SAFETY: the caller keeps the same contract.
        Packed(unsafe { V::quad(from) })
    }
    #[inline(always)]
    unsafe fn spread_at(from: *const V::Scalar) -> Self {
        // SAFETY: the caller keeps the same contract.
        Packed(unsafe { V::spread(from) })
    }
    #[inline(always)]
    unsafe fn strided_quads_at(from: *const V::Scalar, stride: usize) -> Self {
        // SAFETY: the caller keeps the same contract.
        Packed(unsafe { V::strided_quads(from, stride) })
    }
    #[inline(always)]
    fn transpose([a, b, c, d]: [Self; 4]) -> [Self; 4] {
        // Not std's `map`: it would compile its closure on its own, without the level's instructions.
        let [a, b, c, d] = V::transpose([a.0, b.0, c.0, d.0]);
        [Packed(a), Packed(b), Packed(c), Packed(d)]
    }
    #[inline(always)]
    unsafe fn store_group_sums_at([a, b, c, d]: [Self; 4], to: *mut V::Scalar) {
        // SAFETY: the caller keeps the same contract.
        unsafe { V::store_group_sums([a.0, b.0, c.0, d.0], to) }
    }
}
