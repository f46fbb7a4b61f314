//! The scaled complementary error function on the diagonal that UTD and Fresnel integrals live on.

use super::super::Complex;
use std::f64::consts::{FRAC_1_SQRT_2, PI};

/// Below this |z|² the power series is used (it loses e^{|z|²} of its digits), above it the continued fraction.
const SERIES_LIMIT: f64 = 4.0;
/// Relative size of the last term kept.
const CONVERGED: f64 = 1e-17;
/// Depth of the continued fraction at |z|² = 4, where it converges slowest.
const FRACTION_DEPTH: f64 = 120.0;

/// erfcx(z) = e^{z²}·erfc(z) at z = e^{jπ/4}·t, t ≥ 0; relative error below 1e-13.
///
/// It is ∫_t^∞ e^{−jτ²}dτ in disguise: erfcx(e^{jπ/4}t) = (2/√π)·e^{jπ/4}·e^{jt²}·∫_t^∞ e^{−jτ²}dτ.
pub fn erfcx_diagonal(t: f64) -> Complex {
    let z = Complex::new(t * FRAC_1_SQRT_2, t * FRAC_1_SQRT_2);
    if t * t <= SERIES_LIMIT { series(z, t) } else { continued_fraction(z, t) }
}

/// e^{z²} − (2/√π)·Σ_n 2ⁿz^{2n+1}/(2n+1)!! (DLMF 7.6.2), z² = jt².
fn series(z: Complex, t: f64) -> Complex {
    let z2 = Complex::new(0.0, t * t);
    let (mut term, mut sum) = (z, z);
    let mut n = 1.0;
    while term.norm_squared() > CONVERGED * CONVERGED * sum.norm_squared() {
        term = term * z2 * (2.0 / (2.0 * n + 1.0));
        sum = sum + term;
        n += 1.0;
    }
    z2.exp() - sum * (2.0 / PI.sqrt())
}

/// (1/√π)·1/(z + (1/2)/(z + 1/(z + (3/2)/(z + …)))) (DLMF 7.9.2), from the tail up.
fn continued_fraction(z: Complex, t: f64) -> Complex {
    let depth = (FRACTION_DEPTH * SERIES_LIMIT / (t * t)).ceil() as usize + 8;
    let mut tail = z;
    for m in (1..=depth).rev() {
        tail = z + Complex::real(0.5 * m as f64) / tail;
    }
    Complex::real(1.0 / PI.sqrt()) / tail
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative error that the function's doc comment promises.
    const RELATIVE: f64 = 1e-13;

    #[test]
    fn known_values() {
        // erfcx(e^{jπ/4}t) through the Fresnel integrals C, S tabulated in Abramowitz & Stegun table 7.7 with x = t·√(2/π):
        // ∫_t^∞ e^{−jτ²}dτ = √(π/2)·[(1/2 − C(x)) − j(1/2 − S(x))].
        for (x, c, s) in [
            (0.0, 0.0, 0.0),
            (0.5, 0.492_344_225_871_446, 0.064_732_432_859_999_3),
            (1.0, 0.779_893_400_376_822_8, 0.438_259_147_390_354_8),
            (2.0, 0.488_253_406_075_340_8, 0.343_415_678_363_698_2),
            (5.0, 0.563_631_188_704_012_2, 0.499_191_381_917_116_9),
        ] {
            let t: f64 = x * (PI / 2.0f64).sqrt();
            let integral = Complex::new(0.5 - c, -(0.5 - s)) * (PI / 2.0f64).sqrt();
            let phase = Complex::new(0.0, PI / 4.0 + t * t).exp();
            let expected = phase * integral * (2.0 / PI.sqrt());
            // The table's fifteen digits lose some where 1/2 − C is small.
            assert!((erfcx_diagonal(t) - expected).norm() < 2e-15 + RELATIVE * expected.norm(), "{x}: {:?}", erfcx_diagonal(t));
        }
    }

    #[test]
    fn series_and_fraction_agree_where_they_meet() {
        for t2 in [3.0f64, 3.5, 4.0, 4.5, 5.0] {
            let t = t2.sqrt();
            let z = Complex::new(t * FRAC_1_SQRT_2, t * FRAC_1_SQRT_2);
            let (a, b) = (series(z, t), continued_fraction(z, t));
            assert!((a - b).norm() < RELATIVE * a.norm(), "{t2}: {a:?} {b:?}");
        }
    }
}
