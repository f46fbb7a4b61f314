//! The configuration of an offline reconstruction. Defaults are the published ones: those of stock 3D Gaussian splatting (Kerbl et al. 2023) for
//! the optical stage, and of RF-3DGS (Zhang et al. 2026) for the RF stage.

use super::density::DensityConfig;
use corf::{
    Antialias, Appearance, AppearanceRates, Error, Gaussians, IdleKey, OptimizerConfig, RasterConfig, Result, target::RadioTarget,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::path::PathBuf;

/// Source of the first Gaussians. Neither reads the ray tracer's depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum InitialPoints {
    /// Corners of the training images, triangulated with their neighbours at the known poses: what structure from motion gives the published
    /// method.
    Triangulated,
    /// Uniform in a cube around the cameras, grey: for images without corners.
    Random,
}

/// Adam's moments of opacity and colour at the start of the RF stage.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum RadioMoments {
    /// Those of the optical stage, and its step counter: what restoring a checkpoint with its optimiser does.
    Restored,
    /// Zero, and a counter that begins anew.
    Zero,
}

/// Colour behind the RF field.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum RadioBackground {
    /// Black, which is no colour of the Jet scale.
    Black,
    /// The colour of a direction without power, Jet(0).
    Floor,
}

/// Learning rates of both stages, per step, and the weight inside the image loss.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Rf3dgsRates {
    /// Rate of positions in the first step and in the last, as a fraction of the scene's extent; exponential in between.
    pub position: [f32; 2],
    /// Steps over which the rate of positions falls, whatever the length of the optical stage (30 000).
    pub position_steps: usize,
    /// ln-scale.
    pub log_scale: f32,
    /// Quaternion components.
    pub rotation: f32,
    /// Opacity logit.
    pub opacity: f32,
    /// Degree-0 spherical-harmonic coefficients.
    pub sh_dc: f32,
    /// Higher bands learn this many times slower.
    pub sh_rest_divisor: f32,
    /// γ: loss = (1 − γ)·L1 + γ·(1 − SSIM).
    pub ssim_weight: f32,
}

impl Default for Rf3dgsRates {
    fn default() -> Self {
        Self {
            position: [1.6e-4, 1.6e-6],
            position_steps: 30_000,
            log_scale: 0.005,
            rotation: 0.001,
            opacity: 0.05,
            sh_dc: 2.5e-3,
            sh_rest_divisor: 20.0,
            ssim_weight: 0.2,
        }
    }
}

/// The configuration of an [`Rf3dgsReconstructor`](super::Rf3dgsReconstructor).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Rf3dgsConfig {
    /// Steps of the optical stage (30 000).
    #[serde(rename = "optical_steps")]
    pub light_steps: usize,
    /// Steps of the RF stage, on frozen geometry (10 000).
    #[serde(rename = "rf_steps")]
    pub radio_steps: usize,
    /// Degree of both modalities' spherical harmonics, 0–3 (3).
    pub sh_degree: usize,
    /// One more degree is learnt in the optical stage after every so many steps (1000); in the RF stage all are from the start.
    pub degree_interval: usize,
    /// Source of the first Gaussians. Default `triangulated`.
    pub initial_points: InitialPoints,
    /// Gaussians of light that another program trained (PLY), in the place of the optical stage: the RF stage begins with them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub initial_gaussians: Option<PathBuf>,
    /// Number of points of `random` (100 000).
    pub random_points: usize,
    /// Half side of the cube of `random`, in units of the scene's extent (3).
    pub random_extent: f32,
    /// Opacity of the first Gaussians (0.1).
    pub initial_opacity: f32,
    /// Gaussians nearer than this to the image plane are not drawn, metres (0.2).
    pub near_m: f32,
    /// Adam's moments at the start of the RF stage; set by the method's name.
    #[serde(rename = "rf_moments")]
    pub radio_moments: RadioMoments,
    /// Colour behind the RF field; set by the method's name.
    #[serde(rename = "rf_background")]
    pub radio_background: RadioBackground,
    /// Learning rates.
    pub rates: Rf3dgsRates,
    /// Adaptive density control in the optical stage.
    pub density: DensityConfig,
}

impl Default for Rf3dgsConfig {
    fn default() -> Self {
        Self {
            light_steps: 30_000,
            radio_steps: 10_000,
            sh_degree: 3,
            degree_interval: 1000,
            initial_points: InitialPoints::Triangulated,
            initial_gaussians: None,
            random_points: 100_000,
            random_extent: 3.0,
            initial_opacity: 0.1,
            near_m: 0.2,
            radio_moments: RadioMoments::Restored,
            radio_background: RadioBackground::Black,
            rates: Rf3dgsRates::default(),
            density: DensityConfig::default(),
        }
    }
}

impl Rf3dgsConfig {
    /// The encoding of the spectra it learns: the published method's Jet images.
    pub const RADIO_TARGET: RadioTarget = RadioTarget::Jet;

    /// Most steps of a stage.
    const MOST_STEPS: usize = 100_000_000;

    /// Checks every number against the range in which it means something.
    ///
    /// # Errors
    /// [`Error::Invalid`] naming the key.
    pub fn validate(&self) -> Result<()> {
        let steps = |n: usize| n <= Self::MOST_STEPS;
        let probability = |x: f32| x > 0.0 && x < 1.0;
        let positive = |x: f32| (1e-12..=1e6).contains(&x);
        let r = &self.rates;
        let checks = [
            ("optical_steps", steps(self.light_steps) && self.light_steps > 0, "1 to 100 000 000 (30 000)"),
            ("rf_steps", steps(self.radio_steps), "0 to 100 000 000 (10 000)"),
            ("sh_degree", self.sh_degree <= 3, "0 to 3"),
            ("degree_interval", self.degree_interval > 0, "at least 1 (1000)"),
            ("random_points", (16..=100_000_000).contains(&self.random_points), "16 to 100 000 000 (100 000)"),
            ("random_extent", positive(self.random_extent), "positive (3)"),
            ("initial_opacity", probability(self.initial_opacity), "strictly between 0 and 1 (0.1)"),
            ("rates.position", r.position.iter().all(|x| positive(*x) && *x <= 10.0), "two positive numbers, up to 10"),
            ("rates.position_steps", r.position_steps > 0, "at least 1 (30 000)"),
        ];
        if let Some((key, _, range)) = checks.iter().find(|c| !c.1) {
            let place = format!("offline reconstruction config, key `{key}`");
            return Err(Error::invalid(place, "the value is out of range", format!("give {range}")));
        }
        self.density.validate()?;
        self.raster().validate()?;
        self.optimizer().validate()
    }

    /// Keys that mean nothing beside the others of this configuration.
    pub fn idle_keys(&self) -> Vec<IdleKey> {
        const RANDOM: &str = "it counts with initial_points = \"random\" alone";
        const LIGHT: &str = "it is of the optical stage, which initial_gaussians take the place of";
        if self.initial_gaussians.is_some() {
            let of_light_stage = [
                "degree_interval",
                "initial_points",
                "random_points",
                "random_extent",
                "initial_opacity",
                "rates.position",
                "rates.position_steps",
                "rates.log_scale",
                "rates.rotation",
                "density",
            ];
            return IdleKey::all(of_light_stage.map(|key| (key, false, LIGHT)));
        }
        let is_random = self.initial_points == InitialPoints::Random;
        IdleKey::all([("random_points", is_random, RANDOM), ("random_extent", is_random, RANDOM)])
    }

    /// The rasteriser's settings: stock 3DGS filters without antialiasing.
    pub fn raster(&self) -> RasterConfig {
        RasterConfig { antialias: Antialias::Off, near_m: self.near_m, ..RasterConfig::default() }
    }

    /// The device's constants: Adam as published; the rate of positions is each step's own.
    pub fn optimizer(&self) -> OptimizerConfig {
        let r = &self.rates;
        let appearance = AppearanceRates { sh_dc: r.sh_dc, sh_rest_divisor: r.sh_rest_divisor, opacity: r.opacity };
        OptimizerConfig {
            position_rate_m: 0.0,
            position_decay: 0.0,
            log_scale_rate: r.log_scale,
            rotation_rate: r.rotation,
            light: appearance,
            radio: appearance,
            beta1: 0.9,
            beta2: 0.999,
            epsilon: 1e-15,
            ssim_weight: r.ssim_weight,
        }
    }

    /// No Gaussians yet, with the channels and degrees of this configuration: what a device is made with.
    pub fn empty_field(&self) -> Gaussians {
        let mut field = Gaussians::empty(Self::RADIO_TARGET.channels(), self.sh_degree);
        field.radio = Appearance::empty(Self::RADIO_TARGET.channels(), self.sh_degree);
        field
    }

    /// The colour behind the RF field.
    pub fn radio_background_color(&self) -> [f32; 3] {
        match self.radio_background {
            RadioBackground::Black => [0.0; 3],
            RadioBackground::Floor => Self::RADIO_TARGET.floor_color(),
        }
    }

    /// Steps of both stages.
    pub fn total_steps(&self) -> usize {
        self.light_steps + self.radio_steps
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_valid_and_a_bad_value_is_located() {
        Rf3dgsConfig::default().validate().unwrap();
        let fault = |text: &str| {
            let config: Rf3dgsConfig = serde_json::from_str(text).unwrap();
            config.validate().unwrap_err().to_string()
        };
        for (text, key) in [
            (r#"{"optical_steps": 0}"#, "`optical_steps`"),
            (r#"{"rates": {"position": [0.1, -1]}}"#, "`rates.position`"),
            (r#"{"rates": {"sh_dc": -1}}"#, "sh_dc"),
            (r#"{"density": {"every": 0}}"#, "`density.every`"),
            (r#"{"near_m": 0}"#, "near_m"),
        ] {
            let error = fault(text);
            assert!(error.contains(key) && error.contains("help"), "{error}");
        }
        assert!(serde_json::from_str::<Rf3dgsConfig>(r#"{"optical_step": 1}"#).is_err());
    }
}
