//! Lobes of effective-roughness scattering (Degli-Esposti et al. 2007; Sionna RT technical report).

use corf_scene::model::ScatteringPattern;
use glam::DVec3;
use std::f64::consts::{PI, TAU};

/// F_α(θ_i): the integral of the directive lobe ((1 + cosψ_r)/2)^α over the hemisphere.
///
/// F_α = 2^{−α} Σ_j C(α, j) I_j; I_j = 2π/(j+1) for even j, 2πcosθ_i/(j+1) · Σ_{w=0}^{(j−1)/2} C(2w, w)(sinθ_i/2)^{2w} for odd j.
pub fn directive_normalisation(alpha_r: u32, cos_incidence: f64) -> f64 {
    let quarter_sin2 = 0.25 * (1.0 - cos_incidence * cos_incidence).max(0.0);
    let mut sum = 0.0;
    let mut choose = 1.0; // C(α, j)
    for j in 0..=alpha_r {
        let mut integral = TAU / f64::from(j + 1);
        if j % 2 == 1 {
            let (mut series, mut term) = (0.0, 1.0); // C(2w, w)·(sin²θ_i/4)^w
            for w in 0..=(j - 1) / 2 {
                series += term;
                let w = f64::from(w);
                term *= (2.0 * w + 1.0) * (2.0 * w + 2.0) / ((w + 1.0) * (w + 1.0)) * quarter_sin2;
            }
            integral *= cos_incidence * series;
        }
        sum += choose * integral;
        choose *= f64::from(alpha_r - j) / f64::from(j + 1);
    }
    sum * 0.5f64.powi(alpha_r as i32)
}

/// F(θ_i): the integral of an unnormalised lobe over the hemisphere; 1 for the Lambertian one, which carries its own 1/π.
///
/// Both lobes of [`ScatteringPattern::Backscatter`] stand at the same angle θ_i to the normal, so that F = Λ·F_{α_r} + (1 − Λ)·F_{α_i}.
pub fn normalisation(pattern: ScatteringPattern, cos_incidence: f64) -> f64 {
    match pattern {
        ScatteringPattern::Lambertian => 1.0,
        ScatteringPattern::Directive { alpha_r } => directive_normalisation(alpha_r, cos_incidence),
        ScatteringPattern::Backscatter { alpha_r, alpha_i, lambda } => {
            lambda * directive_normalisation(alpha_r, cos_incidence)
                + (1.0 - lambda) * directive_normalisation(alpha_i, cos_incidence)
        }
    }
}

/// ((1 + cosψ)/2)^α.
#[inline]
fn power_lobe(cos_psi: f64, alpha: u32) -> f64 {
    (0.5 * (1.0 + cos_psi)).max(0.0).powi(alpha as i32)
}

/// F·f_s, the unnormalised share of scattered power per steradian: `cos_scatter` = cosθ_s, `cos_specular` = cosψ_r, the cosine between
/// the scattered and the specular direction, `cos_back` = cosψ_i, that between the scattered direction and the one back to the source.
#[inline]
pub fn lobe(pattern: ScatteringPattern, cos_scatter: f64, cos_specular: f64, cos_back: f64) -> f64 {
    match pattern {
        ScatteringPattern::Lambertian => cos_scatter / PI,
        ScatteringPattern::Directive { alpha_r } => power_lobe(cos_specular, alpha_r),
        ScatteringPattern::Backscatter { alpha_r, alpha_i, lambda } => {
            lambda * power_lobe(cos_specular, alpha_r) + (1.0 - lambda) * power_lobe(cos_back, alpha_i)
        }
    }
}

/// Draws a scattered direction: the direction and F·f_s/p, the unnormalised lobe over the density it was drawn with; `None` where the
/// drawn direction leaves through the other side of the surface. `normal` is on the side the wave of unit `direction` comes from.
pub fn sample(pattern: ScatteringPattern, direction: DVec3, normal: DVec3, uniform: [f64; 3]) -> Option<(DVec3, f64)> {
    let [u, v, w] = uniform;
    let around = |axis: DVec3, cos: f64| -> DVec3 {
        let (sin, turn) = ((1.0 - cos * cos).max(0.0).sqrt(), TAU * v);
        let (a, b) = axis.any_orthonormal_pair();
        axis * cos + (a * turn.cos() + b * turn.sin()) * sin
    };
    // ((1 + cosψ)/2)^α integrates to 4π/(α + 1) over the sphere; its distribution function is ((1 + cosψ)/2)^(α+1).
    let whole = |alpha: u32| 4.0 * PI / f64::from(alpha + 1);
    let draw = |axis: DVec3, alpha: u32| around(axis, 2.0 * u.powf(1.0 / f64::from(alpha + 1)) - 1.0);
    let mirrored = direction - normal * (2.0 * direction.dot(normal));
    let (drawn, weight) = match pattern {
        ScatteringPattern::Lambertian => (around(normal, u.sqrt()), 1.0),
        ScatteringPattern::Directive { alpha_r } => (draw(mirrored, alpha_r), whole(alpha_r)),
        ScatteringPattern::Backscatter { alpha_r, alpha_i, lambda } => {
            let (specular, back) = (lambda * whole(alpha_r), (1.0 - lambda) * whole(alpha_i));
            let drawn = if w * (specular + back) < specular { draw(mirrored, alpha_r) } else { draw(-direction, alpha_i) };
            (drawn, specular + back)
        }
    };
    (drawn.dot(normal) > 0.0).then_some((drawn, weight))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::lattice;
    use corf_scene::Rng;

    /// A Fibonacci lattice of 200 000 directions integrates these smooth lobes this well (their edge at the horizon limits it).
    const QUADRATURE_TOLERANCE: f64 = 2e-3;
    const PATTERNS: [ScatteringPattern; 9] = [
        ScatteringPattern::Lambertian,
        ScatteringPattern::Directive { alpha_r: 1 },
        ScatteringPattern::Directive { alpha_r: 4 },
        ScatteringPattern::Directive { alpha_r: 5 },
        ScatteringPattern::Directive { alpha_r: 10 },
        ScatteringPattern::Directive { alpha_r: 50 },
        ScatteringPattern::Backscatter { alpha_r: 5, alpha_i: 3, lambda: 0.7 },
        ScatteringPattern::Backscatter { alpha_r: 20, alpha_i: 30, lambda: 0.4 },
        ScatteringPattern::Backscatter { alpha_r: 4, alpha_i: 7, lambda: 0.0 },
    ];

    #[test]
    fn every_lobe_scatters_all_of_the_power_into_the_hemisphere() {
        let count = 200_000;
        for pattern in PATTERNS {
            for incidence in [0.0f64, 0.5, 1.2, 1.5] {
                let specular = DVec3::new(incidence.sin(), 0.0, incidence.cos());
                let back = DVec3::new(-specular.x, 0.0, specular.z);
                let sum: f64 = (0..count)
                    .map(|i| lattice::fibonacci(i, count))
                    .filter(|d| d.z > 0.0)
                    .map(|d| lobe(pattern, d.z, d.dot(specular), d.dot(back)))
                    .sum();
                let power = sum * 4.0 * PI / count as f64 / normalisation(pattern, incidence.cos());
                assert!((power - 1.0).abs() < QUADRATURE_TOLERANCE, "{pattern:?} {incidence} {power}");
            }
        }
    }

    #[test]
    fn backscatter_with_all_weight_on_the_specular_lobe_is_directive() {
        let (a, b) =
            (ScatteringPattern::Backscatter { alpha_r: 6, alpha_i: 2, lambda: 1.0 }, ScatteringPattern::Directive { alpha_r: 6 });
        for cos in [0.1, 0.6, 1.0] {
            assert_eq!(normalisation(a, cos), normalisation(b, cos));
            assert_eq!(lobe(a, cos, 0.3, -0.4), lobe(b, cos, 0.3, -0.4));
        }
    }

    #[test]
    fn drawn_directions_carry_the_lobe_and_its_mean_direction() {
        // Means of weight and of weight × direction over draws against the quadrature over the hemisphere. The weight is constant above
        // the horizon and 0 below, so that 40 000 draws have a standard error below 0.005 in units of F.
        let (draws, count, tolerance) = (40_000, 40_000, 0.02);
        for pattern in PATTERNS {
            for incidence in [0.2f64, 1.3] {
                let k = DVec3::new(incidence.sin(), 0.0, -incidence.cos());
                let (specular, back) = (DVec3::new(k.x, 0.0, -k.z), -k);
                let total = normalisation(pattern, incidence.cos());
                let mut rng = Rng::keyed(5, 1, 2);
                let (mut power, mut moment) = (0.0, DVec3::ZERO);
                for _ in 0..draws {
                    let uniform = [rng.uniform_f64(), rng.uniform_f64(), rng.uniform_f64()];
                    if let Some((d, weight)) = sample(pattern, k, DVec3::Z, uniform) {
                        power += weight / total / draws as f64;
                        moment += d * (weight / total / draws as f64);
                    }
                }
                let expected: DVec3 = (0..count)
                    .map(|i| lattice::fibonacci(i, count))
                    .filter(|d| d.z > 0.0)
                    .map(|d| d * (lobe(pattern, d.z, d.dot(specular), d.dot(back)) / total * 4.0 * PI / count as f64))
                    .sum();
                assert!((power - 1.0).abs() < tolerance, "{pattern:?} {incidence} {power}");
                assert!((moment - expected).length() < tolerance, "{pattern:?} {incidence} {moment} {expected}");
            }
        }
    }
}
