//! Four plain numbers as a vector: the level without SIMD, and the f64 oracle.

use crate::vector::Vector;
use crate::{Call, Scalar};

#[inline(always)]
fn zip<T: Copy, U: Copy + Default>(a: [T; 4], b: [T; 4], f: impl Fn(T, T) -> U) -> [U; 4] {
    let mut out = [U::default(); 4];
    for i in 0..4 {
        out[i] = f(a[i], b[i]);
    }
    out
}

impl<T: Scalar> Vector for [T; 4] {
    type Scalar = T;
    type Mask = [bool; 4];
    const LANES: usize = 4;

    #[inline(always)]
    fn of(value: T) -> Self {
        [value; 4]
    }
    #[inline(always)]
    unsafe fn load(from: *const T) -> Self {
        // SAFETY: readable for four numbers, says the caller; unaligned is fine.
        unsafe { from.cast::<[T; 4]>().read_unaligned() }
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut T) {
        // SAFETY: writable for four numbers, says the caller; unaligned is fine.
        unsafe { to.cast::<[T; 4]>().write_unaligned(self) }
    }
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        zip(self, b, |a, b| a + b)
    }
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        zip(self, b, |a, b| a - b)
    }
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        zip(self, b, |a, b| a * b)
    }
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        zip(self, b, |a, b| a / b)
    }
    #[inline(always)]
    fn neg(self) -> Self {
        self.map(|a| -a)
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        self.mul(a).add(b)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        self.map(T::sqrt)
    }
    #[inline(always)]
    fn abs(self) -> Self {
        self.map(T::abs)
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        zip(self, sign, T::copysign)
    }
    #[inline(always)]
    fn floor(self) -> Self {
        self.map(T::floor)
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        zip(self, b, T::min)
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        zip(self, b, T::max)
    }
    #[inline(always)]
    fn exp(self) -> Self {
        self.map(T::exp)
    }
    #[inline(always)]
    fn ln(self) -> Self {
        self.map(T::ln)
    }
    #[inline(always)]
    fn recip(self) -> Self {
        self.map(T::recip)
    }
    #[inline(always)]
    fn rsqrt(self) -> Self {
        self.map(T::rsqrt)
    }
    #[inline(always)]
    fn lt(self, b: Self) -> [bool; 4] {
        zip(self, b, T::lt)
    }
    #[inline(always)]
    fn le(self, b: Self) -> [bool; 4] {
        zip(self, b, T::le)
    }
    #[inline(always)]
    fn select(mask: [bool; 4], yes: Self, no: Self) -> Self {
        let mut out = no;
        for i in 0..4 {
            out[i] = T::select(mask[i], yes[i], no[i]);
        }
        out
    }
    #[inline(always)]
    fn and(a: [bool; 4], b: [bool; 4]) -> [bool; 4] {
        zip(a, b, |a, b| a & b)
    }
    #[inline(always)]
    fn or(a: [bool; 4], b: [bool; 4]) -> [bool; 4] {
        zip(a, b, |a, b| a | b)
    }
    #[inline(always)]
    fn not(a: [bool; 4]) -> [bool; 4] {
        a.map(|a| !a)
    }
    #[inline(always)]
    fn bits(mask: [bool; 4]) -> u32 {
        (0..4).fold(0, |bits, i| bits | (u32::from(mask[i]) << i))
    }
    #[inline(never)]
    fn outlined<C: Call>(call: C) -> C::Output {
        call.run()
    }
    #[inline(always)]
    unsafe fn quad(from: *const T) -> Self {
        // SAFETY: readable for four numbers, says the caller.
        unsafe { Self::load(from) }
    }
    #[inline(always)]
    unsafe fn spread(from: *const T) -> Self {
        // SAFETY: readable for four numbers, says the caller.
        [unsafe { *from }; 4]
    }
    #[inline(always)]
    unsafe fn strided_quads(from: *const T, _stride: usize) -> Self {
        // SAFETY: readable for four numbers, says the caller.
        unsafe { Self::load(from) }
    }
    #[inline(always)]
    fn transpose(rows: [Self; 4]) -> [Self; 4] {
        [0, 1, 2, 3].map(|q| [rows[0][q], rows[1][q], rows[2][q], rows[3][q]])
    }
    #[inline(always)]
    unsafe fn store_group_sums(rows: [Self; 4], to: *mut T) {
        for (q, row) in rows.into_iter().enumerate() {
            // SAFETY: writable for 16 numbers, says the caller.
            unsafe { row.store(to.add(4 * q)) }
        }
    }
}
