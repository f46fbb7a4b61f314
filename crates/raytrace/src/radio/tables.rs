//! A slab's coefficients and lobe normalisation tabulated over cosθ_i: the diffuse field asks for them millions of times.

use super::scattering::directive_normalisation;
use super::{Complex, Slab, fresnel, fresnel::SlabResponse};
use corf_scene::model::ScatteringPattern;

/// Intervals of the tables: linear interpolation of fringes that turn by at most some ten radians over cosθ_i is then good to 1e-5.
const INTERVALS: usize = 2048;

/// Tables over cosθ_i = 0 … 1.
pub struct SlabTable {
    responses: Vec<SlabResponse>,
    normalisations: Vec<f64>,
    /// Power let through at normal incidence.
    pub transmitted_power: f64,
}

impl SlabTable {
    /// Tabulates a slab.
    pub fn new(slab: &Slab) -> Self {
        let cosines = (0..=INTERVALS).map(|i| i as f64 / INTERVALS as f64);
        let responses: Vec<SlabResponse> = cosines.clone().map(|c| fresnel::slab_response(slab, c)).collect();
        let normalisations = match slab.scattering.pattern {
            ScatteringPattern::Directive { alpha_r } => cosines.map(|c| directive_normalisation(alpha_r, c)).collect(),
            ScatteringPattern::Lambertian => vec![1.0; INTERVALS + 1],
        };
        Self { transmitted_power: responses[INTERVALS].t_te.norm_squared(), responses, normalisations }
    }

    fn position(cos_incidence: f64) -> (usize, f64) {
        let at = cos_incidence.clamp(0.0, 1.0) * INTERVALS as f64;
        let i = (at as usize).min(INTERVALS - 1);
        (i, at - i as f64)
    }

    /// The slab's response.
    pub fn response(&self, cos_incidence: f64) -> SlabResponse {
        let (i, t) = Self::position(cos_incidence);
        let (a, b) = (&self.responses[i], &self.responses[i + 1]);
        let lerp = |a: Complex, b: Complex| a + (b - a) * t;
        SlabResponse {
            r_te: lerp(a.r_te, b.r_te),
            r_tm: lerp(a.r_tm, b.r_tm),
            t_te: lerp(a.t_te, b.t_te),
            t_tm: lerp(a.t_tm, b.t_tm),
        }
    }

    /// F_α of the slab's lobe.
    pub fn normalisation(&self, cos_incidence: f64) -> f64 {
        let (i, t) = Self::position(cos_incidence);
        self.normalisations[i] + (self.normalisations[i + 1] - self.normalisations[i]) * t
    }
}
