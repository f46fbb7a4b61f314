//! Gain of an antenna element over a grid of angles.

use super::file::PatternFile;
use crate::{Error, Result};
use glam::DVec3;
use serde::ser::SerializeMap;
use serde::{Deserialize, Serialize, Serializer};
use std::f64::consts::{PI, TAU};
use std::fmt;
use std::hash::{Hash, Hasher};
use std::ops::Deref;
use std::sync::{Mutex, PoisonError};

/// A full turn to this, degrees.
const CLOSED_DEG: f64 = 1e-6;
/// No grid has more points.
const MAX_POINTS: usize = 4_000_000;

/// Gain over angles in the antenna's frame. Between samples decibels are interpolated bilinearly.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SampledPattern {
    /// SHA-256 of the file.
    pub sha256: String,
    /// Angles from the x–y plane towards +z, degrees, ascending.
    pub tilt_deg: Vec<f64>,
    /// Angles from +x towards +y, degrees, ascending, over a turn at most.
    pub pan_deg: Vec<f64>,
    /// Gain by tilt and, within one, by pan, dB, as the file has it.
    pub gain_db: Vec<f64>,
    /// What is added to the file's decibels: 0, or what makes the mean gain over the sphere 1.
    pub shift_db: f64,
    /// Mean gain over the sphere with it, linear: the radiated share of the power fed.
    pub mean_gain: f64,
    /// Samples that the file lacks and that were interpolated along pan.
    pub filled: usize,
}

impl SampledPattern {
    /// Gain over the file's grid, dB, as it stands there; `None` outside.
    fn level_db(&self, local: DVec3) -> Option<f64> {
        let tilt = local.z.clamp(-1.0, 1.0).asin().to_degrees();
        let (i, a) = between(&self.tilt_deg, tilt)?;
        let (first, last) = (self.pan_deg[0], self.pan_deg[self.pan_deg.len() - 1]);
        let pan = first + (local.y.atan2(local.x).to_degrees() - first).rem_euclid(360.0);
        let columns = self.pan_deg.len();
        let (j, k, b) = match between(&self.pan_deg, pan) {
            Some((j, b)) => (j, (j + 1).min(columns - 1), b),
            // Behind the last sample the first comes again, where the grid goes round.
            None if self.goes_round() => (columns - 1, 0, (pan - last) / (first + 360.0 - last)),
            None => return None,
        };
        let at = |i: usize, j: usize| self.gain_db[i * columns + j];
        let row = |i: usize| at(i, j) * (1.0 - b) + at(i, k) * b;
        let next = (i + 1).min(self.tilt_deg.len() - 1);
        Some(row(i) * (1.0 - a) + row(next) * a)
    }

    /// Whether pan covers the whole turn: the gap behind its last sample is no wider than the widest between others.
    fn goes_round(&self) -> bool {
        let widest = self.pan_deg.windows(2).map(|w| w[1] - w[0]).fold(0.0, f64::max);
        let gap = self.pan_deg[0] + 360.0 - self.pan_deg[self.pan_deg.len() - 1];
        gap <= widest + CLOSED_DEG
    }

    /// Whether every direction lies within the grid.
    pub(super) fn covers_sphere(&self) -> bool {
        let [low, high] = [self.tilt_deg[0], self.tilt_deg[self.tilt_deg.len() - 1]];
        low <= -90.0 + CLOSED_DEG && high >= 90.0 - CLOSED_DEG && self.goes_round()
    }

    /// Checks a grid; `place` names it.
    ///
    /// # Errors
    /// Angles that do not rise, or numbers that are not finite or no decibels of a gain.
    pub(super) fn check(&self, place: &str) -> Result<()> {
        let fail = |what: String, help: &str| Err(Error::invalid(place, what, help));
        let (rows, columns) = (self.tilt_deg.len(), self.pan_deg.len());
        if rows < 1 || columns < 2 || self.gain_db.len() != rows * columns || self.gain_db.len() > MAX_POINTS {
            return fail(
                format!("{} gains over {rows} x {columns} angles", self.gain_db.len()),
                "give one gain for every pair of tilt and pan",
            );
        }
        let rises = |angles: &[f64], low: f64, high: f64| {
            angles.iter().all(|a| (low - CLOSED_DEG..=high + CLOSED_DEG).contains(a)) && angles.windows(2).all(|w| w[0] < w[1])
        };
        if !rises(&self.tilt_deg, -90.0, 90.0) || !rises(&self.pan_deg, -360.0, 360.0) {
            return fail(
                "its angles are no tilts from -90 to 90 and pans of a turn".into(),
                "tilt is from the horizon upwards, pan from boresight to the left",
            );
        }
        if self.pan_deg[columns - 1] - self.pan_deg[0] > 360.0 + CLOSED_DEG {
            return fail("its pans are more than a turn".into(), "give each direction once");
        }
        match self.gain_db.iter().find(|g| !(-300.0..=100.0).contains(*g)) {
            Some(g) => fail(format!("a gain of {g} dB"), "gains are decibels, from -300 to 100"),
            None => Ok(()),
        }
    }
}

/// The sample below a value among ascending ones, and how far it is to the next; `None` outside of them.
fn between(samples: &[f64], value: f64) -> Option<(usize, f64)> {
    let last = samples.len() - 1;
    if value < samples[0] - CLOSED_DEG || value > samples[last] + CLOSED_DEG {
        return None;
    }
    let i = samples.partition_point(|s| *s <= value).saturating_sub(1).min(last.saturating_sub(1));
    if last == 0 {
        return Some((0, 0.0));
    }
    Some((i, ((value - samples[i]) / (samples[i + 1] - samples[i])).clamp(0.0, 1.0)))
}

/// A pattern, once in memory for all antennas that have it.
///
/// Antennas are small values that are copied everywhere. What a process reads of files is therefore kept as long as it runs; the same pattern is kept
/// once.
#[derive(Clone, Copy)]
pub struct Sampled(&'static Kept);

struct Kept {
    file: PatternFile,
    pattern: SampledPattern,
}

static KEPT: Mutex<Vec<&'static Kept>> = Mutex::new(Vec::new());

impl Sampled {
    /// A pattern of a file.
    ///
    /// # Errors
    /// A grid that is none.
    pub(super) fn of(file: PatternFile, pattern: SampledPattern) -> Result<Self> {
        pattern.check(file.name())?;
        let mut kept = KEPT.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(known) = kept.iter().find(|k| k.file == file && k.pattern == pattern) {
            return Ok(Self(known));
        }
        let new: &'static Kept = Box::leak(Box::new(Kept { file, pattern }));
        kept.push(new);
        Ok(Self(new))
    }

    /// Gain towards a unit direction of the antenna frame, dB.
    pub fn gain_db(self, local: DVec3) -> f64 {
        let level_db = self.0.pattern.level_db(local).or(self.0.file.outside_db());
        // Where a grid does not reach the whole sphere, the file's settings say what is beyond it.
        level_db.unwrap_or(f64::NEG_INFINITY) + self.0.pattern.shift_db
    }

    /// Mean gain over the sphere of a pattern whose decibels are shifted by none, by midpoints of cells of a degree.
    pub(super) fn mean_gain(pattern: &SampledPattern, outside_db: Option<f64>) -> f64 {
        let cell = PI / 180.0;
        let mut sum = 0.0;
        for i in 0..180 {
            let tilt = -0.5 * PI + (f64::from(i) + 0.5) * cell;
            let (z, r) = tilt.sin_cos();
            let row = (0..360).map(|j| {
                let (sin, cos) = ((f64::from(j) + 0.5) * cell).sin_cos();
                let level_db = pattern.level_db(DVec3::new(r * cos, r * sin, z)).or(outside_db);
                level_db.map_or(0.0, |level_db| 10f64.powf(0.1 * level_db))
            });
            sum += row.sum::<f64>() * r;
        }
        sum * cell * cell / (2.0 * TAU)
    }
}

impl Deref for Sampled {
    type Target = SampledPattern;

    fn deref(&self) -> &SampledPattern {
        &self.0.pattern
    }
}

impl PartialEq for Sampled {
    fn eq(&self, other: &Self) -> bool {
        std::ptr::eq(self.0, other.0)
    }
}

impl Eq for Sampled {}

impl Hash for Sampled {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.0.pattern.sha256.hash(state);
    }
}

impl fmt::Debug for Sampled {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?}", self.0.file.name())
    }
}

impl Serialize for Sampled {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        self.0.file.entries(&mut map)?;
        map.serialize_entry("read", &self.0.pattern)?;
        map.end()
    }
}
