//! The constants of rasterisation and optimisation; every device honours the same ones.

use crate::{Error, Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Antialiasing filter: the pixel's own extent in the projected covariance (`S = S₂ + h·I`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Antialias {
    /// h = 0.3 px², opacity as it is: a Gaussian thinner than a pixel grows brighter as it is seen from further away.
    Off,
    /// h = 0.1 px², opacity times `ρ = sqrt(det S₂ / det S)`, and ρ differentiated (Mip-Splatting's compensation).
    #[default]
    On,
    /// [`Antialias::On`] with ρ held constant in the gradient.
    Detached,
}

impl Antialias {
    /// h in px².
    pub fn dilation(self) -> f32 {
        match self {
            Self::Off => 0.3,
            Self::On | Self::Detached => 0.1,
        }
    }
}

/// Settings of the rasteriser.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct RasterConfig {
    /// Pixel filter.
    pub antialias: Antialias,
    /// Gaussians whose centre is nearer than this to the image plane are not drawn, metres.
    pub near_m: f32,
    /// Pixels across and down a tile of the GPU device: 8 or 16 by 4, 8 or 16. What is computed does not depend on it, but for rounding;
    /// small tiles follow thin ellipses and fill a GPU with small images, large ones make fewer pairs to sort where Gaussians are wide.
    /// Without a value, steps choose by the size of their images.
    pub tile_px: Option<[u32; 2]>,
    /// Device memory for keyframes on the GPU device, MB (10⁶ bytes): more than that wait in main memory and come back when a step names
    /// them. What is computed does not depend on it.
    pub keyframe_memory_mb: u64,
}

/// Half of a card of 8 GB.
const KEYFRAME_MEMORY_MB: u64 = 4000;
/// More than any device has.
const MAX_KEYFRAME_MEMORY_MB: u64 = 10_000_000;

impl Default for RasterConfig {
    fn default() -> Self {
        Self { antialias: Antialias::On, near_m: 0.1, tile_px: None, keyframe_memory_mb: KEYFRAME_MEMORY_MB }
    }
}

/// One modality's learning rates.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct AppearanceRates {
    /// Degree-0 spherical-harmonic coefficients, per step.
    pub sh_dc: f32,
    /// Higher bands learn this many times slower.
    pub sh_rest_divisor: f32,
    /// Opacity logit, per step.
    pub opacity: f32,
}

impl Default for AppearanceRates {
    fn default() -> Self {
        Self { sh_dc: 5e-3, sh_rest_divisor: 20.0, opacity: 0.1 }
    }
}

/// Sparse Adam without bias correction over the Gaussians a step sees, and the weights inside the image loss.
///
/// The defaults are those of on-the-fly novel-view synthesis (Meuleman et al. 2025), which CORF-GS builds on.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct OptimizerConfig {
    /// Position rate in metres per step with which a device begins. The published 5e-5 holds in a world where the mean of the first five
    /// camera baselines is 0.1: in metres it is 5e-5 · baseline_m / 0.1, which the reconstructor sets once it knows the baselines
    /// ([`Device::set_position_rate_m`](crate::Device::set_position_rate_m)). So it is no key of a method.
    #[serde(skip)]
    #[schemars(skip)]
    pub position_rate_m: f32,
    /// Decay of a Gaussian's position learning rate: the fraction lost at each step in which it is visible.
    pub position_decay: f32,
    /// ln-scale, per step.
    pub log_scale_rate: f32,
    /// Quaternion components, per step.
    pub rotation_rate: f32,
    /// Rates of the appearance in light.
    #[serde(rename = "optical")]
    pub light: AppearanceRates,
    /// Rates of the appearance at 60 GHz. Its higher bands learn ten times as fast as published: what a surface sends depends more on the
    /// direction at 60 GHz than in light.
    #[serde(rename = "rf")]
    pub radio: AppearanceRates,
    /// Adam's β₁.
    pub beta1: f32,
    /// Adam's β₂.
    pub beta2: f32,
    /// Adam's ε.
    pub epsilon: f32,
    /// γ: loss = (1 − γ)·L1 + γ·(1 − SSIM) (paper Eqs. (19), (20)).
    pub ssim_weight: f32,
}

impl Default for OptimizerConfig {
    fn default() -> Self {
        Self {
            position_rate_m: 5e-5,
            position_decay: 2e-5,
            log_scale_rate: 0.01,
            rotation_rate: 0.002,
            light: AppearanceRates::default(),
            radio: AppearanceRates { sh_rest_divisor: 2.0, ..AppearanceRates::default() },
            beta1: 0.5,
            beta2: 0.99,
            epsilon: 1e-15,
            ssim_weight: 0.2,
        }
    }
}

/// The largest learning rate: a step of 10 is e^10 in scale, and all or nothing in opacity.
const MAX_RATE: f32 = 10.0;
/// The smallest ε: well within the normal numbers of single precision, whose smallest is 1.2e-38.
const MIN_EPSILON: f32 = 1e-30;

impl OptimizerConfig {
    /// # Errors
    /// A rate that is negative or not finite, a β outside `[0, 1)`, a weight outside `[0, 1]`; the error names the key.
    pub fn validate(&self) -> Result<()> {
        let rate = |key: &str, value: f32| {
            if (0.0..=MAX_RATE).contains(&value) {
                return Ok(());
            }
            let what = format!("{value:?} is no learning rate");
            Err(Error::invalid(format!("optimizer.{key}"), what, format!("give a number from 0 to {MAX_RATE}")))
        };
        let unit = |key: &str, value: f32, open: bool| {
            if (0.0..=1.0).contains(&value) && !(open && value >= 1.0) {
                return Ok(());
            }
            let range = if open { "[0, 1)" } else { "[0, 1]" };
            Err(Error::invalid(
                format!("optimizer.{key}"),
                format!("{value} is out of range"),
                format!("give a number in {range}"),
            ))
        };
        rate("position_rate_m", self.position_rate_m)?;
        rate("log_scale_rate", self.log_scale_rate)?;
        rate("rotation_rate", self.rotation_rate)?;
        if !(MIN_EPSILON..=1.0).contains(&self.epsilon) {
            let what = format!("{:?} does not keep steps of parameters without a gradient finite", self.epsilon);
            return Err(Error::invalid("optimizer.epsilon", what, format!("give a number from {MIN_EPSILON:e} to 1")));
        }
        for (name, a) in [("optical", &self.light), ("rf", &self.radio)] {
            rate(&format!("{name}.sh_dc"), a.sh_dc)?;
            rate(&format!("{name}.opacity"), a.opacity)?;
            if !(1e-3..=1e6).contains(&a.sh_rest_divisor) {
                let key = format!("optimizer.{name}.sh_rest_divisor");
                return Err(Error::invalid(
                    key,
                    format!("{:?} is out of range", a.sh_rest_divisor),
                    "give a number from 1e-3 to 1e6",
                ));
            }
        }
        unit("position_decay", self.position_decay, true)?;
        unit("beta1", self.beta1, true)?;
        unit("beta2", self.beta2, true)?;
        unit("ssim_weight", self.ssim_weight, false)
    }
}

impl RasterConfig {
    /// Bytes of device memory for keyframes.
    pub fn keyframe_bytes(&self) -> u64 {
        self.keyframe_memory_mb * 1_000_000
    }

    /// # Errors
    /// A near plane that is not 1 µm to 1000 km away; memory for keyframes that no device has.
    pub fn validate(&self) -> Result<()> {
        if !(1e-6..=1e6).contains(&self.near_m) {
            let what = format!("{:?} is no distance in front of the camera", self.near_m);
            return Err(Error::invalid("raster.near_m", what, "give metres > 0, from 1e-6 to 1e6"));
        }
        if self.keyframe_memory_mb > MAX_KEYFRAME_MEMORY_MB {
            let what = format!("{} MB are more than any device has", self.keyframe_memory_mb);
            let help = format!("give the megabytes of the device that keyframes may take, at most {MAX_KEYFRAME_MEMORY_MB}");
            return Err(Error::invalid("raster.keyframe_memory_mb", what, help));
        }
        Ok(())
    }
}
