//! Settings of the radio field.

use super::SensorSettings;
use crate::{Error, IdleKey, Result};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What stands for the power that surfaces send.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Surface {
    /// Points of this field, one for each cube of the surface.
    Points,
    /// The Gaussians that light shares, which splat what is left of a spectrum without its lobes; of `mpc` spectra alone.
    Splats,
}

/// Settings of an [`ArrayTrainer`](super::ArrayTrainer).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ArrayConfig {
    /// Steps per keyframe.
    pub iterations_per_keyframe: usize,
    /// Probability that a step visits the latest keyframe; otherwise it visits any of them.
    pub latest_probability: f32,
    /// Share of a residual, in nepers, that a step takes off.
    pub rate: f32,
    /// Part of a spectrum, in units of the mean over emitters, that an emitter has to account for to follow residuals fully: those that account
    /// for less move less.
    pub damping: f32,
    /// Residual beyond which a pixel counts no more, nepers.
    pub clip: f32,
    /// Share of a correction that goes to where the emitter is seen from.
    pub visibility: f32,
    /// Distance of a new anchor from all others, metres.
    pub anchor_spacing_m: f64,
    /// Width of an anchor's kernel, metres.
    pub anchor_width_m: f64,
    /// What stands for surfaces; when not given, points where the spectra are an array's beams and splats where they are lobes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub surface: Option<Surface>,
    /// Side of the cube in which there is one surface point, metres.
    pub point_spacing_m: f64,
    /// Standard deviation of a surface point's extent per axis, in units of that side.
    pub point_extent: f64,
    /// Whether spectra are formed by the array's own response; else by a Gaussian lobe as wide as its beam. Of beams and mvdr alone.
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
    /// Whether sources move, with every keyframe, to where the rays that see them meet; when not given, where spectra are lobes, whose rays are
    /// narrow enough.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub refine_sources: Option<bool>,
}

impl Default for ArrayConfig {
    fn default() -> Self {
        Self {
            iterations_per_keyframe: 20,
            latest_probability: 0.2,
            rate: 0.5,
            damping: 0.3,
            clip: 3.0,
            visibility: 0.5,
            anchor_spacing_m: 0.3,
            anchor_width_m: 0.5,
            surface: None,
            point_spacing_m: 0.2,
            point_extent: 0.3,
            array_response: true,
            half_space: true,
            sources: true,
            rays: 12,
            ray_range_db: 25.0,
            votes: 1.5,
            ray_width_deg: 1.5,
            refine_sources: None,
        }
    }
}

impl ArrayConfig {
    /// Whether surfaces are the Gaussians that light shares, for spectra of this sensor.
    pub fn is_over_splats(&self, sensor: &SensorSettings) -> bool {
        let by_kind = if matches!(sensor, SensorSettings::Lobes { .. }) { Surface::Splats } else { Surface::Points };
        self.surface.unwrap_or(by_kind) == Surface::Splats
    }

    /// Keys that mean nothing beside the others of this configuration; `sensor` is that of the data set, where it is known yet.
    pub fn idle_keys(&self, sensor: Option<&SensorSettings>) -> Vec<IdleKey> {
        const SOURCES: &str = "it counts with sources = true alone";
        const PEELED: &str = "of mpc spectra whose surfaces are splats all lobes are sources' rays";
        const POINTS: &str = "it counts where surfaces are points alone: mpc spectra have splats, unless surface = \"points\"";
        const ARRAY: &str = "it counts where spectra are an array's alone, and those of this data set are lobes (mpc)";
        const EXTENT: &str =
            "an array's own response does not tell a wide emitter from a narrow one: it counts with array_response = false";
        let is_over_splats = sensor.is_some_and(|sensor| self.is_over_splats(sensor));
        let is_of_lobes = matches!(sensor, Some(SensorSettings::Lobes { .. }));
        let has_lobes = sensor.is_none() || is_of_lobes || !self.array_response;
        let of_strongest = if self.sources { PEELED } else { SOURCES };
        IdleKey::all([
            ("array_response", !is_of_lobes, ARRAY),
            ("point_spacing_m", !is_over_splats, POINTS),
            ("point_extent", !is_over_splats && has_lobes, if is_over_splats { POINTS } else { EXTENT }),
            ("rays", self.sources && !is_over_splats, of_strongest),
            ("ray_range_db", self.sources && !is_over_splats, of_strongest),
            ("votes", self.sources, SOURCES),
            ("ray_width_deg", self.sources, SOURCES),
            ("refine_sources", self.sources, SOURCES),
            ("anchor_spacing_m", self.visibility > 0.0, "it counts with a visibility above 0 alone"),
            ("anchor_width_m", self.visibility > 0.0, "it counts with a visibility above 0 alone"),
        ])
    }

    /// Checks every number against the range in which it means something.
    ///
    /// # Errors
    /// [`Error::Invalid`] naming the key.
    pub fn validate(&self) -> Result<()> {
        let share = |x: f32| (0.0..=1.0).contains(&x);
        let within = |x: f64, least: f64, most: f64| (least..=most).contains(&x);
        let checks = [
            ("iterations_per_keyframe", (1..=1_000_000).contains(&self.iterations_per_keyframe), "1 to 1 000 000"),
            ("latest_probability", share(self.latest_probability), "a probability between 0 and 1"),
            ("rate", share(self.rate) && self.rate > 0.0, "above 0, up to 1"),
            ("damping", within(self.damping.into(), 1e-6, 1e6), "1e-6 to 1e6"),
            ("clip", within(self.clip.into(), 1e-3, 1e3), "1e-3 to 1e3 nepers"),
            ("visibility", share(self.visibility), "a share between 0 and 1"),
            ("anchor_spacing_m", within(self.anchor_spacing_m, 1e-3, 1e6), "1e-3 to 1e6 m"),
            ("anchor_width_m", within(self.anchor_width_m, 1e-3, 1e6), "1e-3 to 1e6 m"),
            ("point_spacing_m", within(self.point_spacing_m, 1e-2, 1e6), "1e-2 to 1e6 m"),
            ("point_extent", within(self.point_extent, 0.0, 10.0), "0 to 10 sides"),
            ("rays", self.rays <= 32, "up to 32"),
            ("ray_range_db", within(self.ray_range_db.into(), 0.0, 100.0), "0 to 100 dB"),
            ("votes", within(self.votes, 0.0, 1e6), "not negative, up to 1e6"),
            ("ray_width_deg", within(self.ray_width_deg, 0.01, 45.0), "0.01 to 45 degrees"),
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
