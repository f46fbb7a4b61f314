//! Sine and cosine from IEEE basic operations alone: the platform's libm may round differently, and the committed file's bytes may not.

use std::f64::consts::{FRAC_PI_2, PI};

/// `(sin x, cos x)` within 1e-15 for the small angles a builder uses (|x| < 1e4).
pub fn sin_cos(x: f64) -> (f64, f64) {
    let quarter = (x / FRAC_PI_2).round();
    let r = x - quarter * FRAC_PI_2;
    let r2 = r * r;
    // Taylor series about 0 on |r| ≤ π/4; the first term left out is below 1e-17.
    let mut sin = 0.0;
    let mut cos = 0.0;
    for k in (0..9).rev() {
        let k = f64::from(k);
        sin = 1.0 - sin * r2 / ((2.0 * k + 2.0) * (2.0 * k + 3.0));
        cos = 1.0 - cos * r2 / ((2.0 * k + 1.0) * (2.0 * k + 2.0));
    }
    let sin = sin * r;
    match (quarter as i64).rem_euclid(4) {
        0 => (sin, cos),
        1 => (cos, -sin),
        2 => (-sin, -cos),
        _ => (-cos, sin),
    }
}

/// Sine.
pub fn sin(x: f64) -> f64 {
    sin_cos(x).0
}

/// The point at `turn` whole turns on the unit circle.
pub fn on_circle(turn: f64) -> (f64, f64) {
    let (s, c) = sin_cos(2.0 * PI * turn);
    (c, s)
}

#[cfg(test)]
mod tests {
    #[test]
    fn agrees_with_the_platforms_sine_and_cosine() {
        for i in -5000..5000 {
            let x = f64::from(i) * 0.013;
            let (s, c) = super::sin_cos(x);
            // The quadrant reduction loses about |x|·1e-16.
            assert!((s - x.sin()).abs() < 2e-14 && (c - x.cos()).abs() < 2e-14, "{x}");
        }
    }
}
