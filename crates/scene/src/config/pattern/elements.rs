//! Complex responses of an array's elements, each its own, over a grid of angles.

use super::file::PatternFile;
use super::grid::{AngleGrid, direction, means};
use super::kept;
use crate::{Error, Result};
use base64::Engine as _;
use glam::DVec3;
use serde::de::Error as _;
use serde::ser::SerializeMap;
use serde::{Deserialize, Deserializer, Serialize, Serializer};
use std::f64::consts::TAU;
use std::fmt;
use std::hash::{Hash, Hasher};
use std::ops::Deref;
use std::sync::Mutex;

/// No file has more responses: 8×8 elements every two degrees of the sphere.
pub(super) const MAX_RESPONSES: usize = 1 << 20;

/// The places of an array's elements: columns along +y, rows down −z, element `column·rows + row`, centred.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ElementGrid {
    /// Rows.
    pub rows: usize,
    /// Columns.
    pub cols: usize,
    /// Between columns, between rows, wavelengths.
    pub spacing_wavelengths: [f64; 2],
}

impl ElementGrid {
    /// Number of elements.
    pub fn count(&self) -> usize {
        self.rows * self.cols
    }

    /// The phases 2π·p_m·u of a wave from the unit direction `local` at an element, along y and along z, radians.
    pub(super) fn phases_rad(&self, element: usize, local: DVec3) -> [f64; 2] {
        let centred = |i: usize, n: usize| i as f64 - 0.5 * (n as f64 - 1.0);
        let [across, down] = self.spacing_wavelengths;
        let y = centred(element / self.rows, self.cols) * across;
        let z = -centred(element % self.rows, self.rows) * down;
        [TAU * y * local.y, TAU * z * local.z]
    }
}

impl fmt::Display for ElementGrid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [across, down] = self.spacing_wavelengths;
        write!(f, "{}x{} elements {across} x {down} wavelengths apart", self.rows, self.cols)
    }
}

/// Complex responses of every element of an array to a plane wave, in the array's frame, e^{+jωt}. Between samples they are interpolated bilinearly.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ElementResponses {
    /// SHA-256 of the file.
    pub sha256: String,
    /// The array.
    pub array: ElementGrid,
    /// Angles from the x–y plane towards +z, degrees, ascending.
    pub tilt_deg: Vec<f64>,
    /// Angles from +x towards +y, degrees, ascending, over a turn at most.
    pub pan_deg: Vec<f64>,
    /// Real and imaginary part by tilt, pan and element, over an isotropic element without losses at the element's nominal place: the phases of
    /// places are taken off. In records f32 of the least significant byte first, base64.
    #[serde(with = "base64_of_pairs")]
    pub responses: Vec<[f32; 2]>,
    /// What is added to the responses' decibels: 0, or what makes the mean over elements of their mean gains 1.
    pub shift_db: f64,
    /// Mean gain of each element over the sphere with it, linear: the share that it radiates of the power it is fed.
    pub mean_gains: Vec<f64>,
}

impl ElementResponses {
    pub(super) fn grid(&self) -> AngleGrid<'_> {
        AngleGrid { tilt_deg: &self.tilt_deg, pan_deg: &self.pan_deg }
    }

    /// Adds up what the elements respond towards a unit direction, without the shift; whether it is within the grid.
    fn at(&self, local: DVec3, mut each: impl FnMut(usize, [f64; 2])) -> bool {
        let Some(cell) = self.grid().cell(local) else { return false };
        let (columns, count) = (self.pan_deg.len(), self.array.count());
        for element in 0..count {
            let part = |k: usize| cell.interpolate(|i, j| f64::from(self.responses[(i * columns + j) * count + element][k]));
            each(element, [part(0), part(1)]);
        }
        true
    }

    /// Mean gain of each element over the sphere, without the shift.
    pub(super) fn mean_gains(&self, outside_db: Option<f64>) -> Vec<f64> {
        let outside = outside_db.map_or(0.0, |db| 10f64.powf(0.1 * db));
        means(self.array.count(), |local, sums| {
            if !self.at(local, |m, [re, im]| sums[m] += re * re + im * im) {
                sums.iter_mut().for_each(|sum| *sum += outside);
            }
        })
    }

    /// Checks a grid; `place` names it.
    ///
    /// # Errors
    /// Numbers that do not fit together or are not finite.
    pub(super) fn check(&self, place: &str) -> Result<()> {
        let (rows, columns, count) = (self.tilt_deg.len(), self.pan_deg.len(), self.array.count());
        let all = rows.saturating_mul(columns).saturating_mul(count);
        if rows < 1 || columns < 2 || count < 1 || self.responses.len() != all || self.mean_gains.len() != count {
            let what = format!("{} responses of {count} elements over {rows} x {columns} angles", self.responses.len());
            return Err(Error::invalid(place, what, "give every element's response for every pair of tilt and pan"));
        }
        if all > MAX_RESPONSES {
            let what = format!("{all} responses are more than {MAX_RESPONSES}");
            return Err(Error::invalid(place, what, "give them on a coarser grid: two degrees are enough for 8x8 elements"));
        }
        self.grid().check(place)?;
        match self.responses.iter().flatten().find(|v| v.is_nan() || v.abs() > 1e5) {
            Some(v) => {
                Err(Error::invalid(place, format!("a response of {v}"), "give finite responses, 1 being an isotropic element's"))
            }
            None => Ok(()),
        }
    }

    /// How well the elements agree on the phase of every direction in front of the array, by power, from 1/N to 1, after `turn` (radians, of an
    /// element and a direction) is taken off and what each is off towards boresight: 1 where elements differ by constants.
    pub(super) fn agreement(&self, turn: impl Fn(usize, DVec3) -> f64) -> f64 {
        let (columns, count) = (self.pan_deg.len(), self.array.count());
        let front: Vec<(usize, DVec3)> = (0..self.tilt_deg.len() * columns)
            .map(|i| (i, direction(self.tilt_deg[i / columns], self.pan_deg[i % columns])))
            .filter(|(_, u)| u.x > 0.0)
            .collect();
        let Some((ahead, _)) = front.iter().max_by(|a, b| a.1.x.total_cmp(&b.1.x)) else { return 1.0 };
        let turned = |i: usize, u: DVec3, m: usize| {
            let ([re, im], (sin, cos)) = (self.responses[i * count + m].map(f64::from), turn(m, u).sin_cos());
            [re * cos + im * sin, im * cos - re * sin]
        };
        let at_boresight: Vec<[f64; 2]> = {
            let u = direction(self.tilt_deg[ahead / columns], self.pan_deg[ahead % columns]);
            (0..count).map(|m| turned(*ahead, u, m)).collect()
        };
        let (mut together, mut apart) = (0.0, 0.0);
        for &(i, u) in &front {
            let (mut re, mut im, mut power) = (0.0, 0.0, 0.0);
            for (m, [c, s]) in at_boresight.iter().enumerate() {
                let ([a, b], norm) = (turned(i, u, m), c.hypot(*s));
                power += a * a + b * b;
                if norm > 0.0 {
                    re += (a * c + b * s) / norm;
                    im += (b * c - a * s) / norm;
                }
            }
            let share = (1.0 - u.z * u.z).max(0.0).sqrt();
            together += share * (re * re + im * im);
            apart += share * power;
        }
        if apart > 0.0 { together / (apart * count as f64) } else { 1.0 }
    }
}

/// Responses of an array's elements, once in memory for all antennas that have them, as [`Sampled`](super::Sampled) is.
#[derive(Clone, Copy)]
pub struct Elements(&'static Kept);

#[derive(PartialEq)]
struct Kept {
    file: PatternFile,
    responses: ElementResponses,
}

static KEPT: Mutex<Vec<&'static Kept>> = Mutex::new(Vec::new());

impl Elements {
    /// Responses of a file.
    ///
    /// # Errors
    /// A grid that is none.
    pub(super) fn of(file: PatternFile, responses: ElementResponses) -> Result<Self> {
        responses.check(file.name())?;
        Ok(Self(kept::once(&KEPT, Kept { file, responses })))
    }

    /// Hands on every element's response towards a unit direction of the array's frame, real and imaginary part, over an isotropic element at the
    /// same place. Beyond the grid all have the gain that the file's settings say, and no phase.
    pub fn each(self, local: DVec3, mut each: impl FnMut(usize, [f64; 2])) {
        let amplitude = |db: f64| 10f64.powf(db / 20.0);
        let shift = amplitude(self.0.responses.shift_db);
        if !self.0.responses.at(local, |m, [re, im]| each(m, [re * shift, im * shift])) {
            let outside = self.0.file.outside_db().map_or(0.0, amplitude) * shift;
            (0..self.0.responses.array.count()).for_each(|m| each(m, [outside, 0.0]));
        }
    }

    /// The mean over elements of their gains towards a unit direction of the array's frame, linear.
    pub fn gain(self, local: DVec3) -> f64 {
        let mut sum = 0.0;
        self.each(local, |_, [re, im]| sum += re * re + im * im);
        sum / self.0.responses.array.count() as f64
    }

    /// Refuses any other array than theirs.
    ///
    /// # Errors
    /// That; `place` names the key.
    pub fn check_array(self, array: &ElementGrid, place: &str) -> Result<()> {
        if *array == self.0.responses.array {
            return Ok(());
        }
        let what = format!("{} has the responses of {}, and the array is of {array}", self.0.file.name(), self.0.responses.array);
        Err(Error::invalid(place, what, "give the file of this array, or a pattern that all elements share"))
    }
}

impl Deref for Elements {
    type Target = ElementResponses;

    fn deref(&self) -> &ElementResponses {
        &self.0.responses
    }
}

impl PartialEq for Elements {
    fn eq(&self, other: &Self) -> bool {
        std::ptr::eq(self.0, other.0)
    }
}

impl Eq for Elements {}

impl Hash for Elements {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.0.responses.sha256.hash(state);
    }
}

impl fmt::Debug for Elements {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?} (each element's own)", self.0.file.name())
    }
}

impl Serialize for Elements {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut map = serializer.serialize_map(None)?;
        self.0.file.entries(&mut map)?;
        map.serialize_entry("read_elements", &self.0.responses)?;
        map.end()
    }
}

/// Pairs of f32, the least significant byte first, in base64.
mod base64_of_pairs {
    use super::*;
    use base64::engine::general_purpose::STANDARD;

    pub(super) fn serialize<S: Serializer>(pairs: &[[f32; 2]], serializer: S) -> Result<S::Ok, S::Error> {
        let bytes: Vec<u8> = pairs.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        STANDARD.encode(bytes).serialize(serializer)
    }

    pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<[f32; 2]>, D::Error> {
        let bytes = STANDARD.decode(String::deserialize(deserializer)?).map_err(D::Error::custom)?;
        let (pairs, []) = bytes.as_chunks::<8>() else { return Err(D::Error::custom("no whole number of complex numbers")) };
        let number = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
        Ok(pairs.iter().map(|b| [number(&b[..4]), number(&b[4..])]).collect())
    }
}
