//! Gain of an antenna element over a grid of angles.

use super::file::PatternFile;
use super::grid::{AngleGrid, means};
use super::kept;
use crate::{Error, Result};
use glam::DVec3;
use serde::ser::SerializeMap;
use serde::{Deserialize, Serialize, Serializer};
use std::fmt;
use std::hash::{Hash, Hasher};
use std::ops::Deref;
use std::sync::Mutex;

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
    pub(super) fn grid(&self) -> AngleGrid<'_> {
        AngleGrid { tilt_deg: &self.tilt_deg, pan_deg: &self.pan_deg }
    }

    /// Gain over the file's grid, dB, as it stands there; `None` outside.
    fn level_db(&self, local: DVec3) -> Option<f64> {
        let columns = self.pan_deg.len();
        Some(self.grid().cell(local)?.interpolate(|i, j| self.gain_db[i * columns + j]))
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
        self.grid().check(place)?;
        match self.gain_db.iter().find(|g| !(-300.0..=100.0).contains(*g)) {
            Some(g) => fail(format!("a gain of {g} dB"), "gains are decibels, from -300 to 100"),
            None => Ok(()),
        }
    }
}

/// A pattern, once in memory for all antennas that have it.
#[derive(Clone, Copy)]
pub struct Sampled(&'static Kept);

#[derive(PartialEq)]
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
        Ok(Self(kept::once(&KEPT, Kept { file, pattern })))
    }

    /// Gain towards a unit direction of the antenna frame, dB.
    pub fn gain_db(self, local: DVec3) -> f64 {
        let level_db = self.0.pattern.level_db(local).or(self.0.file.outside_db());
        // Where a grid does not reach the whole sphere, the file's settings say what is beyond it.
        level_db.unwrap_or(f64::NEG_INFINITY) + self.0.pattern.shift_db
    }

    /// Mean gain over the sphere of a pattern whose decibels are shifted by none, by midpoints of cells of a degree.
    pub(super) fn mean_gain(pattern: &SampledPattern, outside_db: Option<f64>) -> f64 {
        let gain = |local| pattern.level_db(local).or(outside_db).map_or(0.0, |level_db| 10f64.powf(0.1 * level_db));
        means(1, |local, sums| sums[0] += gain(local))[0]
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
