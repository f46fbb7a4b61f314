//! The keyframe `K_t = {I_t, S_t, P_t}`: all that passes from the world to a reconstruction.

use crate::{Raster, Rigid3, color};
use serde::{Deserialize, Serialize};

/// What a capture has seen: light, radio, or both.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Modalities {
    /// Whether there are images.
    pub light: bool,
    /// Whether there are spectra.
    pub radio: bool,
}

impl Modalities {
    /// Light and radio.
    pub const BOTH: Self = Self { light: true, radio: true };

    /// Whether neither is missing.
    pub fn are_both(&self) -> bool {
        *self == Self::BOTH
    }
}

impl Default for Modalities {
    fn default() -> Self {
        Self::BOTH
    }
}

/// What a camera saw. All rasters are of the camera's size.
#[derive(Clone, Debug, PartialEq)]
pub struct Light {
    /// Image `I_t`: 8-bit sRGB.
    pub image: Raster<[u8; 3]>,
    /// z-depth in metres from the ray tracer or from a depth sensor, `0` or infinite where nothing was hit; only depth priors that say so and reports
    /// read it.
    pub depth_m: Option<Raster<f32>>,
    /// Object index per pixel, `u32::MAX` where nothing was hit; only the `Simulated` prior reads it.
    pub surface: Option<Raster<u32>>,
    /// Whether a pixel of the image counts: `false` where something is in the picture that is not of the room (a passer-by, the platform itself).
    /// Such pixels are neither learnt from nor compared. `None`: all count.
    pub mask: Option<Raster<bool>>,
}

impl Light {
    /// An image alone: without depth or surfaces, and all its pixels count.
    pub fn of_image(image: Raster<[u8; 3]>) -> Self {
        Self { image, depth_m: None, surface: None, mask: None }
    }
}

/// What an antenna array received.
#[derive(Clone, Debug, PartialEq)]
pub struct Radio {
    /// Spectrum `S_t`: linear power relative to 1 W transmitted, one value a pixel of the RF camera. What a value is, and so its unit, is the data
    /// set's `Quantity`: power per steradian (1/sr) of lobes, output power of a beam (1) of an array.
    pub spectrum: Raster<f32>,
}

/// One keyframe: what a camera saw, what an array received, and the pose they share.
#[derive(Clone, Debug)]
pub struct Keyframe {
    /// Index along the trajectory, from 0.
    pub index: usize,
    /// Time, seconds.
    pub time_s: f64,
    /// Pose `P_t` (OpenCV camera axes).
    pub world_from_camera: Rigid3,
    /// What the camera saw; none in a data set without light.
    pub light: Option<Light>,
    /// What the array received; none in a data set without radio.
    pub radio: Option<Radio>,
}

impl Keyframe {
    /// What there is of it.
    pub fn modalities(&self) -> Modalities {
        Modalities { light: self.light.is_some(), radio: self.radio.is_some() }
    }
}

/// The one dB range of a whole dataset: `scalar = (10·log10(S) − min_db) / (max_db − min_db)`, clamped to `[0, 1]`.
///
/// `max_db` is at or above the dataset's peak, so a peak is never clipped; bins at or under `min_db`, empty ones included, are 0.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DbRange {
    /// Level of scalar 0, dB: 10·log10 of the linear power, in the unit of the spectra.
    pub min_db: f64,
    /// Level of scalar 1, dB, likewise.
    pub max_db: f64,
}

impl DbRange {
    /// Scalar in `[0, 1]` of a linear power.
    pub fn scalar(&self, linear: f32) -> f32 {
        if linear <= 0.0 {
            return 0.0;
        }
        ((10.0 * f64::from(linear).log10() - self.min_db) / (self.max_db - self.min_db)).clamp(0.0, 1.0) as f32
    }

    /// A linear spectrum as the 8-bit Jet image in which it is published.
    pub fn jet_image(&self, spectrum: &Raster<f32>) -> Raster<[u8; 3]> {
        spectrum.map(|&linear| color::jet(self.scalar(linear)).map(color::quantize8))
    }

    /// A linear spectrum in dB; bins without power are at the range's lower end.
    pub fn db_image(&self, spectrum: &Raster<f32>) -> Raster<f32> {
        spectrum.map(|&linear| if linear > 0.0 { 10.0 * linear.log10() } else { self.min_db as f32 })
    }

    /// Level in dB of a scalar.
    pub fn db(&self, scalar: f32) -> f64 {
        self.min_db + f64::from(scalar) * (self.max_db - self.min_db)
    }

    /// Linear power of a scalar.
    pub fn linear(&self, scalar: f32) -> f64 {
        10f64.powf(self.db(scalar) / 10.0)
    }
}
