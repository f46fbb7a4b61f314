//! Settings of the radio field.

use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// Settings of an [`ArrayTrainer`](super::ArrayTrainer).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ArrayConfig {
    /// Steps per keyframe.
    pub iterations_per_keyframe: usize,
    /// Probability that a step visits the latest keyframe; otherwise it visits any of them.
    pub latest_probability: f32,
    /// Share of a residual, in nepers, that a step takes off.
    pub rate: f32,
    /// Weight of an emitter's own pixels below which it moves less: in units of the mean over emitters.
    pub damping: f32,
    /// Residual beyond which a pixel counts no more, nepers.
    pub clip: f32,
    /// Floor under powers that are compared, dB under the lower end of the data set's range.
    pub floor_db: f32,
    /// Share of a correction that goes to where the emitter is seen from.
    pub visibility: f32,
    /// Share of those corrections that a step forgets.
    pub forget: f32,
    /// Distance of a new anchor from all others, metres.
    pub anchor_spacing_m: f64,
    /// Width of an anchor's kernel, metres.
    pub anchor_width_m: f64,
    /// Side of the cube in which there is one surface point, metres; 0 for none.
    pub point_spacing_m: f64,
    /// Standard deviation of a surface point's extent per axis, in units of that side.
    pub point_extent: f64,
    /// Whether spectra are formed by the array's own response; else by a Gaussian lobe as wide as its beam. Without effect on `mpc`.
    pub array_response: bool,
    /// Whether emitters outside the frame count, all over the half-space before the array.
    pub half_space: bool,
    /// Whether sources are born.
    pub sources: bool,
    /// Rays of a keyframe at most.
    pub rays: usize,
    /// Range under the strongest ray in which rays are, dB.
    pub ray_range_db: f32,
    /// Agreement of other keyframes that a source needs to be born.
    pub votes: f64,
    /// Standard deviation of a ray's direction, degrees.
    pub ray_width_deg: f64,
    /// Rate of a source's direction, radians per step.
    pub turn_rate: f32,
    /// Power of the exponent of observed level by which pixels are weighted.
    pub emphasis: f32,
}

impl Default for ArrayConfig {
    fn default() -> Self {
        Self {
            iterations_per_keyframe: 75,
            latest_probability: 0.2,
            rate: 0.5,
            damping: 0.1,
            clip: 3.0,
            floor_db: 0.0,
            visibility: 0.5,
            forget: 0.0,
            anchor_spacing_m: 0.3,
            anchor_width_m: 0.35,
            point_spacing_m: 0.3,
            point_extent: 0.4,
            array_response: true,
            half_space: true,
            sources: true,
            rays: 12,
            ray_range_db: 25.0,
            votes: 1.5,
            ray_width_deg: 1.5,
            turn_rate: 0.001,
            emphasis: 0.0,
        }
    }
}

impl ArrayConfig {
    /// Checks every number against the range in which it means something.
    ///
    /// # Errors
    /// [`Error::Invalid`] naming the key.
    pub fn validate(&self) -> Result<()> {
        let share = |x: f32| (0.0..=1.0).contains(&x);
        let checks = [
            ("iterations_per_keyframe", (1..=1_000_000).contains(&self.iterations_per_keyframe), "1 to 1 000 000"),
            ("latest_probability", share(self.latest_probability), "a probability between 0 and 1"),
        ];
        match checks.iter().find(|c| !c.1) {
            None => Ok(()),
            Some((key, _, range)) => Err(Error::invalid(
                format!("radio configuration, key `{key}`"),
                "the value is out of range",
                format!("give {range}"),
            )),
        }
    }
}
