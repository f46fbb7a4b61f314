//! Sampling settings of the diffuse field, and the numbers that follow from them.

use crate::radio::MAX_INTERACTIONS;
use corf_scene::config::SpectrumConfig;
use corf_scene::{Error, Result};
use serde::{Deserialize, Serialize};

/// More than the whole sphere: no mirror is evaluated exactly.
pub const NO_MIRRORS_SR: f64 = 13.0;
/// More photons are a mistake.
const MAX_PHOTONS: usize = 100_000_000;
/// Sampling of the diffuse field.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DiffuseSettings {
    /// Side of the world-fixed patches on which photons are gathered, metres: indirect light is resolved as finely as this.
    pub patch_size_m: f64,
    /// Directions over the whole sphere in which a receiver gathers, and rays of the transmitter that help it; 120 000 are 0.59° apart.
    pub directions: usize,
    /// Most interactions after the last scattering (mirrors and slabs between the surface and the receiver), within the tracer's depth.
    pub after: usize,
    /// Faces that fill less of the transmitter's view than this mirror it onto surfaces by photons, not exactly, steradians. In the
    /// lobby the seven that fill 0.3 sr and more cost as much as all else and do not change the sampling error; by default there are none.
    pub min_mirror_sr: f64,
    /// Photons that bring all indirect light; 0 leaves it out.
    pub photons: usize,
    /// Angular resolution of the arrivals' reader, degrees: where neighbouring directions differ by more than some per cent of the power
    /// within it, a receiver samples more finely. 0 leaves it at the lattice.
    pub resolution_deg: f64,
    /// Whether heavy single arrivals are avoided: small faces are sampled over their area, strong mirrors get more directions, all
    /// directions are jittered in their cells, and outliers are clamped. For readers whose lobes hold many arrivals, where the few heavy
    /// ones make the error.
    pub even_arrivals: bool,
    /// Firefly clamp, with `even_arrivals`: an arrival of more than this share of all others within the resolution around it, and of more
    /// than any one of them, is cut to the larger of the two; the power cut goes to all arrivals. Less error for some bias, and less of
    /// both with more directions; 0 cuts nothing.
    pub outlier_share: f64,
    /// Shifts the patches, turns the lattices and draws other photons; results of different phases differ by the sampling error alone.
    pub phase: u64,
}

impl Default for DiffuseSettings {
    fn default() -> Self {
        let radio = SpectrumConfig::default();
        Self {
            patch_size_m: radio.patch_size_m,
            directions: radio.directions,
            after: MAX_INTERACTIONS,
            min_mirror_sr: NO_MIRRORS_SR,
            photons: radio.photons,
            resolution_deg: 1.0,
            even_arrivals: false,
            outlier_share: 0.1,
            phase: 0,
        }
    }
}

impl DiffuseSettings {
    /// Checks ranges.
    ///
    /// # Errors
    /// The first setting out of range, by name.
    pub fn validate(&self) -> Result<()> {
        let fault = |key: &str, what: String, help: &str| Err(Error::invalid(format!("diffuse settings, `{key}`"), what, help));
        if !(0.02..=1e3).contains(&self.patch_size_m) {
            return fault("patch_size_m", format!("{:?}", self.patch_size_m), "give 0.02 m to 1000 m; 0.16 suits a lobby");
        }
        if !(100..=50_000_000).contains(&self.directions) {
            return fault("directions", format!("{}", self.directions), "give 100 to 50 000 000; 120 000 suits a 1 degree lobe");
        }
        if self.photons > MAX_PHOTONS {
            return fault("photons", format!("{}", self.photons), "give at most 100 000 000; a million suits a lobby");
        }
        if !(self.resolution_deg.is_finite() && (0.0..=90.0).contains(&self.resolution_deg)) {
            return fault(
                "resolution_deg",
                format!("{}", self.resolution_deg),
                "give 0 to 90 degrees; the width of a spectrum's lobe suits",
            );
        }
        if !(self.outlier_share.is_finite() && self.outlier_share >= 0.0) {
            return fault(
                "outlier_share",
                format!("{}", self.outlier_share),
                "give a share of at least 0; 0.1 suits an array of 8 by 8",
            );
        }
        if !(self.min_mirror_sr.is_finite() && self.min_mirror_sr >= 0.0) {
            return fault("min_mirror_sr", format!("{}", self.min_mirror_sr), "give a solid angle of at least 0");
        }
        Ok(())
    }
}

/// Numbers of the gathering that follow from whether single heavy arrivals are to be avoided ([`DiffuseSettings::even_arrivals`]).
#[derive(Clone, Copy, Debug)]
pub(super) struct SamplingPolicy {
    /// Factor by which directions outside of an [`super::WorldExtent`] are sparser.
    pub outside_sparsity: usize,
    /// Whether directions are jittered in their cells, small faces sampled over their area, and the transmitter's rays connected by way of
    /// mirrors as well.
    pub is_even: bool,
    /// Directions along the side of a cell in which a strong mirror stands; 1 cuts none.
    pub mirror_side: usize,
    /// Threshold of Russian roulette: a ray that keeps less than this share of power goes on with that much less probability, and counts
    /// for more.
    pub roulette_throughput: f64,
    /// Threshold of Russian roulette before the scattering of a surface is evaluated, for tracing is the lesser part of the cost; 0
    /// evaluates always.
    pub shade_throughput: f64,
    /// Firefly clamp, as [`DiffuseSettings::outlier_share`]; 0 cuts nothing.
    pub firefly_share: f64,
}

impl DiffuseSettings {
    /// The policy of these settings.
    pub(super) fn policy(&self) -> SamplingPolicy {
        if self.even_arrivals {
            SamplingPolicy {
                outside_sparsity: 4,
                is_even: true,
                mirror_side: 2,
                roulette_throughput: 0.02,
                shade_throughput: 0.1,
                firefly_share: self.outlier_share,
            }
        } else {
            SamplingPolicy {
                outside_sparsity: 16,
                is_even: false,
                mirror_side: 1,
                roulette_throughput: 0.01,
                shade_throughput: 0.0,
                firefly_share: 0.0,
            }
        }
    }
}
