//! Complex numbers in f64: the few operations that fields need. `num-complex` takes square roots by way of polar coordinates and divides by |z|²;
//! beside the negative real axis, and for a metal's permittivity, that loses digits which coefficients are compared to.

use serde::{Deserialize, Serialize};
use std::ops::{Add, Div, Mul, Neg, Sub};

/// `re + j·im`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Complex {
    /// Real part.
    pub re: f64,
    /// Imaginary part.
    pub im: f64,
}

impl Complex {
    /// 0.
    pub const ZERO: Self = Self { re: 0.0, im: 0.0 };
    /// 1.
    pub const ONE: Self = Self { re: 1.0, im: 0.0 };

    /// `re + j·im`.
    pub const fn new(re: f64, im: f64) -> Self {
        Self { re, im }
    }

    /// A real number.
    pub const fn real(re: f64) -> Self {
        Self { re, im: 0.0 }
    }

    /// `|z|²`.
    pub fn norm_squared(self) -> f64 {
        self.re * self.re + self.im * self.im
    }

    /// `|z|`.
    pub fn norm(self) -> f64 {
        self.re.hypot(self.im)
    }

    /// `e^z`.
    pub fn exp(self) -> Self {
        let (sin, cos) = self.im.sin_cos();
        Self::new(cos, sin) * self.re.exp()
    }

    /// The principal square root (real part ≥ 0), stable for any argument.
    pub fn sqrt(self) -> Self {
        if self == Self::ZERO {
            return Self::ZERO;
        }
        let re = (0.5 * (self.norm() + self.re.abs())).sqrt();
        let im = 0.5 * self.im.abs() / re;
        let (re, im) = if self.re >= 0.0 { (re, im) } else { (im, re) };
        Self::new(re, im.copysign(self.im))
    }
}

impl Add for Complex {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self::new(self.re + o.re, self.im + o.im)
    }
}

impl Sub for Complex {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Self::new(self.re - o.re, self.im - o.im)
    }
}

impl Neg for Complex {
    type Output = Self;
    fn neg(self) -> Self {
        Self::new(-self.re, -self.im)
    }
}

impl Mul for Complex {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        Self::new(self.re * o.re - self.im * o.im, self.re * o.im + self.im * o.re)
    }
}

impl Mul<f64> for Complex {
    type Output = Self;
    fn mul(self, o: f64) -> Self {
        Self::new(self.re * o, self.im * o)
    }
}

impl Div for Complex {
    type Output = Self;
    fn div(self, o: Self) -> Self {
        // Smith's method: no overflow for large denominators such as a metal's permittivity squared.
        if o.re.abs() >= o.im.abs() {
            let (ratio, scale) = (o.im / o.re, 1.0 / (o.re + o.im * (o.im / o.re)));
            Self::new((self.re + self.im * ratio) * scale, (self.im - self.re * ratio) * scale)
        } else {
            let (ratio, scale) = (o.re / o.im, 1.0 / (o.re * (o.re / o.im) + o.im));
            Self::new((self.re * ratio + self.im) * scale, (self.im * ratio - self.re) * scale)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_square_root_squares_back_and_has_no_negative_real_part() {
        for z in [Complex::new(-4.0, 0.0), Complex::new(1.0, -3e6), Complex::new(-2.0, -1e-9), Complex::new(3.0, 4.0)] {
            let s = z.sqrt();
            assert!((s * s - z).norm() <= 1e-14 * z.norm(), "{z:?} {s:?}");
            assert!(s.re >= 0.0);
        }
    }

    #[test]
    fn division_inverts_multiplication() {
        let (a, b) = (Complex::new(0.3, -7.0), Complex::new(1.0, -3e6));
        assert!((a * b / b - a).norm() < 1e-14);
        assert!((a * a / a - a).norm() < 1e-14);
    }
}
