//! Several f32 numbers at a time, and the choice of the instruction set at run time.
//!
//! A kernel is written once over [`Lanes`] and compiled three times: for any CPU, for AVX2 + FMA and for AVX-512. Sums over lanes and
//! fused multiply-adds round differently between the three, so bytes may differ between machines; never between thread counts.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// `WIDTH` f32 numbers. Comparisons with NaN are false.
pub(crate) trait Lanes:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// How many.
    const WIDTH: usize;
    /// One truth value per lane.
    type Mask: Copy;
    /// `x` in every lane.
    fn splat(x: f32) -> Self;
    /// The first `WIDTH` numbers of `from`.
    fn load(from: &[f32]) -> Self;
    /// Writes the first `WIDTH` numbers of `to`.
    fn store(self, to: &mut [f32]);
    /// `self · b + c`, fused where the instruction set fuses.
    fn mul_add(self, b: Self, c: Self) -> Self;
    fn min(self, other: Self) -> Self;
    fn max(self, other: Self) -> Self;
    fn sqrt(self) -> Self;
    /// Nearest integer, ties to even.
    fn round(self) -> Self;
    /// Largest integer that is not larger.
    fn floor(self) -> Self;
    /// The lower and the upper 16 bits of `from[at]` as numbers. `at` holds integers; those beyond the ends are held inside.
    fn gather_pairs(from: &[u32], at: Self) -> (Self, Self);
    /// `self · 2^n` of integral n in [-126, 127].
    fn times_power_of_two(self, n: Self) -> Self;
    /// (mantissa in [1, 2), exponent) of positive normal numbers.
    fn split_exponent(self) -> (Self, Self);
    fn ge(self, other: Self) -> Self::Mask;
    fn gt(self, other: Self) -> Self::Mask;
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    fn any(mask: Self::Mask) -> bool;
    fn select(mask: Self::Mask, yes: Self, no: Self) -> Self;
    /// Sum of the lanes, in a fixed order.
    fn sum(self) -> f32;
    /// The sums of four at once, which costs about half of four single sums where the hardware adds neighbours.
    #[inline(always)]
    fn sum4(v: [Self; 4]) -> [f32; 4] {
        [v[0].sum(), v[1].sum(), v[2].sum(), v[3].sum()]
    }

    /// `2^x`; relative error below 2.4e-7 for x in [-125, 127], clamped below.
    #[inline(always)]
    fn exp2(self) -> Self {
        self.max(Self::splat(-125.0)).exp2_in_range()
    }

    /// [`Self::exp2`] for x in [-125, 127]; elsewhere the result means nothing.
    #[inline(always)]
    fn exp2_in_range(self) -> Self {
        // The polynomial of degree 5 nearest to 2^f for |f| ≤ 1/2 in relative error: 7.5e-8, the rest is rounding.
        let n = self.round();
        let f = self - n;
        let mut p = Self::splat(1.327_647_2e-3);
        p = p.mul_add(f, Self::splat(9.675_541e-3));
        p = p.mul_add(f, Self::splat(5.550_713e-2));
        p = p.mul_add(f, Self::splat(0.240_221_2));
        p = p.mul_add(f, Self::splat(0.693_146_94));
        p = p.mul_add(f, Self::splat(1.000_000_1));
        p.times_power_of_two(n)
    }

    /// `e^x`.
    #[inline(always)]
    fn exp(self) -> Self {
        (self * Self::splat(std::f32::consts::LOG2_E)).min(Self::splat(126.0)).exp2()
    }

    /// Natural logarithm of positive normal numbers; absolute error below 1e-6 (1 + |ln x|).
    #[inline(always)]
    fn ln(self) -> Self {
        // ln m = 2 artanh((m − 1)/(m + 1)), m in [1/√2, √2) after moving one factor of two.
        let (m, e) = self.split_exponent();
        let high = m.gt(Self::splat(std::f32::consts::SQRT_2));
        let m = Self::select(high, m * Self::splat(0.5), m);
        let e = Self::select(high, e + Self::splat(1.0), e);
        let s = (m - Self::splat(1.0)) / (m + Self::splat(1.0));
        let s2 = s * s;
        let p = Self::splat(1.0 / 9.0)
            .mul_add(s2, Self::splat(1.0 / 7.0))
            .mul_add(s2, Self::splat(1.0 / 5.0))
            .mul_add(s2, Self::splat(1.0 / 3.0))
            .mul_add(s2, Self::splat(1.0));
        e.mul_add(Self::splat(std::f32::consts::LN_2), (s + s) * p)
    }
}

/// Work that can run at any lane width. `run` must be `#[inline(always)]`, and so must all it calls with lanes.
pub(crate) trait Kernel {
    type Output;
    fn run<L: Lanes>(self) -> Self::Output;
}

/// An instruction set this machine has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Isa {
    Portable,
    #[cfg(target_arch = "x86_64")]
    Avx2,
    #[cfg(target_arch = "x86_64")]
    Avx512,
}

impl Isa {
    /// The widest one there is.
    pub(crate) fn detect() -> Self {
        static WIDEST: std::sync::LazyLock<Isa> = std::sync::LazyLock::new(|| *Isa::available().last().unwrap_or(&Isa::Portable));
        *WIDEST
    }

    /// All that this machine has, narrowest first.
    pub(crate) fn available() -> Vec<Self> {
        #[allow(unused_mut)]
        let mut found = vec![Self::Portable];
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma");
            if avx2 {
                found.push(Self::Avx2);
            }
            if avx2 && is_x86_feature_detected!("avx512f") && is_x86_feature_detected!("avx512dq") {
                found.push(Self::Avx512);
            }
        }
        found
    }

    /// Runs a kernel with this instruction set.
    #[inline]
    pub(crate) fn dispatch<K: Kernel>(self, kernel: K) -> K::Output {
        match self {
            Self::Portable => kernel.run::<Portable>(),
            // SAFETY: `Isa::detect` and `Isa::available` are the only makers of these values, and they asked the CPU.
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => unsafe { x86::run_avx2(kernel) },
            // SAFETY: as above.
            #[cfg(target_arch = "x86_64")]
            Self::Avx512 => unsafe { x86::run_avx512(kernel) },
        }
    }
}

/// Eight numbers in an array: what a compiler can make of it for any CPU.
#[derive(Clone, Copy)]
pub(crate) struct Portable([f32; 8]);

macro_rules! portable_operator {
    ($trait:ident, $method:ident) => {
        impl $trait for Portable {
            type Output = Self;
            #[inline(always)]
            fn $method(mut self, other: Self) -> Self {
                for i in 0..8 {
                    self.0[i] = $trait::$method(self.0[i], other.0[i]);
                }
                self
            }
        }
    };
}
portable_operator!(Add, add);
portable_operator!(Sub, sub);
portable_operator!(Mul, mul);
portable_operator!(Div, div);

impl Neg for Portable {
    type Output = Self;
    #[inline(always)]
    fn neg(mut self) -> Self {
        for x in &mut self.0 {
            *x = -*x;
        }
        self
    }
}

impl Lanes for Portable {
    const WIDTH: usize = 8;
    type Mask = [bool; 8];
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self([x; 8])
    }
    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        let mut out = [0.0; 8];
        out.copy_from_slice(&from[..8]);
        Self(out)
    }
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        to[..8].copy_from_slice(&self.0);
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        self * b + c
    }
    #[inline(always)]
    fn min(mut self, other: Self) -> Self {
        for i in 0..8 {
            self.0[i] = if self.0[i] < other.0[i] { self.0[i] } else { other.0[i] };
        }
        self
    }
    #[inline(always)]
    fn max(mut self, other: Self) -> Self {
        for i in 0..8 {
            self.0[i] = if self.0[i] > other.0[i] { self.0[i] } else { other.0[i] };
        }
        self
    }
    #[inline(always)]
    fn sqrt(mut self) -> Self {
        for x in &mut self.0 {
            *x = x.sqrt();
        }
        self
    }
    #[inline(always)]
    fn round(mut self) -> Self {
        // Adding 1.5·2^23 leaves no bits for a fraction; exact for |x| < 2^22, and exponents are far below.
        const MAGIC: f32 = 12_582_912.0;
        for x in &mut self.0 {
            *x = (*x + MAGIC) - MAGIC;
        }
        self
    }
    #[inline(always)]
    fn floor(mut self) -> Self {
        for x in &mut self.0 {
            *x = x.floor();
        }
        self
    }
    #[inline(always)]
    fn gather_pairs(from: &[u32], at: Self) -> (Self, Self) {
        let (mut low, mut high) = ([0.0; 8], [0.0; 8]);
        for i in 0..8 {
            let word = from[(at.0[i].max(0.0) as usize).min(from.len() - 1)];
            (low[i], high[i]) = ((word & 0xffff) as f32, (word >> 16) as f32);
        }
        (Self(low), Self(high))
    }
    #[inline(always)]
    fn times_power_of_two(mut self, n: Self) -> Self {
        for i in 0..8 {
            self.0[i] *= f32::from_bits(((n.0[i] as i32 + 127) as u32) << 23);
        }
        self
    }
    #[inline(always)]
    fn split_exponent(self) -> (Self, Self) {
        let (mut m, mut e) = ([0.0; 8], [0.0; 8]);
        for i in 0..8 {
            let bits = self.0[i].to_bits();
            m[i] = f32::from_bits((bits & 0x007f_ffff) | 0x3f80_0000);
            e[i] = ((bits >> 23) & 0xff) as f32 - 127.0;
        }
        (Self(m), Self(e))
    }
    #[inline(always)]
    fn ge(self, other: Self) -> [bool; 8] {
        let mut out = [false; 8];
        for i in 0..8 {
            out[i] = self.0[i] >= other.0[i];
        }
        out
    }
    #[inline(always)]
    fn gt(self, other: Self) -> [bool; 8] {
        let mut out = [false; 8];
        for i in 0..8 {
            out[i] = self.0[i] > other.0[i];
        }
        out
    }
    #[inline(always)]
    fn and(mut a: [bool; 8], b: [bool; 8]) -> [bool; 8] {
        for i in 0..8 {
            a[i] &= b[i];
        }
        a
    }
    #[inline(always)]
    fn any(mask: [bool; 8]) -> bool {
        let mut out = false;
        for m in mask {
            out |= m;
        }
        out
    }
    #[inline(always)]
    fn select(mask: [bool; 8], yes: Self, mut no: Self) -> Self {
        for i in 0..8 {
            no.0[i] = if mask[i] { yes.0[i] } else { no.0[i] };
        }
        no
    }
    #[inline(always)]
    fn sum(self) -> f32 {
        let a = self.0;
        ((a[0] + a[4]) + (a[2] + a[6])) + ((a[1] + a[5]) + (a[3] + a[7]))
    }
}

#[cfg(target_arch = "x86_64")]
mod x86 {
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

    // SAFETY of every intrinsic below: these types are named only by `run_avx2` and `run_avx512`, whose callers checked the CPU.
    macro_rules! operators {
        ($type:ident, $add:ident, $sub:ident, $mul:ident, $div:ident, $zero:ident) => {
            impl Add for $type {
                type Output = Self;
                #[inline(always)]
                fn add(self, b: Self) -> Self {
                    Self(unsafe { $add(self.0, b.0) })
                }
            }
            impl Sub for $type {
                type Output = Self;
                #[inline(always)]
                fn sub(self, b: Self) -> Self {
                    Self(unsafe { $sub(self.0, b.0) })
                }
            }
            impl Mul for $type {
                type Output = Self;
                #[inline(always)]
                fn mul(self, b: Self) -> Self {
                    Self(unsafe { $mul(self.0, b.0) })
                }
            }
            impl Div for $type {
                type Output = Self;
                #[inline(always)]
                fn div(self, b: Self) -> Self {
                    Self(unsafe { $div(self.0, b.0) })
                }
            }
            impl Neg for $type {
                type Output = Self;
                #[inline(always)]
                fn neg(self) -> Self {
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
            Self(unsafe { _mm256_set1_ps(x) })
        }
        #[inline(always)]
        fn load(from: &[f32]) -> Self {
            assert!(from.len() >= 8);
            Self(unsafe { _mm256_loadu_ps(from.as_ptr()) })
        }
        #[inline(always)]
        fn store(self, to: &mut [f32]) {
            assert!(to.len() >= 8);
            unsafe { _mm256_storeu_ps(to.as_mut_ptr(), self.0) }
        }
        #[inline(always)]
        fn mul_add(self, b: Self, c: Self) -> Self {
            Self(unsafe { _mm256_fmadd_ps(self.0, b.0, c.0) })
        }
        #[inline(always)]
        fn min(self, b: Self) -> Self {
            Self(unsafe { _mm256_min_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn max(self, b: Self) -> Self {
            Self(unsafe { _mm256_max_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            Self(unsafe { _mm256_sqrt_ps(self.0) })
        }
        #[inline(always)]
        fn round(self) -> Self {
            Self(unsafe { _mm256_round_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(self.0) })
        }
        #[inline(always)]
        fn floor(self) -> Self {
            Self(unsafe { _mm256_floor_ps(self.0) })
        }
        #[inline(always)]
        fn gather_pairs(from: &[u32], at: Self) -> (Self, Self) {
            assert!(!from.is_empty() && from.len() <= i32::MAX as usize);
            unsafe {
                let at = _mm256_max_epi32(_mm256_cvttps_epi32(at.0), _mm256_setzero_si256());
                let at = _mm256_min_epi32(at, _mm256_set1_epi32(from.len() as i32 - 1));
                // Every index is inside `from`.
                let words = _mm256_i32gather_epi32::<4>(from.as_ptr().cast(), at);
                let low = _mm256_cvtepi32_ps(_mm256_and_si256(words, _mm256_set1_epi32(0xffff)));
                (Self(low), Self(_mm256_cvtepi32_ps(_mm256_srli_epi32::<16>(words))))
            }
        }
        #[inline(always)]
        fn times_power_of_two(self, n: Self) -> Self {
            unsafe {
                let e = _mm256_slli_epi32::<23>(_mm256_add_epi32(_mm256_cvtps_epi32(n.0), _mm256_set1_epi32(127)));
                Self(_mm256_mul_ps(self.0, _mm256_castsi256_ps(e)))
            }
        }
        #[inline(always)]
        fn split_exponent(self) -> (Self, Self) {
            unsafe {
                let bits = _mm256_castps_si256(self.0);
                let m = _mm256_or_si256(_mm256_and_si256(bits, _mm256_set1_epi32(0x007f_ffff)), _mm256_set1_epi32(0x3f80_0000));
                let e = _mm256_sub_epi32(_mm256_srli_epi32::<23>(bits), _mm256_set1_epi32(127));
                (Self(_mm256_castsi256_ps(m)), Self(_mm256_cvtepi32_ps(e)))
            }
        }
        #[inline(always)]
        fn ge(self, b: Self) -> __m256 {
            unsafe { _mm256_cmp_ps::<_CMP_GE_OQ>(self.0, b.0) }
        }
        #[inline(always)]
        fn gt(self, b: Self) -> __m256 {
            unsafe { _mm256_cmp_ps::<_CMP_GT_OQ>(self.0, b.0) }
        }
        #[inline(always)]
        fn and(a: __m256, b: __m256) -> __m256 {
            unsafe { _mm256_and_ps(a, b) }
        }
        #[inline(always)]
        fn any(mask: __m256) -> bool {
            unsafe { _mm256_movemask_ps(mask) != 0 }
        }
        #[inline(always)]
        fn select(mask: __m256, yes: Self, no: Self) -> Self {
            Self(unsafe { _mm256_blendv_ps(no.0, yes.0, mask) })
        }
        #[inline(always)]
        fn sum(self) -> f32 {
            unsafe {
                let four = _mm_add_ps(_mm256_castps256_ps128(self.0), _mm256_extractf128_ps::<1>(self.0));
                let two = _mm_add_ps(four, _mm_movehl_ps(four, four));
                _mm_cvtss_f32(_mm_add_ss(two, _mm_shuffle_ps::<1>(two, two)))
            }
        }
        #[inline(always)]
        fn sum4(v: [Self; 4]) -> [f32; 4] {
            let mut out = [0.0; 4];
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
            Avx2(unsafe { _mm256_add_ps(_mm512_castps512_ps256(self.0), _mm512_extractf32x8_ps::<1>(self.0)) })
        }
    }

    impl Lanes for Avx512 {
        const WIDTH: usize = 16;
        type Mask = __mmask16;
        #[inline(always)]
        fn splat(x: f32) -> Self {
            Self(unsafe { _mm512_set1_ps(x) })
        }
        #[inline(always)]
        fn load(from: &[f32]) -> Self {
            assert!(from.len() >= 16);
            Self(unsafe { _mm512_loadu_ps(from.as_ptr()) })
        }
        #[inline(always)]
        fn store(self, to: &mut [f32]) {
            assert!(to.len() >= 16);
            unsafe { _mm512_storeu_ps(to.as_mut_ptr(), self.0) }
        }
        #[inline(always)]
        fn mul_add(self, b: Self, c: Self) -> Self {
            Self(unsafe { _mm512_fmadd_ps(self.0, b.0, c.0) })
        }
        #[inline(always)]
        fn min(self, b: Self) -> Self {
            Self(unsafe { _mm512_min_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn max(self, b: Self) -> Self {
            Self(unsafe { _mm512_max_ps(self.0, b.0) })
        }
        #[inline(always)]
        fn sqrt(self) -> Self {
            Self(unsafe { _mm512_sqrt_ps(self.0) })
        }
        #[inline(always)]
        fn round(self) -> Self {
            Self(unsafe { _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(self.0) })
        }
        #[inline(always)]
        fn floor(self) -> Self {
            Self(unsafe { _mm512_roundscale_ps::<{ _MM_FROUND_TO_NEG_INF | _MM_FROUND_NO_EXC }>(self.0) })
        }
        #[inline(always)]
        fn gather_pairs(from: &[u32], at: Self) -> (Self, Self) {
            assert!(!from.is_empty() && from.len() <= i32::MAX as usize);
            unsafe {
                let at = _mm512_max_epi32(_mm512_cvttps_epi32(at.0), _mm512_setzero_si512());
                let at = _mm512_min_epi32(at, _mm512_set1_epi32(from.len() as i32 - 1));
                // Every index is inside `from`.
                let words = _mm512_i32gather_epi32::<4>(at, from.as_ptr().cast());
                let low = _mm512_cvtepi32_ps(_mm512_and_si512(words, _mm512_set1_epi32(0xffff)));
                (Self(low), Self(_mm512_cvtepi32_ps(_mm512_srli_epi32::<16>(words))))
            }
        }
        #[inline(always)]
        fn times_power_of_two(self, n: Self) -> Self {
            Self(unsafe { _mm512_scalef_ps(self.0, n.0) })
        }
        #[inline(always)]
        fn split_exponent(self) -> (Self, Self) {
            unsafe {
                let m = _mm512_getmant_ps::<_MM_MANT_NORM_1_2, _MM_MANT_SIGN_SRC>(self.0);
                (Self(m), Self(_mm512_getexp_ps(self.0)))
            }
        }
        #[inline(always)]
        fn ge(self, b: Self) -> __mmask16 {
            unsafe { _mm512_cmp_ps_mask::<_CMP_GE_OQ>(self.0, b.0) }
        }
        #[inline(always)]
        fn gt(self, b: Self) -> __mmask16 {
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
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Compare;

    /// The exponential's polynomial and the artanh series, in f32: their stated errors plus a few roundings.
    const EXP_TOLERANCE: f64 = 5e-7;
    const LN_TOLERANCE: f64 = 1e-6;

    impl Kernel for Compare {
        type Output = ();
        fn run<L: Lanes>(self) {
            let mut out = [0.0_f32; 16];
            for i in -1000..=600 {
                let x = i as f32 * 0.1;
                L::splat(x).exp().store(&mut out);
                let truth = f64::from(x).exp();
                if x > -80.0 {
                    let relative = (f64::from(out[L::WIDTH - 1]) / truth - 1.0).abs();
                    // The argument is reduced in f32: an error of half an ulp of x/ln 2 turns into a relative error of |x|·2^-24.
                    assert!(relative < EXP_TOLERANCE + f64::from(x.abs()) * 1.2e-7, "exp({x}): {relative:.1e}");
                }
                let y = truth as f32;
                if y > 1e-30 {
                    L::splat(y).ln().store(&mut out);
                    let truth = f64::from(y).ln();
                    assert!((f64::from(out[0]) - truth).abs() < LN_TOLERANCE * (1.0 + truth.abs()), "ln({y}) {} {truth}", out[0]);
                }
            }
            let numbers: Vec<f32> = (0..16).map(|i| (i * i) as f32).collect();
            let expected: f32 = numbers[..L::WIDTH].iter().sum();
            assert_eq!(L::load(&numbers).sum(), expected);
            let n = L::load(&numbers);
            assert_eq!(L::sum4([n, n + n, -n, L::splat(0.0)]), [expected, 2.0 * expected, -expected, 0.0]);
            let big = L::load(&numbers).gt(L::splat(10.0));
            assert!(L::any(big));
            L::select(big, L::splat(1.0), L::splat(-1.0)).store(&mut out);
            assert_eq!(&out[..5], &[-1.0, -1.0, -1.0, -1.0, 1.0]);
            assert!(!L::any(L::splat(f32::NAN).ge(L::splat(0.0))));
            (L::load(&numbers) * L::splat(0.3) - L::splat(2.5)).floor().store(&mut out);
            assert!(numbers.iter().zip(&out).take(L::WIDTH).all(|(n, o)| (n * 0.3 - 2.5).floor() == *o));
            let words: Vec<u32> = (0..100).map(|i| i | (1000 + i) << 16).collect();
            let (mut low, mut high) = ([0.0_f32; 16], [0.0_f32; 16]);
            let found = L::gather_pairs(&words, L::load(&numbers) - L::splat(1.0));
            found.0.store(&mut low);
            found.1.store(&mut high);
            for i in 0..L::WIDTH {
                let held = (numbers[i] - 1.0).clamp(0.0, 99.0);
                assert_eq!((low[i], high[i]), (held, 1000.0 + held));
            }
        }
    }

    #[test]
    fn every_instruction_set_computes_the_same_functions() {
        for isa in Isa::available() {
            isa.dispatch(Compare);
        }
    }
}
