//! The configuration of WRF-GS+. Defaults are the published ones, but for where the first Gaussians are.

use crate::rf_3dgs::DensityConfig;
use corf::{
    Antialias, Appearance, AppearanceRates, Error, Gaussians, IdleKey, OptimizerConfig, RasterConfig, Result, target::RadioTarget,
};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Learning rates, per step, and the weight inside the image loss.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WrfGsPlusRates {
    /// Rate of positions in the first step and in the last, metres; exponential in between.
    pub position: [f32; 2],
    /// Steps over which the rate of positions falls, whatever the budget (30 000).
    pub position_steps: usize,
    /// ln-scale.
    pub log_scale: f32,
    /// Quaternion components.
    pub rotation: f32,
    /// Opacity logit.
    pub opacity: f32,
    /// Signal without deformation: the degree-0 spherical-harmonic coefficients.
    pub sh_dc: f32,
    /// Rate of the network in the first step and in the last; exponential in between.
    pub network: [f64; 2],
    /// Steps over which the rate of the network falls, whatever the budget (600 000).
    pub network_steps: usize,
    /// γ: loss = (1 − γ)·L1 + γ·(1 − SSIM).
    pub ssim_weight: f32,
}

impl Default for WrfGsPlusRates {
    fn default() -> Self {
        Self {
            position: [8e-4, 8e-6],
            position_steps: 30_000,
            log_scale: 0.005,
            rotation: 0.001,
            opacity: 0.025,
            sh_dc: 2.5e-3,
            network: [8e-4, 1.6e-6],
            network_steps: 600_000,
            ssim_weight: 0.2,
        }
    }
}

/// The configuration of a WRF-GS+ reconstruction.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct WrfGsPlusConfig {
    /// Training steps (10 000).
    pub iterations: usize,
    /// Encoding of the spectra it learns: `jet` or `db`.
    #[serde(rename = "rf_target")]
    pub radio_target: RadioTarget,
    /// Number of the first Gaussians (200 000).
    pub random_points: usize,
    /// Half side of the cube around the cameras in which they lie where receivers move, in units of the cameras' extent (3).
    pub random_extent: f32,
    /// Standard deviation of their places around an array that stands still, metres (20).
    pub array_spread_m: f32,
    /// Their opacity (0.1).
    pub initial_opacity: f32,
    /// Gaussians nearer than this to the image plane are not drawn, metres (0.2).
    pub near_m: f32,
    /// Extent that density control takes fractions of, metres (2, whatever the scene).
    pub extent_m: f32,
    /// Hidden layers of the deformation network (8).
    pub layers: usize,
    /// Width of a hidden layer (256).
    pub width: usize,
    /// The layer, counted from 0, behind which the network's inputs are put in again (4).
    pub skip: usize,
    /// Frequencies of the encoding of a Gaussian's position (10).
    pub position_frequencies: usize,
    /// Frequencies of the encoding of the receiver's position (6).
    pub receiver_frequencies: usize,
    /// Width of the hidden layer that the encoded receiver goes through (256).
    pub receiver_width: usize,
    /// Numbers it comes out as (90).
    pub receiver_features: usize,
    /// Whether the predicted displacement moves a Gaussian; set by the method's name.
    pub move_positions: bool,
    /// Whether the network multiplies in f16 (sums in f32) where a GPU has matrix units; without them, and on the processor, in f32 always.
    pub half_precision: bool,
    /// Learning rates.
    pub rates: WrfGsPlusRates,
    /// Adaptive density control.
    pub density: DensityConfig,
}

impl Default for WrfGsPlusConfig {
    fn default() -> Self {
        Self {
            iterations: 10_000,
            radio_target: RadioTarget::Jet,
            random_points: 200_000,
            random_extent: 3.0,
            array_spread_m: 20.0,
            initial_opacity: 0.1,
            near_m: 0.2,
            extent_m: 2.0,
            layers: 8,
            width: 256,
            skip: 4,
            position_frequencies: 10,
            receiver_frequencies: 6,
            receiver_width: 256,
            receiver_features: 90,
            move_positions: false,
            half_precision: false,
            rates: WrfGsPlusRates::default(),
            density: DensityConfig::default(),
        }
    }
}

impl WrfGsPlusConfig {
    /// Most weights of a layer: a gradient of them is held for each thread.
    const MOST_WIDTH: usize = 2048;

    /// Checks every number against the range in which it means something.
    ///
    /// # Errors
    /// [`Error::Invalid`] naming the key.
    pub fn validate(&self) -> Result<()> {
        let steps = |n: usize| (1..=100_000_000).contains(&n);
        let width = |n: usize| (1..=Self::MOST_WIDTH).contains(&n);
        let probability = |x: f32| x > 0.0 && x < 1.0;
        let positive = |x: f32| (1e-12..=1e6).contains(&x);
        let r = &self.rates;
        let checks = [
            ("iterations", steps(self.iterations), "1 to 100 000 000 (10 000)"),
            ("random_points", (16..=20_000_000).contains(&self.random_points), "16 to 20 000 000 (200 000)"),
            ("random_extent", positive(self.random_extent), "positive (3)"),
            ("array_spread_m", positive(self.array_spread_m), "positive, metres (20)"),
            ("initial_opacity", probability(self.initial_opacity), "strictly between 0 and 1 (0.1)"),
            ("extent_m", positive(self.extent_m), "positive, metres (2)"),
            ("layers", (1..=64).contains(&self.layers), "1 to 64 (8)"),
            ("width", width(self.width), "1 to 2048 (256)"),
            ("skip", self.skip < self.layers, "a number below `layers` (4)"),
            ("position_frequencies", self.position_frequencies <= 16, "0 to 16 (10)"),
            ("receiver_frequencies", self.receiver_frequencies <= 16, "0 to 16 (6)"),
            ("receiver_width", width(self.receiver_width), "1 to 2048 (256)"),
            ("receiver_features", width(self.receiver_features), "1 to 2048 (90)"),
            ("rates.position", r.position.iter().all(|x| positive(*x) && *x <= 10.0), "two positive numbers, metres, up to 10"),
            ("rates.position_steps", steps(r.position_steps), "1 to 100 000 000 (30 000)"),
            ("rates.network", r.network.iter().all(|x| (1e-12..=1.0).contains(x)), "two positive numbers, up to 1"),
            ("rates.network_steps", steps(r.network_steps), "1 to 100 000 000 (600 000)"),
        ];
        if let Some((key, _, range)) = checks.iter().find(|c| !c.1) {
            let place = format!("WRF-GS+ config, key `{key}`");
            return Err(Error::invalid(place, "the value is out of range", format!("give {range}")));
        }
        self.density.validate()?;
        self.raster().validate()?;
        self.optimizer().validate()
    }

    /// The rasteriser's settings: stock 3DGS filters without antialiasing.
    pub fn raster(&self) -> RasterConfig {
        RasterConfig { antialias: Antialias::Off, near_m: self.near_m, ..RasterConfig::default() }
    }

    /// The device's constants: dense Adam as published; the rate of positions is each step's own.
    pub fn optimizer(&self) -> OptimizerConfig {
        let r = &self.rates;
        let appearance = AppearanceRates { sh_dc: r.sh_dc, sh_rest_divisor: 1.0, opacity: r.opacity };
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

    /// Keys that mean nothing where the array stands still (`of_array`), or where receivers move.
    pub fn idle_keys(&self, of_array: bool) -> Vec<IdleKey> {
        const MOVING: &str = "it is of receivers that move, and here the array stands still";
        const FIXED: &str = "it is of an array that stands still, and here receivers move";
        const CHANNELS: &str = "of an array that stands still the level is the magnitude of two channels, as published";
        IdleKey::all([
            ("random_extent", !of_array, MOVING),
            ("rf_target", !of_array, CHANNELS),
            ("array_spread_m", of_array, FIXED),
        ])
    }

    /// No Gaussians yet, of the target's channels and degree 0: what a device is made with. Their light is not used.
    pub fn empty_field(&self) -> Gaussians {
        let mut field = Gaussians::empty(self.radio_target.channels(), 0);
        field.radio = Appearance::empty(self.radio_target.channels(), 0);
        field
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn defaults_are_valid_and_a_bad_value_is_located() {
        WrfGsPlusConfig::default().validate().unwrap();
        for (text, key) in [
            (r#"{"iterations": 0}"#, "`iterations`"),
            (r#"{"skip": 8}"#, "`skip`"),
            (r#"{"width": 100000}"#, "`width`"),
            (r#"{"rates": {"network": [0.1, -1]}}"#, "`rates.network`"),
            (r#"{"rates": {"sh_dc": -1}}"#, "sh_dc"),
            (r#"{"density": {"every": 0}}"#, "`density.every`"),
            (r#"{"near_m": 0}"#, "near_m"),
        ] {
            let config: WrfGsPlusConfig = serde_json::from_str(text).unwrap();
            let error = config.validate().unwrap_err().to_string();
            assert!(error.contains(key) && error.contains("help"), "{error}");
        }
        assert!(serde_json::from_str::<WrfGsPlusConfig>(r#"{"breadth": 1}"#).is_err());
    }
}
