//! Sixteen f32 with AVX-512F.
//!
//! SAFETY of all intrinsics here: see [`f32_vector`](crate::f32_vector).

use core::arch::x86_64::*;

use crate::f32_vector::{f32_vector, refined_rsqrt};
use crate::polynomial::{Bits, SQRT_HALF};
use crate::vector::Vector;

/// The sign bits of all lanes.
#[inline(always)]
fn sign_bits() -> __m512i {
    // SAFETY: a value of this type exists only where the machine has the instructions.
    unsafe { _mm512_set1_epi32(i32::MIN) }
}

f32_vector! {
    __m512, lanes: 16, mask: __mmask16, features: "avx2,fma,avx512f",
    of: _mm512_set1_ps, load: _mm512_loadu_ps, store: _mm512_storeu_ps,
    unary: { sqrt = _mm512_sqrt_ps, abs = _mm512_abs_ps },
    binary: {
        add = _mm512_add_ps, sub = _mm512_sub_ps, mul = _mm512_mul_ps, div = _mm512_div_ps,
        min = _mm512_min_ps, max = _mm512_max_ps,
    },
    compare: { lt = _mm512_cmp_ps_mask::<_CMP_LT_OQ>, le = _mm512_cmp_ps_mask::<_CMP_LE_OQ> },
    others: {
        #[inline(always)]
        fn neg(self) -> Self {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe { _mm512_castsi512_ps(_mm512_xor_si512(_mm512_castps_si512(self), sign_bits())) }
        }
        #[inline(always)]
        fn mul_add(self, a: Self, b: Self) -> Self {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe { _mm512_fmadd_ps(self, a, b) }
        }
        #[inline(always)]
        fn copysign(self, sign: Self) -> Self {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe {
                let sign = _mm512_and_si512(_mm512_castps_si512(sign), sign_bits());
                _mm512_castsi512_ps(_mm512_or_si512(_mm512_castps_si512(self.abs()), sign))
            }
        }
        #[inline(always)]
        fn floor(self) -> Self {
            // Round towards minus infinity, no exceptions.
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe { _mm512_roundscale_ps::<0x09>(self) }
        }
        #[inline(always)]
        fn rsqrt(self) -> Self {
            // The estimate has 14 bits.
            // SAFETY: a value of this type exists only where the machine has the instructions.
            refined_rsqrt(self, unsafe { _mm512_rsqrt14_ps(self) })
        }
        #[inline(always)]
        fn select(mask: __mmask16, yes: Self, no: Self) -> Self {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe { _mm512_mask_blend_ps(mask, no, yes) }
        }
        #[inline(always)]
        fn and(a: __mmask16, b: __mmask16) -> __mmask16 {
            a & b
        }
        #[inline(always)]
        fn or(a: __mmask16, b: __mmask16) -> __mmask16 {
            a | b
        }
        #[inline(always)]
        fn not(a: __mmask16) -> __mmask16 {
            !a
        }
        #[inline(always)]
        fn bits(mask: __mmask16) -> u32 {
            u32::from(mask)
        }
        #[inline(always)]
        unsafe fn quad(from: *const f32) -> Self {
            // SAFETY: the machine has the instructions, and the caller vouches for the pointer.
            unsafe { _mm512_broadcast_f32x4(_mm_loadu_ps(from)) }
        }
        #[inline(always)]
        unsafe fn spread(from: *const f32) -> Self {
            // SAFETY: the machine has the instructions, and the caller vouches for the pointer.
            unsafe {
                // In each group, pick the element with the group's own number.
                let pick = _mm512_setr_epi32(0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 3, 3, 3, 3);
                _mm512_permutevar_ps(Self::quad(from), pick)
            }
        }
        #[inline(always)]
        unsafe fn strided_quads(from: *const f32, stride: usize) -> Self {
            // SAFETY: the machine has the instructions, and the caller vouches for the pointer.
            unsafe {
                let all = _mm512_castps128_ps512(_mm_loadu_ps(from));
                let all = _mm512_insertf32x4::<1>(all, _mm_loadu_ps(from.add(stride)));
                let all = _mm512_insertf32x4::<2>(all, _mm_loadu_ps(from.add(2 * stride)));
                _mm512_insertf32x4::<3>(all, _mm_loadu_ps(from.add(3 * stride)))
            }
        }
        #[inline(always)]
        fn transpose([a, b, c, d]: [Self; 4]) -> [Self; 4] {
            // SAFETY: a value of this type exists only where the machine has the instructions.
            unsafe {
                let (ab_low, ab_high) = (_mm512_unpacklo_ps(a, b), _mm512_unpackhi_ps(a, b));
                let (cd_low, cd_high) = (_mm512_unpacklo_ps(c, d), _mm512_unpackhi_ps(c, d));
                [
                    _mm512_shuffle_ps::<0x44>(ab_low, cd_low),
                    _mm512_shuffle_ps::<0xee>(ab_low, cd_low),
                    _mm512_shuffle_ps::<0x44>(ab_high, cd_high),
                    _mm512_shuffle_ps::<0xee>(ab_high, cd_high),
                ]
            }
        }
        #[inline(always)]
        unsafe fn store_group_sums([a, b, c, d]: [Self; 4], to: *mut f32) {
            // SAFETY: the machine has the instructions, and the caller vouches for the pointer.
            unsafe {
                // Groups (a0, a1, b0, b1) + (a2, a3, b2, b3), likewise c and d; then even + odd groups.
                let ab = _mm512_shuffle_f32x4::<0x44>(a, b).add(_mm512_shuffle_f32x4::<0xee>(a, b));
                let cd = _mm512_shuffle_f32x4::<0x44>(c, d).add(_mm512_shuffle_f32x4::<0xee>(c, d));
                _mm512_shuffle_f32x4::<0x88>(ab, cd).add(_mm512_shuffle_f32x4::<0xdd>(ab, cd)).store(to);
            }
        }
    }
}

impl Bits for __m512 {
    #[inline(always)]
    fn split(self) -> (Self, Self) {
        // SAFETY: a value of this type exists only where the machine has the instructions.
        unsafe {
            let bits = _mm512_castps_si512(self);
            let e = _mm512_srai_epi32::<23>(_mm512_sub_epi32(bits, _mm512_set1_epi32(SQRT_HALF)));
            let m = _mm512_sub_epi32(bits, _mm512_slli_epi32::<23>(e));
            (_mm512_castsi512_ps(m), _mm512_cvtepi32_ps(e))
        }
    }
    #[inline(always)]
    fn scale(self, n: Self) -> Self {
        // SAFETY: a value of this type exists only where the machine has the instructions.
        unsafe {
            let shift = _mm512_slli_epi32::<23>(_mm512_cvtps_epi32(n));
            _mm512_castsi512_ps(_mm512_add_epi32(_mm512_castps_si512(self), shift))
        }
    }
}
