//! AVX2 and AVX-512.

use super::{Add, Div, Kernel, Lanes, Mul, Neg, Sub};
use std::arch::x86_64::*;

/// # Safety
/// The CPU must have AVX2 and FMA.
#[target_feature(enable = "avx2,fma")]
pub(super) unsafe fn run_avx2<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Avx2>()
}

/// # Safety
/// The CPU must have AVX2, FMA, AVX-512F and AVX-512DQ.
#[target_feature(enable = "avx2,fma,avx512f,avx512dq")]
pub(super) unsafe fn run_avx512<K: Kernel>(kernel: K) -> K::Output {
    kernel.run::<Avx512>()
}

/// Eight numbers in a ymm register; lives only inside [`run_avx2`].
#[derive(Clone, Copy)]
pub(super) struct Avx2(__m256);

/// Sixteen numbers in a zmm register; lives only inside [`run_avx512`].
#[derive(Clone, Copy)]
pub(super) struct Avx512(__m512);

// Every intrinsic below needs a CPU that has it. These types are named only by `run_avx2` and `run_avx512`, whose callers checked the CPU: that is
// meant by "as above".
macro_rules! operators {
    ($type:ident, $add:ident, $sub:ident, $mul:ident, $div:ident, $zero:ident) => {
        impl Add for $type {
            type Output = Self;
            #[inline(always)]
            fn add(self, b: Self) -> Self {
                // SAFETY: the CPU as above.
                Self(unsafe { $add(self.0, b.0) })
            }
        }
        impl Sub for $type {
            type Output = Self;
            #[inline(always)]
            fn sub(self, b: Self) -> Self {
                // SAFETY: the CPU as above.
                Self(unsafe { $sub(self.0, b.0) })
            }
        }
        impl Mul for $type {
            type Output = Self;
            #[inline(always)]
            fn mul(self, b: Self) -> Self {
                // SAFETY: the CPU as above.
                Self(unsafe { $mul(self.0, b.0) })
            }
        }
        impl Div for $type {
            type Output = Self;
            #[inline(always)]
            fn div(self, b: Self) -> Self {
                // SAFETY: the CPU as above.
                Self(unsafe { $div(self.0, b.0) })
            }
        }
        impl Neg for $type {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                // SAFETY: the CPU as above.
                Self(unsafe { $sub($zero(), self.0) })
            }
        }
    };
}
operators!(Avx2, _mm256_add_ps, _mm256_sub_ps, _mm256_mul_ps, _mm256_div_ps, _mm256_setzero_ps);
operators!(Avx512, _mm512_add_ps, _mm512_sub_ps, _mm512_mul_ps, _mm512_div_ps, _mm512_setzero_ps);

impl Lanes for Avx2 {
    const WIDTH: usize = 8;
    type Mask = __m256;
    #[inline(always)]
    fn splat(x: f32) -> Self {
        // SAFETY: the CPU as above.
        Self(unsafe { _mm256_set1_ps(x) })
    }
    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        assert!(from.len() >= 8);
        // SAFETY: the CPU as above; the assertion says that as many numbers are there.
        Self(unsafe { _mm256_loadu_ps(from.as_ptr()) })
    }
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        assert!(to.len() >= 8);
        // SAFETY: the CPU as above; the assertion says that there is room for as many numbers.
        unsafe { _mm256_storeu_ps(to.as_mut_ptr(), self.0) }
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        // SAFETY: the CPU as above.
        Self(unsafe { _mm256_fmadd_ps(self.0, b.0, c.0) })
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        // SAFETY: the CPU as above.
        Self(unsafe { _mm256_min_ps(self.0, b.0) })
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        // SAFETY: the CPU as above.
        Self(unsafe { _mm256_max_ps(self.0, b.0) })
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: the CPU as above.
        Self(unsafe { _mm256_sqrt_ps(self.0) })
    }
    #[inline(always)]
    fn round(self) -> Self {
        // SAFETY: the CPU as above.
        Self(unsafe { _mm256_round_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(self.0) })
    }
    #[inline(always)]
    fn floor(self) -> Self {
        // SAFETY: the CPU as above.
        Self(unsafe { _mm256_floor_ps(self.0) })
    }
    #[inline(always)]
    fn gather_pairs(from: &[u32], at: Self) -> (Self, Self) {
        assert!(!from.is_empty() && from.len() <= i32::MAX as usize);
        // SAFETY: the CPU as above; the indices are held within `from`, which is not empty.
        unsafe {
            let at = _mm256_max_epi32(_mm256_cvttps_epi32(at.0), _mm256_setzero_si256());
            let at = _mm256_min_epi32(at, _mm256_set1_epi32(from.len() as i32 - 1));
            let words = _mm256_i32gather_epi32::<4>(from.as_ptr().cast(), at);
            let low = _mm256_cvtepi32_ps(_mm256_and_si256(words, _mm256_set1_epi32(0xffff)));
            (Self(low), Self(_mm256_cvtepi32_ps(_mm256_srli_epi32::<16>(words))))
        }
    }
    #[inline(always)]
    fn times_power_of_two(self, n: Self) -> Self {
        // SAFETY: the CPU as above.
        unsafe {
            let e = _mm256_slli_epi32::<23>(_mm256_add_epi32(_mm256_cvtps_epi32(n.0), _mm256_set1_epi32(127)));
            Self(_mm256_mul_ps(self.0, _mm256_castsi256_ps(e)))
        }
    }
    #[inline(always)]
    fn split_exponent(self) -> (Self, Self) {
        // SAFETY: the CPU as above.
        unsafe {
            let bits = _mm256_castps_si256(self.0);
            let m = _mm256_or_si256(_mm256_and_si256(bits, _mm256_set1_epi32(0x007f_ffff)), _mm256_set1_epi32(0x3f80_0000));
            let e = _mm256_sub_epi32(_mm256_srli_epi32::<23>(bits), _mm256_set1_epi32(127));
            (Self(_mm256_castsi256_ps(m)), Self(_mm256_cvtepi32_ps(e)))
        }
    }
    #[inline(always)]
    fn ge(self, b: Self) -> __m256 {
        // SAFETY: the CPU as above.
        unsafe { _mm256_cmp_ps::<_CMP_GE_OQ>(self.0, b.0) }
    }
    #[inline(always)]
    fn gt(self, b: Self) -> __m256 {
        // SAFETY: the CPU as above.
        unsafe { _mm256_cmp_ps::<_CMP_GT_OQ>(self.0, b.0) }
    }
    #[inline(always)]
    fn and(a: __m256, b: __m256) -> __m256 {
        // SAFETY: the CPU as above.
        unsafe { _mm256_and_ps(a, b) }
    }
    #[inline(always)]
    fn any(mask: __m256) -> bool {
        // SAFETY: the CPU as above.
        unsafe { _mm256_movemask_ps(mask) != 0 }
    }
    #[inline(always)]
    fn select(mask: __m256, yes: Self, no: Self) -> Self {
        // SAFETY: the CPU as above.
        Self(unsafe { _mm256_blendv_ps(no.0, yes.0, mask) })
    }
    #[inline(always)]
    fn sum(self) -> f32 {
        // SAFETY: the CPU as above.
        unsafe {
            let four = _mm_add_ps(_mm256_castps256_ps128(self.0), _mm256_extractf128_ps::<1>(self.0));
            let two = _mm_add_ps(four, _mm_movehl_ps(four, four));
            _mm_cvtss_f32(_mm_add_ss(two, _mm_shuffle_ps::<1>(two, two)))
        }
    }
    #[inline(always)]
    fn sum4(v: [Self; 4]) -> [f32; 4] {
        let mut out = [0.0; 4];
        // SAFETY: the CPU as above; `out` has room for the four numbers.
        unsafe {
            let pairs = [_mm256_hadd_ps(v[0].0, v[1].0), _mm256_hadd_ps(v[2].0, v[3].0)];
            let fours = _mm256_hadd_ps(pairs[0], pairs[1]);
            let sums = _mm_add_ps(_mm256_castps256_ps128(fours), _mm256_extractf128_ps::<1>(fours));
            _mm_storeu_ps(out.as_mut_ptr(), sums);
        }
        out
    }
}

impl Avx512 {
    /// The lower and the upper half, added.
    #[inline(always)]
    fn halves(self) -> Avx2 {
        // SAFETY: the CPU as above.
        Avx2(unsafe { _mm256_add_ps(_mm512_castps512_ps256(self.0), _mm512_extractf32x8_ps::<1>(self.0)) })
    }
}

impl Lanes for Avx512 {
    const WIDTH: usize = 16;
    type Mask = __mmask16;
    #[inline(always)]
    fn splat(x: f32) -> Self {
        // SAFETY: the CPU as above.
        Self(unsafe { _mm512_set1_ps(x) })
    }
    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        assert!(from.len() >= 16);
        // SAFETY: the CPU as above; the assertion says that as many numbers are there.
        Self(unsafe { _mm512_loadu_ps(from.as_ptr()) })
    }
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        assert!(to.len() >= 16);
        // SAFETY: the CPU as above; the assertion says that there is room for as many numbers.
        unsafe { _mm512_storeu_ps(to.as_mut_ptr(), self.0) }
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        // SAFETY: the CPU as above.
        Self(unsafe { _mm512_fmadd_ps(self.0, b.0, c.0) })
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        // SAFETY: the CPU as above.
        Self(unsafe { _mm512_min_ps(self.0, b.0) })
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        // SAFETY: the CPU as above.
        Self(unsafe { _mm512_max_ps(self.0, b.0) })
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        // SAFETY: the CPU as above.
        Self(unsafe { _mm512_sqrt_ps(self.0) })
    }
    #[inline(always)]
    fn round(self) -> Self {
        // SAFETY: the CPU as above.
        Self(unsafe { _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(self.0) })
    }
    #[inline(always)]
    fn floor(self) -> Self {
        // SAFETY: the CPU as above.
        Self(unsafe { _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(self.0) })
    }
    #[inline(always)]
    fn gather_pairs(from: &[u32], at: Self) -> (Self, Self) {
        assert!(!from.is_empty() && from.len() <= i32::MAX as usize);
        // SAFETY: the CPU as above; the indices are held within `from`, which is not empty.
        unsafe {
            let at = _mm512_max_epi32(_mm512_cvttps_epi32(at.0), _mm512_setzero_si512());
            let at = _mm512_min_epi32(at, _mm512_set1_epi32(from.len() as i32 - 1));
            let words = _mm512_i32gather_epi32::<4>(at, from.as_ptr().cast());
            let low = _mm512_cvtepi32_ps(_mm512_and_si512(words, _mm512_set1_epi32(0xffff)));
            (Self(low), Self(_mm512_cvtepi32_ps(_mm512_srli_epi32::<16>(words))))
        }
    }
    #[inline(always)]
    fn times_power_of_two(self, n: Self) -> Self {
        // SAFETY: the CPU as above.
        Self(unsafe { _mm512_scalef_ps(self.0, n.0) })
    }
    #[inline(always)]
    fn split_exponent(self) -> (Self, Self) {
        // SAFETY: the CPU as above.
        unsafe {
            let m = _mm512_getmant_ps::<_MM_MANT_NORM_1_2, _MM_MANT_SIGN_SRC>(self.0);
            (Self(m), Self(_mm512_getexp_ps(self.0)))
        }
    }
    #[inline(always)]
    fn ge(self, b: Self) -> __mmask16 {
        // SAFETY: the CPU as above.
        unsafe { _mm512_cmp_ps_mask::<_CMP_GE_OQ>(self.0, b.0) }
    }
    #[inline(always)]
    fn gt(self, b: Self) -> __mmask16 {
        // SAFETY: the CPU as above.
        unsafe { _mm512_cmp_ps_mask::<_CMP_GT_OQ>(self.0, b.0) }
    }
    #[inline(always)]
    fn and(a: __mmask16, b: __mmask16) -> __mmask16 {
        a & b
    }
    #[inline(always)]
    fn any(mask: __mmask16) -> bool {
        mask != 0
    }
    #[inline(always)]
    fn select(mask: __mmask16, yes: Self, no: Self) -> Self {
        // SAFETY: the CPU as above.
        Self(unsafe { _mm512_mask_blend_ps(mask, no.0, yes.0) })
    }
    #[inline(always)]
    fn sum(self) -> f32 {
        self.halves().sum()
    }
    #[inline(always)]
    fn sum4(v: [Self; 4]) -> [f32; 4] {
        Avx2::sum4([v[0].halves(), v[1].halves(), v[2].halves(), v[3].halves()])
    }
}
