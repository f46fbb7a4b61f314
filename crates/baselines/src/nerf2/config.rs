//! The constants of NeRF² and of its training.

use crate::mlp::Cosine;
use corf::{Error, Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Constants of NeRF²; the defaults are the published ones, but for where rays of receivers that move begin and end.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub struct Nerf2Config {
    /// Training steps.
    pub iterations: usize,
    /// Rays of a step; each is a pixel of a training spectrum.
    pub rays: usize,
    /// Points at which a ray is sampled.
    pub samples: usize,
    /// Hidden layers of the attenuation network.
    pub layers: usize,
    /// Width of a hidden layer; the radiance network's last one has half of it.
    pub width: usize,
    /// The attenuation layer, counted from 0, behind which the encoded position is put in again.
    pub skip: usize,
    /// Frequencies of the encodings of position, direction and transmitter.
    pub frequencies: usize,
    /// Beginning of rays, metres from the receiver (published: 0, the default where an array stands still).
    pub near_m: f32,
    /// End of rays, metres from the receiver (published: 5, which does not reach the walls of a hall; the default where an array stands still).
    pub far_m: f32,
    /// Adam's rate at the beginning.
    pub rate: f64,
    /// Adam's rate where the cosine is lowest.
    pub least_rate: f64,
    /// Weight decay.
    pub weight_decay: f64,
    /// Steps in which the rate falls from the highest to the lowest; it rises again within as many (published: 10000 of 30000). 0: all.
    pub cosine_steps: usize,
    /// Whether points are drawn anew within equal parts of a ray in each step, instead of lying at the same distances always.
    pub jitter: bool,
    /// Whether a ray's last point counts; the published rendering gives it an infinite distance and with it no power.
    pub last_sample: bool,
    /// Whether the network multiplies in f16 (sums in f32) where a GPU has matrix units; without them, and on the processor, in f32 always.
    pub half_precision: bool,
}

impl Default for Nerf2Config {
    fn default() -> Self {
        Self {
            iterations: 30_000,
            rays: 8192,
            samples: 64,
            layers: 8,
            width: 256,
            skip: 4,
            frequencies: 10,
            near_m: 0.05,
            far_m: 20.0,
            rate: 8e-4,
            least_rate: 1e-6,
            weight_decay: 5e-5,
            cosine_steps: 10_000,
            jitter: false,
            last_sample: false,
            half_precision: false,
        }
    }
}

/// Beginning and end of the published rays, metres from the receiver.
pub const PUBLISHED_RAYS_M: [f32; 2] = [0.0, 5.0];
/// Most points of a step.
const MOST_POINTS: usize = 1 << 24;
/// Most weights between hidden layers: a gradient of them is held for each thread.
const MOST_WEIGHTS: usize = 1 << 24;

impl Nerf2Config {
    /// The same with what is a defect in the published code corrected: the rate falls over the whole budget instead of rising again, points are
    /// drawn anew in each step, so that the field is seen between fixed distances too, and the last point of a ray counts.
    #[cfg(test)]
    pub fn corrected(self) -> Self {
        Self { cosine_steps: 0, jitter: true, last_sample: true, ..self }
    }

    /// # Errors
    /// A value that is out of its range, by its key.
    pub fn validate(&self) -> Result<()> {
        let counts = [
            ("iterations", self.iterations, 1..=100_000_000),
            ("rays", self.rays, 1..=1 << 20),
            ("samples", self.samples, 2..=4096),
            ("layers", self.layers, 1..=64),
            ("width", self.width, 2..=4096),
            ("frequencies", self.frequencies, 0..=16),
            ("cosine_steps", self.cosine_steps, 0..=100_000_000),
        ];
        for (key, value, range) in counts {
            if !range.contains(&value) {
                let help = format!("give {} to {}", range.start(), range.end());
                return Err(Error::invalid(key, format!("{value} is out of range"), help));
            }
        }
        if self.rays * self.samples > MOST_POINTS {
            let what = format!("{} rays of {} samples are {} points a step", self.rays, self.samples, self.rays * self.samples);
            return Err(Error::invalid("rays", what, format!("give at most {MOST_POINTS} in all")));
        }
        if !self.width.is_multiple_of(2) {
            return Err(Error::invalid("width", format!("{} cannot be halved", self.width), "give an even number"));
        }
        if self.skip >= self.layers {
            let what = format!("layer {} of {} counted from 0 does not exist", self.skip, self.layers);
            return Err(Error::invalid("skip", what, "give a number below `layers`"));
        }
        // The radiance network has one and a half, the attenuation network one less than it has layers.
        let weights = (self.layers + 1) * self.width * self.width;
        if weights > MOST_WEIGHTS {
            let what = format!("{} layers of {} have about {weights} weights", self.layers, self.width);
            return Err(Error::invalid("width, layers", what, format!("give so few that these are at most {MOST_WEIGHTS}")));
        }
        if !(self.near_m >= 0.0 && self.far_m > self.near_m && self.far_m <= 1e4) {
            let what = format!("rays from {} to {} m", self.near_m, self.far_m);
            return Err(Error::invalid("near_m, far_m", what, "give 0 ≤ near_m < far_m ≤ 10000"));
        }
        let numbers = [
            ("rate", self.rate, 1e-12..=1.0),
            ("least_rate", self.least_rate, 0.0..=1.0),
            ("weight_decay", self.weight_decay, 0.0..=1.0),
        ];
        for (key, value, range) in numbers {
            if !range.contains(&value) {
                let help = format!("give {:e} to {:e}", range.start(), range.end());
                return Err(Error::invalid(key, format!("{value} is out of range"), help));
            }
        }
        Ok(())
    }

    /// The schedule of Adam's rate.
    pub fn schedule(&self) -> Cosine {
        let steps = if self.cosine_steps == 0 { self.iterations } else { self.cosine_steps };
        Cosine { rate: self.rate, least: self.least_rate, steps: steps.max(1) as u64 }
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn what_is_out_of_range_is_named() {
        let standard = Nerf2Config::default();
        standard.validate().unwrap();
        let refused = [
            ("samples", Nerf2Config { samples: 1, ..standard }),
            ("width", Nerf2Config { width: 7, ..standard }),
            ("skip", Nerf2Config { skip: 8, ..standard }),
            ("width, layers", Nerf2Config { width: 4096, layers: 64, ..standard }),
            ("rays", Nerf2Config { rays: 1 << 20, ..standard }),
            ("far_m", Nerf2Config { far_m: f32::NAN, ..standard }),
            ("rate", Nerf2Config { rate: f64::NAN, ..standard }),
        ];
        for (key, config) in refused {
            assert!(config.validate().unwrap_err().to_string().contains(key), "{key}");
        }
    }

    #[test]
    fn the_published_rate_rises_again_and_the_corrected_one_does_not() {
        let published = Nerf2Config::default();
        let rates = |c: Nerf2Config| [0, 10_000, 20_000, 30_000].map(|s| c.schedule().at(s));
        let [start, low, high, end] = rates(published);
        assert!(start == 8e-4 && (high - 8e-4).abs() < 1e-12 && (low - 1e-6).abs() < 1e-12 && (end - 1e-6).abs() < 1e-12);
        let corrected = rates(published.corrected());
        assert!(corrected.windows(2).all(|w| w[1] < w[0]) && (corrected[3] - 1e-6).abs() < 1e-12);
    }
}
