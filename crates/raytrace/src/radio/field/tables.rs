//! A slab's coefficients and lobe normalisation tabulated over cosθ_i: the diffuse field asks for them millions of times.

use crate::radio::field::scattering;
use crate::radio::{
    Complex, Slab,
    field::fresnel::{self, SlabResponse},
};

/// Intervals of the tables: linear interpolation of fringes that turn by at most some ten radians over cosθ_i is then good to 1e-5.
const INTERVALS: usize = 2048;

/// Tables over cosθ_i = 0 … 1.
pub struct SlabTable {
    responses: Vec<SlabResponse>,
    scattering: Vec<ScatteringEntry>,
    /// Power let through at normal incidence.
    pub transmitted_power: f64,
}

/// Coefficients for the scattering of a polarised wave, small enough to stay in the cache: single precision is 6e-8 of power.
#[derive(Clone, Copy, Debug)]
pub struct ScatteringEntry {
    /// |R_TE|².
    pub te: f32,
    /// |R_TM|².
    pub tm: f32,
    /// 1/F of the slab's lobe.
    pub inverse_normalisation: f32,
}

impl SlabTable {
    /// Tabulates a slab.
    pub fn new(slab: &Slab) -> Self {
        let cosines = (0..=INTERVALS).map(|i| i as f64 / INTERVALS as f64);
        let responses: Vec<SlabResponse> = cosines.clone().map(|c| fresnel::slab_response(slab, c)).collect();
        let scattering = responses
            .iter()
            .zip(cosines)
            .map(|(r, c)| ScatteringEntry {
                te: r.r_te.norm_squared() as f32,
                tm: r.r_tm.norm_squared() as f32,
                inverse_normalisation: (1.0 / scattering::normalisation(slab.scattering.pattern, c)) as f32,
            })
            .collect();
        Self { transmitted_power: responses[INTERVALS].t_te.norm_squared(), responses, scattering }
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

    /// Reflected powers and the lobe's normalisation.
    pub fn scattering(&self, cos_incidence: f64) -> ScatteringEntry {
        let (i, t) = Self::position(cos_incidence);
        let (a, b, t) = (&self.scattering[i], &self.scattering[i + 1], t as f32);
        ScatteringEntry {
            te: a.te + (b.te - a.te) * t,
            tm: a.tm + (b.tm - a.tm) * t,
            inverse_normalisation: a.inverse_normalisation + (b.inverse_normalisation - a.inverse_normalisation) * t,
        }
    }
}
