//! Radio materials resolved at the carrier: slabs with a complex permittivity and a scattering lobe.

use crate::radio::{Complex, SPEED_OF_LIGHT};
use corf_scene::model::{RadioMaterial, Scattering};
use corf_scene::{Error, Result};

/// A material at one frequency: a uniform dielectric slab.
#[derive(Clone, Debug, PartialEq)]
pub struct Slab {
    /// Name for messages and reports.
    pub name: String,
    /// Complex relative permittivity η = ε_r − j·σ/(ωε₀), time convention e^{+jωt}.
    pub eta: Complex,
    /// Thickness, metres.
    pub thickness_m: f64,
    /// Diffuse scattering.
    pub scattering: Scattering,
    /// Free-space wavelength, metres.
    pub wavelength_m: f64,
}

impl Slab {
    /// A slab of permittivity `ε_r − j·ε_im` (`eps_im ≥ 0`).
    ///
    /// # Errors
    /// Numbers that no passive material has; `name` says whose they are.
    pub fn new(name: &str, eps_r: f64, eps_im: f64, thickness_m: f64, scattering: Scattering, frequency_hz: f64) -> Result<Self> {
        let fault = |what: String, help: &str| Err(Error::invalid(format!("radio material `{name}`"), what, help));
        if !(eps_r.is_finite() && eps_r >= 1.0) {
            return fault(format!("relative permittivity is {eps_r}"), "give a finite number of at least 1");
        }
        if !(eps_im.is_finite() && eps_im >= 0.0) {
            return fault(format!("loss (sigma / (omega eps0)) is {eps_im}"), "conductivity must be finite and not negative");
        }
        if !(thickness_m.is_finite() && thickness_m > 0.0) {
            return fault(format!("thickness is {thickness_m} m"), "give the slab's thickness in metres; there is no default");
        }
        if let Some((what, help)) = scattering.out_of_range() {
            return fault(what, help);
        }
        let eta = Complex::new(eps_r, -eps_im);
        Ok(Self { name: name.to_string(), eta, thickness_m, scattering, wavelength_m: SPEED_OF_LIGHT / frequency_hz })
    }

    /// The slab of a scene's radio material at the carrier.
    ///
    /// # Errors
    /// An ITU name outside its validity range, or numbers that no passive material has.
    pub fn from_radio(material: &RadioMaterial, frequency_hz: f64) -> Result<Self> {
        let (eps_r, eps_im) = material.complex_permittivity(frequency_hz)?;
        Self::new(&material.id, eps_r, eps_im, material.thickness_m, material.scattering, frequency_hz)
    }

    /// The share of amplitude that stays in the specular direction, √(1 − S²).
    pub fn specular_amplitude(&self) -> f64 {
        (1.0 - self.scattering.coefficient * self.scattering.coefficient).sqrt()
    }
}
