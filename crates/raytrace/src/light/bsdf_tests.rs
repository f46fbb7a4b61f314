//! Energy, density and histogram truths of the reflection model.

use super::*;
use corf_scene::Rng;

fn direction(cos: f32, phi: f32) -> Vec3 {
    let s = (1.0 - cos * cos).sqrt();
    Vec3::new(s * phi.cos(), s * phi.sin(), cos)
}

/// Midpoint quadrature over the hemisphere, fine enough for the lobes tested (α ≥ 0.09).
fn integrate(mut f: impl FnMut(Vec3) -> f64) -> f64 {
    const N: usize = 700;
    let mut sum = 0.0;
    for i in 0..N {
        for j in 0..N {
            sum += f(direction((i as f32 + 0.5) / N as f32, TAU * (j as f32 + 0.5) / N as f32));
        }
    }
    sum * std::f64::consts::TAU / (N * N) as f64
}

const VIEWS: [f32; 5] = [1.0, 0.7, 0.4, 0.15, 0.05];
/// Quadrature and table interpolation together.
const ENERGY_TOLERANCE: f64 = 0.01;

#[test]
fn no_material_reflects_more_than_it_receives_and_white_dielectrics_reflect_all() {
    for v_z in VIEWS {
        for roughness in [0.3, 0.6, 1.0] {
            for (metallic, ior) in [(0.0, 1.5), (0.0, 2.2), (0.5, 1.5), (1.0, 1.5)] {
                let bsdf = Bsdf::new(Vec3::ONE, metallic, roughness, ior, direction(v_z, 0.3));
                let reflected = integrate(|l| f64::from(bsdf.evaluate(l).0.y));
                let case = format!("v_z {v_z}, roughness {roughness}, metallic {metallic}, ior {ior}: {reflected}");
                assert!(reflected <= 1.0 + ENERGY_TOLERANCE, "{case}");
                if metallic == 0.0 {
                    assert!(reflected >= 1.0 - ENERGY_TOLERANCE, "{case}");
                }
                assert!((reflected - f64::from(bsdf.albedo.y)).abs() < ENERGY_TOLERANCE, "{case}: albedo {}", bsdf.albedo.y);
            }
        }
    }
}

#[test]
fn single_scattering_loss_of_a_white_metal_is_that_of_the_textbook_formula() {
    // E(v) = ∫ D·G₂ / (4 v_z) dl with Λ(z) = (√(1 + α² tan²θ) − 1)/2 (Heitz 2014), written out anew.
    let lambda = |z: f64, a: f64| 0.5 * ((1.0 + a * a * (1.0 - z * z) / (z * z)).sqrt() - 1.0);
    for alpha in [0.1f32, 0.36, 1.0] {
        let a = f64::from(alpha);
        let mut mean = 0.0;
        const VIEWS: usize = 16;
        for i in 0..VIEWS {
            let v = direction((i as f32 + 0.5) / VIEWS as f32, 0.0);
            let albedo = integrate(|l| {
                let h = (v + l).normalize().z;
                let tan2 = f64::from((1.0 - h * h) / (h * h));
                let d = a * a / (std::f64::consts::PI * f64::from(h).powi(4) * (a * a + tan2).powi(2));
                d / (4.0 * f64::from(v.z) * (1.0 + lambda(f64::from(v.z), a) + lambda(f64::from(l.z), a)))
            });
            let (scale, bias) = albedo_table().at(v.z, alpha);
            assert!(
                (f64::from(scale + bias) - albedo).abs() < ENERGY_TOLERANCE,
                "α {alpha}, v_z {}: {albedo}, table {}",
                v.z,
                scale + bias
            );
            mean += 2.0 * f64::from(v.z) * albedo / VIEWS as f64;
        }
        let (scale, bias) = albedo_table().mean(alpha);
        assert!((f64::from(scale + bias) - mean).abs() < ENERGY_TOLERANCE, "α {alpha}: mean {mean}");
        if alpha == 1.0 {
            // "As much as 60 %" is lost at the highest roughness (Kulla and Conty 2017).
            assert!((0.38..0.43).contains(&mean), "{mean}");
        }
    }
}

#[test]
fn reflection_is_reciprocal() {
    let (a, b) = (direction(0.8, 0.4), direction(0.3, 2.9));
    for (metallic, roughness) in [(0.0, 0.4), (0.3, 0.7), (1.0, 0.5)] {
        let of = |v, l: Vec3| Bsdf::new(Vec3::new(0.9, 0.5, 0.2), metallic, roughness, 1.5, v).evaluate(l).0 / l.z;
        let (f, g) = (of(a, b), of(b, a));
        assert!((f - g).abs().max_element() < 1e-4 * f.max_element(), "{f} {g}");
    }
}

#[test]
fn the_density_integrates_to_the_share_of_samples_above_the_surface() {
    for v_z in VIEWS {
        for roughness in [0.35, 0.7, 1.0] {
            let bsdf = Bsdf::new(Vec3::splat(0.5), 0.2, roughness, 1.5, direction(v_z, 1.1));
            let integral = integrate(|l| f64::from(bsdf.evaluate(l).1));
            let mut rng = Rng::keyed(1, 2, 3);
            let n = 40_000;
            let above =
                (0..n).filter(|_| bsdf.sample(rng.uniform(), [rng.uniform(), rng.uniform()]).is_some()).count() as f64 / n as f64;
            // Reflections that GGX sends below the horizon are lost (single scattering): five standard errors of the share.
            assert!((integral - above).abs() < 0.005 + 5.0 * (0.25 / n as f64).sqrt(), "{v_z} {roughness}: {integral} {above}");
        }
    }
}

/// Significance of the χ² test: one honest run in a thousand would fail, and the seed is fixed.
const NORMAL_QUANTILE_0_999: f64 = 3.09;

#[test]
fn samples_follow_the_density() {
    const COS: usize = 12;
    const PHI: usize = 24;
    const SAMPLES: usize = 200_000;
    const FINE: usize = 24;
    for (case, (v_z, roughness, metallic)) in [(0.9, 0.5, 0.0), (0.3, 0.6, 0.5), (0.15, 0.8, 1.0)].into_iter().enumerate() {
        let bsdf = Bsdf::new(Vec3::splat(0.6), metallic, roughness, 1.5, direction(v_z, -0.7));
        let mut counts = vec![0.0f64; COS * PHI];
        let mut rng = Rng::keyed(11, 12, case as u64);
        for _ in 0..SAMPLES {
            if let Some(s) = bsdf.sample(rng.uniform(), [rng.uniform(), rng.uniform()]) {
                let phi = s.l.y.atan2(s.l.x).rem_euclid(TAU) / TAU;
                let bin = ((s.l.z * COS as f32) as usize).min(COS - 1) * PHI + ((phi * PHI as f32) as usize).min(PHI - 1);
                counts[bin] += 1.0;
            }
        }
        let (mut chi2, mut bins) = (0.0f64, 0.0f64);
        for bin in 0..COS * PHI {
            let mut expected = 0.0;
            for i in 0..FINE * FINE {
                let cos = ((bin / PHI) as f32 + ((i / FINE) as f32 + 0.5) / FINE as f32) / COS as f32;
                let phi = TAU * ((bin % PHI) as f32 + ((i % FINE) as f32 + 0.5) / FINE as f32) / PHI as f32;
                expected += f64::from(bsdf.evaluate(direction(cos, phi)).1);
            }
            expected *= SAMPLES as f64 * std::f64::consts::TAU / (COS * PHI * FINE * FINE) as f64;
            if expected > 10.0 {
                chi2 += (counts[bin] - expected).powi(2) / expected;
                bins += 1.0;
            } else {
                assert!(counts[bin] < 50.0, "{} samples where {expected} were expected", counts[bin]);
            }
        }
        // χ² with k degrees of freedom ≈ k(1 − 2/9k + z√(2/9k))³ (Wilson–Hilferty).
        let critical = bins * (1.0 - 2.0 / (9.0 * bins) + NORMAL_QUANTILE_0_999 * (2.0 / (9.0 * bins)).sqrt()).powi(3);
        assert!(chi2 < critical, "case {case}: χ² {chi2:.1} over {bins} bins, critical {critical:.1}");
    }
}

#[test]
fn panes_reflect_as_fresnel_says() {
    // Normal incidence, n = 1.5: R = 0.04, pane 2R/(1+R) = 0.0769; grazing: everything.
    assert!((fresnel_dielectric(1.0, 1.5) - 0.04).abs() < 1e-6);
    assert!((fresnel_pane(1.0, 1.5) - 0.076_923).abs() < 1e-5);
    assert!(fresnel_pane(1e-4, 1.5) > 0.99);
    // Brewster's angle: only the perpendicular half, ((n² − 1)/(n² + 1))²/2.
    let cos = (1.0f32 / (1.0 + 1.5 * 1.5)).sqrt();
    assert!((fresnel_dielectric(cos, 1.5) - 0.5 * (1.25f32 / 3.25).powi(2)).abs() < 1e-5);
}
