//! Several f32 numbers at a time, and the choice of the instruction set at run time.
//!
//! A kernel is written once over [`Lanes`] and compiled three times: for any CPU, for AVX2 + FMA and for AVX-512. Sums over lanes and
//! fused multiply-adds round differently between the three, so bytes may differ between machines; never between thread counts.

use std::ops::{Add, Div, Mul, Neg, Sub};

/// `WIDTH` f32 numbers. Comparisons with NaN are false.
pub(crate) trait Lanes:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Div<Output = Self> + Neg<Output = Self>
{
    /// Number of lanes.
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
mod x86;

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
