//! Four f32 with NEON.
//!
//! SAFETY of all intrinsics here: see [`f32_vector`](crate::f32_vector).

use core::arch::aarch64::*;

use crate::f32_vector::f32_vector;
use crate::polynomial::{Bits, SQRT_HALF};
use crate::vector::Vector;

f32_vector! {
    float32x4_t, lanes: 4, mask: uint32x4_t, features: "neon",
    of: vdupq_n_f32, load: vld1q_f32, store: vst1q_f32,
    unary: { neg = vnegq_f32, sqrt = vsqrtq_f32, abs = vabsq_f32, floor = vrndmq_f32 },
    binary: { add = vaddq_f32, sub = vsubq_f32, mul = vmulq_f32, div = vdivq_f32 },
    compare: { lt = vcltq_f32, le = vcleq_f32 },
    others: {
        #[inline(always)]
        fn mul_add(self, a: Self, b: Self) -> Self {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe { vfmaq_f32(b, self, a) }
        }
        #[inline(always)]
        fn copysign(self, sign: Self) -> Self {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe { vbslq_f32(vdupq_n_u32(0x8000_0000), sign, self) }
        }
        #[inline(always)]
        fn min(self, b: Self) -> Self {
            // Not vminq: that gives NaN for a NaN on either side.
            Self::select(self.lt(b), self, b)
        }
        #[inline(always)]
        fn max(self, b: Self) -> Self {
            Self::select(b.lt(self), self, b)
        }
        #[inline(always)]
        fn rsqrt(self) -> Self {
            Self::of(1.0).div(self.sqrt())
        }
        #[inline(always)]
        fn select(mask: uint32x4_t, yes: Self, no: Self) -> Self {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe { vbslq_f32(mask, yes, no) }
        }
        #[inline(always)]
        fn and(a: uint32x4_t, b: uint32x4_t) -> uint32x4_t {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe { vandq_u32(a, b) }
        }
        #[inline(always)]
        fn or(a: uint32x4_t, b: uint32x4_t) -> uint32x4_t {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe { vorrq_u32(a, b) }
        }
        #[inline(always)]
        fn not(a: uint32x4_t) -> uint32x4_t {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe { vmvnq_u32(a) }
        }
        #[inline(always)]
        fn bits(mask: uint32x4_t) -> u32 {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe {
                let weights = vld1q_u32([1, 2, 4, 8].as_ptr());
                vaddvq_u32(vandq_u32(mask, weights))
            }
        }
        #[inline(always)]
        unsafe fn quad(from: *const f32) -> Self {
            // SAFETY: the machine has the instructions, and the caller vouches for the pointer.
            unsafe { vld1q_f32(from) }
        }
        #[inline(always)]
        unsafe fn spread(from: *const f32) -> Self {
            // SAFETY: the machine has the instructions, and the caller vouches for the pointer.
            unsafe { vld1q_dup_f32(from) }
        }
        #[inline(always)]
        unsafe fn strided_quads(from: *const f32, _stride: usize) -> Self {
            // SAFETY: the machine has the instructions, and the caller vouches for the pointer.
            unsafe { vld1q_f32(from) }
        }
        #[inline(always)]
        fn transpose([a, b, c, d]: [Self; 4]) -> [Self; 4] {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe {
                // (a0, c0, a1, c1), (a2, c2, a3, c3), likewise b and d; then interleave those.
                let (ac_low, ac_high) = (vzip1q_f32(a, c), vzip2q_f32(a, c));
                let (bd_low, bd_high) = (vzip1q_f32(b, d), vzip2q_f32(b, d));
                [
                    vzip1q_f32(ac_low, bd_low),
                    vzip2q_f32(ac_low, bd_low),
                    vzip1q_f32(ac_high, bd_high),
                    vzip2q_f32(ac_high, bd_high),
                ]
            }
        }
        #[inline(always)]
        unsafe fn store_group_sums([a, b, c, d]: [Self; 4], to: *mut f32) {
            // SAFETY: the machine has the instructions, and the caller vouches for the pointer.
            unsafe {
                a.store(to);
                b.store(to.add(4));
                c.store(to.add(8));
                d.store(to.add(12));
            }
        }
    }
}

impl Bits for float32x4_t {
    #[inline(always)]
    fn split(self) -> (Self, Self) {
        // SAFETY: a value of this type exists only where the machine has the instructions.
        unsafe {
            let bits = vreinterpretq_s32_f32(self);
            let e = vshrq_n_s32::<23>(vsubq_s32(bits, vdupq_n_s32(SQRT_HALF)));
            let m = vsubq_s32(bits, vshlq_n_s32::<23>(e));
            (vreinterpretq_f32_s32(m), vcvtq_f32_s32(e))
        }
    }
    #[inline(always)]
    fn scale(self, n: Self) -> Self {
        // SAFETY: a value of this type exists only where the machine has the instructions.
        unsafe {
            let shift = vshlq_n_s32::<23>(vcvtnq_s32_f32(n));
            vreinterpretq_f32_s32(vaddq_s32(vreinterpretq_s32_f32(self), shift))
        }
    }
}
