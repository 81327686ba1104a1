//! Eight f32 with AVX2 and FMA.
//!
//! SAFETY of all intrinsics here: see [`f32_vector`](crate::f32_vector).

use core::arch::x86_64::*;

use crate::f32_vector::{f32_vector, refined_rsqrt};
use crate::polynomial::{Bits, SQRT_HALF};
use crate::vector::Vector;

f32_vector! {
    __m256, lanes: 8, mask: __m256, features: "avx2,fma",
    of: _mm256_set1_ps, load: _mm256_loadu_ps, store: _mm256_storeu_ps,
    unary: { sqrt = _mm256_sqrt_ps, floor = _mm256_floor_ps },
    binary: {
        add = _mm256_add_ps, sub = _mm256_sub_ps, mul = _mm256_mul_ps, div = _mm256_div_ps,
        min = _mm256_min_ps, max = _mm256_max_ps,
    },
    compare: { lt = _mm256_cmp_ps::<_CMP_LT_OQ>, le = _mm256_cmp_ps::<_CMP_LE_OQ> },
    others: {
        #[inline(always)]
        fn neg(self) -> Self {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe { _mm256_xor_ps(_mm256_set1_ps(-0.0), self) }
        }
        #[inline(always)]
        fn mul_add(self, a: Self, b: Self) -> Self {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe { _mm256_fmadd_ps(self, a, b) }
        }
        #[inline(always)]
        fn abs(self) -> Self {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self) }
        }
        #[inline(always)]
        fn copysign(self, sign: Self) -> Self {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe { _mm256_or_ps(self.abs(), _mm256_and_ps(_mm256_set1_ps(-0.0), sign)) }
        }
        #[inline(always)]
        fn rsqrt(self) -> Self {
            // The estimate has 12 bits.
            // SAFETY: a value of this type exists only where the machine has the instructions.
            refined_rsqrt(self, unsafe { _mm256_rsqrt_ps(self) })
        }
        #[inline(always)]
        fn select(mask: Self, yes: Self, no: Self) -> Self {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe { _mm256_blendv_ps(no, yes, mask) }
        }
        #[inline(always)]
        fn and(a: Self, b: Self) -> Self {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe { _mm256_and_ps(a, b) }
        }
        #[inline(always)]
        fn or(a: Self, b: Self) -> Self {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe { _mm256_or_ps(a, b) }
        }
        #[inline(always)]
        fn not(a: Self) -> Self {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe { _mm256_xor_ps(a, _mm256_castsi256_ps(_mm256_set1_epi32(-1))) }
        }
        #[inline(always)]
        fn bits(mask: Self) -> u32 {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe { _mm256_movemask_ps(mask) as u32 }
        }
        #[inline(always)]
        unsafe fn quad(from: *const f32) -> Self {
            // SAFETY: the machine has the instructions, and the caller vouches for the pointer.
            unsafe {
                let quad = _mm_loadu_ps(from);
                _mm256_set_m128(quad, quad)
            }
        }
        #[inline(always)]
        unsafe fn spread(from: *const f32) -> Self {
            // SAFETY: the machine has the instructions, and the caller vouches for the pointer.
            unsafe { _mm256_set_m128(_mm_broadcast_ss(&*from.add(1)), _mm_broadcast_ss(&*from)) }
        }
        #[inline(always)]
        unsafe fn strided_quads(from: *const f32, stride: usize) -> Self {
            // SAFETY: the machine has the instructions, and the caller vouches for the pointer.
            unsafe { _mm256_set_m128(_mm_loadu_ps(from.add(stride)), _mm_loadu_ps(from)) }
        }
        #[inline(always)]
        fn transpose([a, b, c, d]: [Self; 4]) -> [Self; 4] {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe {
                let (ab_low, ab_high) = (_mm256_unpacklo_ps(a, b), _mm256_unpackhi_ps(a, b));
                let (cd_low, cd_high) = (_mm256_unpacklo_ps(c, d), _mm256_unpackhi_ps(c, d));
                [
                    _mm256_shuffle_ps::<0x44>(ab_low, cd_low),
                    _mm256_shuffle_ps::<0xee>(ab_low, cd_low),
                    _mm256_shuffle_ps::<0x44>(ab_high, cd_high),
                    _mm256_shuffle_ps::<0xee>(ab_high, cd_high),
                ]
            }
        }
        #[inline(always)]
        unsafe fn store_group_sums([a, b, c, d]: [Self; 4], to: *mut f32) {
            // SAFETY: the machine has the instructions, and the caller vouches for the pointer.
            unsafe {
                // (first groups of a and b) + (second groups of a and b).
                let ab = _mm256_permute2f128_ps::<0x20>(a, b).add(_mm256_permute2f128_ps::<0x31>(a, b));
                let cd = _mm256_permute2f128_ps::<0x20>(c, d).add(_mm256_permute2f128_ps::<0x31>(c, d));
                ab.store(to);
                cd.store(to.add(8));
            }
        }
    }
}

impl Bits for __m256 {
    #[inline(always)]
    fn split(self) -> (Self, Self) {
        // SAFETY: a value of this type exists only where the machine has the instructions.
        unsafe {
            let bits = _mm256_castps_si256(self);
            let e = _mm256_srai_epi32::<23>(_mm256_sub_epi32(bits, _mm256_set1_epi32(SQRT_HALF)));
            let m = _mm256_sub_epi32(bits, _mm256_slli_epi32::<23>(e));
            (_mm256_castsi256_ps(m), _mm256_cvtepi32_ps(e))
        }
    }
    #[inline(always)]
    fn scale(self, n: Self) -> Self {
        // SAFETY: a value of this type exists only where the machine has the instructions.
        unsafe {
            let shift = _mm256_slli_epi32::<23>(_mm256_cvtps_epi32(n));
            _mm256_castsi256_ps(_mm256_add_epi32(_mm256_castps_si256(self), shift))
        }
    }
}
