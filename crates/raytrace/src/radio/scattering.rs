//! Lobes of effective-roughness scattering (Degli-Esposti et al. 2007; Sionna RT technical report).

use corf_scene::model::ScatteringPattern;
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

/// f_s: the share of scattered power per steradian. `normalisation` is F_α (unused by the Lambertian lobe), `cos_scatter` = cosθ_s and
/// `cos_specular` = cosψ_r, the cosine between the scattered and the specular direction.
pub fn lobe(pattern: ScatteringPattern, normalisation: f64, cos_scatter: f64, cos_specular: f64) -> f64 {
    match pattern {
        ScatteringPattern::Lambertian => cos_scatter / PI,
        ScatteringPattern::Directive { alpha_r } => (0.5 * (1.0 + cos_specular)).max(0.0).powi(alpha_r as i32) / normalisation,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::lattice;
    use glam::DVec3;

    /// A Fibonacci lattice of 200 000 directions integrates these smooth lobes this well (their edge at the horizon limits it).
    const QUADRATURE_TOLERANCE: f64 = 2e-3;

    #[test]
    fn every_lobe_scatters_all_of_the_power_into_the_hemisphere() {
        let count = 200_000;
        for pattern in [
            ScatteringPattern::Lambertian,
            ScatteringPattern::Directive { alpha_r: 1 },
            ScatteringPattern::Directive { alpha_r: 4 },
            ScatteringPattern::Directive { alpha_r: 5 },
            ScatteringPattern::Directive { alpha_r: 10 },
        ] {
            for incidence in [0.0f64, 0.5, 1.2, 1.5] {
                let specular = DVec3::new(incidence.sin(), 0.0, incidence.cos());
                let normalisation = match pattern {
                    ScatteringPattern::Directive { alpha_r } => directive_normalisation(alpha_r, incidence.cos()),
                    ScatteringPattern::Lambertian => 1.0,
                };
                let sum: f64 = (0..count)
                    .map(|i| lattice::fibonacci(i, count))
                    .filter(|d| d.z > 0.0)
                    .map(|d| lobe(pattern, normalisation, d.z, d.dot(specular)))
                    .sum();
                let power = sum * 4.0 * PI / count as f64;
                assert!((power - 1.0).abs() < QUADRATURE_TOLERANCE, "{pattern:?} {incidence} {power}");
            }
        }
    }
}
