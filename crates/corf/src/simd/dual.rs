//! Lanes with a derivative along one direction beside each number.

use super::Lanes;
use std::ops::{Add, Div, Mul, Neg, Sub};

/// A number and its derivative.
#[derive(Clone, Copy)]
pub(crate) struct Dual<L> {
    pub value: L,
    pub tangent: L,
}

impl<L: Lanes> Add for Dual<L> {
    type Output = Self;
    #[inline(always)]
    fn add(self, o: Self) -> Self {
        Self { value: self.value + o.value, tangent: self.tangent + o.tangent }
    }
}
impl<L: Lanes> Sub for Dual<L> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, o: Self) -> Self {
        Self { value: self.value - o.value, tangent: self.tangent - o.tangent }
    }
}
impl<L: Lanes> Mul for Dual<L> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, o: Self) -> Self {
        Self { value: self.value * o.value, tangent: self.tangent * o.value + self.value * o.tangent }
    }
}
impl<L: Lanes> Div for Dual<L> {
    type Output = Self;
    #[inline(always)]
    fn div(self, o: Self) -> Self {
        let value = self.value / o.value;
        Self { value, tangent: (self.tangent - value * o.tangent) / o.value }
    }
}
impl<L: Lanes> Neg for Dual<L> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { value: -self.value, tangent: -self.tangent }
    }
}

impl<L: Lanes> Lanes for Dual<L> {
    const WIDTH: usize = L::WIDTH;
    type Mask = L::Mask;
    #[inline(always)]
    fn splat(x: f32) -> Self {
        Self { value: L::splat(x), tangent: L::splat(0.0) }
    }
    #[inline(always)]
    fn load(from: &[f32]) -> Self {
        Self { value: L::load(from), tangent: L::splat(0.0) }
    }
    #[inline(always)]
    fn store(self, to: &mut [f32]) {
        self.tangent.store(to);
    }
    #[inline(always)]
    fn mul_add(self, b: Self, c: Self) -> Self {
        Self {
            value: self.value.mul_add(b.value, c.value),
            tangent: self.tangent.mul_add(b.value, self.value.mul_add(b.tangent, c.tangent)),
        }
    }
    #[inline(always)]
    fn min(self, o: Self) -> Self {
        let mask = o.value.ge(self.value);
        Self::select(mask, self, o)
    }
    #[inline(always)]
    fn max(self, o: Self) -> Self {
        let mask = self.value.ge(o.value);
        Self::select(mask, self, o)
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        let value = self.value.sqrt();
        Self { value, tangent: L::splat(0.5) * self.tangent / value }
    }
    #[inline(always)]
    fn round(self) -> Self {
        Self { value: self.value.round(), tangent: L::splat(0.0) }
    }
    #[inline(always)]
    fn floor(self) -> Self {
        Self { value: self.value.floor(), tangent: L::splat(0.0) }
    }
    #[inline(always)]
    fn gather_pairs(from: &[u32], at: Self) -> (Self, Self) {
        let (a, b) = L::gather_pairs(from, at.value);
        (Self { value: a, tangent: L::splat(0.0) }, Self { value: b, tangent: L::splat(0.0) })
    }
    #[inline(always)]
    fn times_power_of_two(self, n: Self) -> Self {
        Self { value: self.value.times_power_of_two(n.value), tangent: self.tangent.times_power_of_two(n.value) }
    }
    #[inline(always)]
    fn split_exponent(self) -> (Self, Self) {
        let (m, e) = self.value.split_exponent();
        (Self { value: m, tangent: self.tangent * m / self.value }, Self { value: e, tangent: L::splat(0.0) })
    }
    #[inline(always)]
    fn ge(self, o: Self) -> Self::Mask {
        self.value.ge(o.value)
    }
    #[inline(always)]
    fn gt(self, o: Self) -> Self::Mask {
        self.value.gt(o.value)
    }
    #[inline(always)]
    fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask {
        L::and(a, b)
    }
    #[inline(always)]
    fn any(mask: Self::Mask) -> bool {
        L::any(mask)
    }
    #[inline(always)]
    fn select(mask: Self::Mask, a: Self, b: Self) -> Self {
        Self { value: L::select(mask, a.value, b.value), tangent: L::select(mask, a.tangent, b.tangent) }
    }
    #[inline(always)]
    fn sum(self) -> f32 {
        self.tangent.sum()
    }
    #[inline(always)]
    fn exp2_in_range(self) -> Self {
        let value = self.value.exp2_in_range();
        Self { value, tangent: value * self.tangent * L::splat(std::f32::consts::LN_2) }
    }
    #[inline(always)]
    fn exp2(self) -> Self {
        Self { value: self.value.max(L::splat(-125.0)), tangent: self.tangent }.exp2_in_range()
    }
    #[inline(always)]
    fn exp(self) -> Self {
        let value = self.value.exp();
        Self { value, tangent: value * self.tangent }
    }
    #[inline(always)]
    fn ln(self) -> Self {
        Self { value: self.value.ln(), tangent: self.tangent / self.value }
    }
}
