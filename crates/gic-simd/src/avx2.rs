//! Eight f32 with AVX2 and FMA.
//!
//! SAFETY, for every intrinsic here: it needs AVX2 or FMA, and a value of this type exists only below
//! [`dispatch`](crate::dispatch), which has checked for both. Pointers: as the trait's methods ask of their callers.

use core::arch::x86_64::*;

use crate::Call;
use crate::packed::Vector;
use crate::polynomial::{self, Bits, SQRT_HALF};

impl Vector for __m256 {
    type Scalar = f32;
    type Mask = __m256;
    const LANES: usize = 8;

    #[inline(always)]
    fn of(value: f32) -> Self {
        unsafe { _mm256_set1_ps(value) }
    }
    #[inline(always)]
    unsafe fn load(from: *const f32) -> Self {
        unsafe { _mm256_loadu_ps(from) }
    }
    #[inline(always)]
    unsafe fn store(self, to: *mut f32) {
        unsafe { _mm256_storeu_ps(to, self) }
    }
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        unsafe { _mm256_add_ps(self, b) }
    }
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        unsafe { _mm256_sub_ps(self, b) }
    }
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        unsafe { _mm256_mul_ps(self, b) }
    }
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        unsafe { _mm256_div_ps(self, b) }
    }
    #[inline(always)]
    fn neg(self) -> Self {
        unsafe { _mm256_xor_ps(_mm256_set1_ps(-0.0), self) }
    }
    #[inline(always)]
    fn mul_add(self, a: Self, b: Self) -> Self {
        unsafe { _mm256_fmadd_ps(self, a, b) }
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        unsafe { _mm256_sqrt_ps(self) }
    }
    #[inline(always)]
    fn abs(self) -> Self {
        unsafe { _mm256_andnot_ps(_mm256_set1_ps(-0.0), self) }
    }
    #[inline(always)]
    fn copysign(self, sign: Self) -> Self {
        unsafe { _mm256_or_ps(self.abs(), _mm256_and_ps(_mm256_set1_ps(-0.0), sign)) }
    }
    #[inline(always)]
    fn floor(self) -> Self {
        unsafe { _mm256_floor_ps(self) }
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        unsafe { _mm256_min_ps(self, b) }
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        unsafe { _mm256_max_ps(self, b) }
    }
    #[inline(always)]
    fn exp(self) -> Self {
        polynomial::exp(self)
    }
    #[inline(always)]
    fn ln(self) -> Self {
        polynomial::ln(self)
    }
    #[inline(always)]
    fn recip(self) -> Self {
        Self::of(1.0).div(self)
    }
    #[inline(always)]
    fn rsqrt(self) -> Self {
        // 12 bits, then a Newton step: y (1.5 - x y^2 / 2).
        let y = unsafe { _mm256_rsqrt_ps(self) };
        let half = self.mul(Self::of(-0.5)).mul(y);
        y.mul(half.mul_add(y, Self::of(1.5)))
    }
    #[inline(always)]
    fn lt(self, b: Self) -> Self {
        unsafe { _mm256_cmp_ps::<_CMP_LT_OQ>(self, b) }
    }
    #[inline(always)]
    fn le(self, b: Self) -> Self {
        unsafe { _mm256_cmp_ps::<_CMP_LE_OQ>(self, b) }
    }
    #[inline(always)]
    fn select(mask: Self, yes: Self, no: Self) -> Self {
        unsafe { _mm256_blendv_ps(no, yes, mask) }
    }
    #[inline(always)]
    fn and(a: Self, b: Self) -> Self {
        unsafe { _mm256_and_ps(a, b) }
    }
    #[inline(always)]
    fn or(a: Self, b: Self) -> Self {
        unsafe { _mm256_or_ps(a, b) }
    }
    #[inline(always)]
    fn not(a: Self) -> Self {
        unsafe { _mm256_xor_ps(a, _mm256_castsi256_ps(_mm256_set1_epi32(-1))) }
    }
    #[inline(always)]
    fn bits(mask: Self) -> u32 {
        unsafe { _mm256_movemask_ps(mask) as u32 }
    }
    #[inline(always)]
    fn outlined<C: Call>(call: C) -> C::Output {
        #[inline(never)]
        #[target_feature(enable = "avx2,fma")]
        fn outlined<C: Call>(call: C) -> C::Output {
            call.run()
        }
        unsafe { outlined(call) }
    }
    #[inline(always)]
    unsafe fn quad(from: *const f32) -> Self {
        unsafe {
            let quad = _mm_loadu_ps(from);
            _mm256_set_m128(quad, quad)
        }
    }
    #[inline(always)]
    unsafe fn spread(from: *const f32) -> Self {
        unsafe { _mm256_set_m128(_mm_broadcast_ss(&*from.add(1)), _mm_broadcast_ss(&*from)) }
    }
    #[inline(always)]
    unsafe fn strided_quads(from: *const f32, stride: usize) -> Self {
        unsafe { _mm256_set_m128(_mm_loadu_ps(from.add(stride)), _mm_loadu_ps(from)) }
    }
    #[inline(always)]
    fn transpose([a, b, c, d]: [Self; 4]) -> [Self; 4] {
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
        unsafe {
            // (first groups of a and b) + (second groups of a and b).
            let ab = _mm256_permute2f128_ps::<0x20>(a, b).add(_mm256_permute2f128_ps::<0x31>(a, b));
            let cd = _mm256_permute2f128_ps::<0x20>(c, d).add(_mm256_permute2f128_ps::<0x31>(c, d));
            ab.store(to);
            cd.store(to.add(8));
        }
    }
    #[inline(always)]
    fn broadcast_fourth(self) -> Self {
        unsafe { _mm256_permute_ps::<0xff>(self) }
    }
    #[inline(always)]
    fn with_fourth(self, fourth: Self) -> Self {
        unsafe { _mm256_blend_ps::<0x88>(self, fourth) }
    }
}

impl Bits for __m256 {
    #[inline(always)]
    fn split(self) -> (Self, Self) {
        unsafe {
            let bits = _mm256_castps_si256(self);
            let e = _mm256_srai_epi32::<23>(_mm256_sub_epi32(bits, _mm256_set1_epi32(SQRT_HALF)));
            let m = _mm256_sub_epi32(bits, _mm256_slli_epi32::<23>(e));
            (_mm256_castsi256_ps(m), _mm256_cvtepi32_ps(e))
        }
    }
    #[inline(always)]
    fn scale(self, n: Self) -> Self {
        unsafe {
            let shift = _mm256_slli_epi32::<23>(_mm256_cvtps_epi32(n));
            _mm256_castsi256_ps(_mm256_add_epi32(_mm256_castps_si256(self), shift))
        }
    }
}
