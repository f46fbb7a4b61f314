//! Reflection from and transmission through a uniform slab (ITU-R P.2040-3 §2.2.2.2; Sionna RT technical report).

use crate::radio::{Complex, Slab};

/// Amplitude coefficients of a slab for the two polarisations.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlabResponse {
    /// Reflection, electric field perpendicular to the plane of incidence.
    pub r_te: Complex,
    /// Reflection, electric field in the plane of incidence.
    pub r_tm: Complex,
    /// Transmission, perpendicular.
    pub t_te: Complex,
    /// Transmission, parallel.
    pub t_tm: Complex,
}

/// The half-space coefficients r_TE and r_TM at `cos_incidence` = cosθ_i ∈ [0, 1].
pub fn half_space(eta: Complex, cos_incidence: f64) -> (Complex, Complex) {
    let c = Complex::real(cos_incidence);
    let s = root(eta, cos_incidence);
    if (c + s).norm_squared() == 0.0 {
        // η = 1 at grazing incidence: air to air reflects nothing, at any angle.
        return (Complex::ZERO, Complex::ZERO);
    }
    ((c - s) / (c + s), (eta * c - s) / (eta * c + s))
}

/// s = √(η − sin²θ_i): the principal root, which decays into a lossy slab under e^{+jωt}.
fn root(eta: Complex, cos_incidence: f64) -> Complex {
    (eta - Complex::ONE + Complex::real(cos_incidence * cos_incidence)).sqrt()
}

/// The slab's reflection and transmission at `cos_incidence` = cosθ_i ∈ [0, 1], all internal bounces included.
///
/// With q = 2πd·s/λ: R = r(1 − e^{−2jq}) / (1 − r²e^{−2jq}), T = (1 − r²)e^{−jq} / (1 − r²e^{−2jq}).
pub fn slab_response(slab: &Slab, cos_incidence: f64) -> SlabResponse {
    let (r_te, r_tm) = half_space(slab.eta, cos_incidence);
    let q = root(slab.eta, cos_incidence) * (std::f64::consts::TAU * slab.thickness_m / slab.wavelength_m);
    let once = Complex::new(q.im, -q.re).exp(); // e^{−jq}
    let twice = once * once;
    let both = |r: Complex| {
        let denominator = Complex::ONE - r * r * twice;
        if denominator.norm_squared() == 0.0 {
            // Exactly grazing on a lossless slab: everything is reflected.
            return (r, Complex::ZERO);
        }
        (r * (Complex::ONE - twice) / denominator, (Complex::ONE - r * r) * once / denominator)
    };
    let (te, tm) = (both(r_te), both(r_tm));
    SlabResponse { r_te: te.0, r_tm: tm.0, t_te: te.1, t_tm: tm.1 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::model::Scattering;
    use proptest::prelude::*;

    /// Rounding of a handful of f64 operations, amplified by the resonance denominator of thin lossless slabs.
    const ENERGY_TOLERANCE: f64 = 1e-9;
    const FREQUENCY_HZ: f64 = 60e9;

    fn slab(eps_r: f64, eps_im: f64, thickness_m: f64) -> Slab {
        Slab::new("test", eps_r, eps_im, thickness_m, Scattering::default(), FREQUENCY_HZ).unwrap()
    }

    proptest! {
        #[test]
        fn a_slab_never_creates_energy(eps_r in 1.0..12.0f64, eps_im in 0.0..20.0f64, d in 1e-4..0.3f64, c in 1e-3..1.0f64) {
            let s = slab_response(&slab(eps_r, eps_im, d), c);
            prop_assert!(s.r_te.norm_squared() + s.t_te.norm_squared() <= 1.0 + ENERGY_TOLERANCE);
            prop_assert!(s.r_tm.norm_squared() + s.t_tm.norm_squared() <= 1.0 + ENERGY_TOLERANCE);
        }

        #[test]
        fn a_lossless_slab_keeps_all_of_it(eps_r in 1.01..12.0f64, d in 1e-4..0.3f64, c in 1e-3..1.0f64) {
            let s = slab_response(&slab(eps_r, 0.0, d), c);
            prop_assert!((s.r_te.norm_squared() + s.t_te.norm_squared() - 1.0).abs() < ENERGY_TOLERANCE);
            prop_assert!((s.r_tm.norm_squared() + s.t_tm.norm_squared() - 1.0).abs() < ENERGY_TOLERANCE);
        }

        #[test]
        fn a_thick_lossy_slab_is_a_half_space(eps_r in 1.5..12.0f64, c in 1e-2..1.0f64) {
            let thick = slab(eps_r, 0.5, 2.0);
            let s = slab_response(&thick, c);
            let (te, tm) = half_space(thick.eta, c);
            prop_assert!((s.r_te - te).norm() < 1e-12 && (s.r_tm - tm).norm() < 1e-12);
            prop_assert!(s.t_te.norm() < 1e-12 && s.t_tm.norm() < 1e-12);
        }
    }

    #[test]
    fn normal_incidence_matches_the_table_of_itu_materials() {
        // |Γ₀| of a half-space at 60 GHz: concrete .393, glass .431, wood .171, metal .999 (P.2040-3 permittivities).
        for (eps_r, sigma, expected) in
            [(5.24, 1.13635, 0.393), (6.31, 0.86688, 0.431), (1.99, 0.37837, 0.171), (1.0, 1e7, 0.999)]
        {
            let eps_im = sigma / (std::f64::consts::TAU * FREQUENCY_HZ * corf_scene::itu::VACUUM_PERMITTIVITY_F_PER_M);
            let (te, tm) = half_space(Complex::new(eps_r, -eps_im), 1.0);
            assert!((te.norm() - expected).abs() < 6e-4 && (te + tm).norm() < 1e-12, "{eps_r} {}", te.norm());
        }
    }

    #[test]
    fn the_brewster_angle_of_a_half_space_reflects_no_parallel_field() {
        let eps_r: f64 = 4.0;
        let cos = (1.0 / (1.0 + eps_r)).sqrt(); // tanθ_B = √ε_r
        assert!(half_space(Complex::real(eps_r), cos).1.norm() < 1e-12);
    }
}
