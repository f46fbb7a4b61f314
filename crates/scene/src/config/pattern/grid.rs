//! A grid of angles over the sphere, and where a direction lies in it.

use crate::{Error, Result};
use glam::DVec3;

/// A full turn to this, degrees.
pub(super) const CLOSED_DEG: f64 = 1e-6;

/// Tilts and pans of a grid, degrees, both ascending.
#[derive(Clone, Copy, Debug)]
pub(super) struct AngleGrid<'g> {
    pub tilt_deg: &'g [f64],
    pub pan_deg: &'g [f64],
}

/// The four samples around a direction.
pub(super) struct Cell {
    /// Of tilts.
    pub rows: [usize; 2],
    /// Of pans.
    pub columns: [usize; 2],
    /// Share of the second row.
    pub up: f64,
    /// Share of the second column.
    pub along: f64,
}

impl Cell {
    /// Bilinear between samples by row and column.
    pub fn interpolate(&self, at: impl Fn(usize, usize) -> f64) -> f64 {
        let row = |i: usize| at(i, self.columns[0]) * (1.0 - self.along) + at(i, self.columns[1]) * self.along;
        row(self.rows[0]) * (1.0 - self.up) + row(self.rows[1]) * self.up
    }
}

impl AngleGrid<'_> {
    /// Around a unit direction of the antenna frame; `None` outside.
    pub fn cell(&self, local: DVec3) -> Option<Cell> {
        let tilt = local.z.clamp(-1.0, 1.0).asin().to_degrees();
        let (i, up) = between(self.tilt_deg, tilt)?;
        let (first, last) = (self.pan_deg[0], self.pan_deg[self.pan_deg.len() - 1]);
        let pan = first + (local.y.atan2(local.x).to_degrees() - first).rem_euclid(360.0);
        let count = self.pan_deg.len();
        let (columns, along) = match between(self.pan_deg, pan) {
            Some((j, along)) => ([j, (j + 1).min(count - 1)], along),
            // Behind the last sample the first comes again, where the grid goes round.
            None if self.goes_round() => ([count - 1, 0], (pan - last) / (first + 360.0 - last)),
            None => return None,
        };
        Some(Cell { rows: [i, (i + 1).min(self.tilt_deg.len() - 1)], columns, up, along })
    }

    /// Whether pan covers the whole turn: the gap behind its last sample is no wider than the widest between others.
    fn goes_round(&self) -> bool {
        let widest = self.pan_deg.windows(2).map(|w| w[1] - w[0]).fold(0.0, f64::max);
        let gap = self.pan_deg[0] + 360.0 - self.pan_deg[self.pan_deg.len() - 1];
        gap <= widest + CLOSED_DEG
    }

    /// Whether every direction lies within the grid.
    fn covers_sphere(&self) -> bool {
        let [low, high] = [self.tilt_deg[0], self.tilt_deg[self.tilt_deg.len() - 1]];
        low <= -90.0 + CLOSED_DEG && high >= 90.0 - CLOSED_DEG && self.goes_round()
    }

    /// Checks that something says what is beyond a grid that is not the whole sphere.
    ///
    /// # Errors
    /// Nothing does.
    pub fn check_outside(&self, outside_db: Option<f64>, place: &str) -> Result<()> {
        if self.covers_sphere() || outside_db.is_some() {
            return Ok(());
        }
        let [t, p] = [self.tilt_deg, self.pan_deg].map(|a| (a[0], a[a.len() - 1]));
        let what = format!(
            "covers tilts from {:.2} to {:.2} and pans from {:.2} to {:.2} degrees, and nothing says what is beyond",
            t.0, t.1, p.0, p.1
        );
        let help = "say the gain beyond it in the file's decibels, outside_db = -30 (or, of measurements in decibels of a receiver, its noise)";
        Err(Error::invalid(place, what, help))
    }

    /// Checks its angles.
    ///
    /// # Errors
    /// Angles that do not rise, or are more than a sphere.
    pub fn check(&self, place: &str) -> Result<()> {
        let fail = |what: &str, help: &str| Err(Error::invalid(place, what, help));
        let rises = |angles: &[f64], low: f64, high: f64| {
            angles.iter().all(|a| (low - CLOSED_DEG..=high + CLOSED_DEG).contains(a)) && angles.windows(2).all(|w| w[0] < w[1])
        };
        if !rises(self.tilt_deg, -90.0, 90.0) || !rises(self.pan_deg, -360.0, 360.0) {
            return fail(
                "its angles are no tilts from -90 to 90 and pans of a turn",
                "tilt is from the horizon upwards, pan from boresight to the left",
            );
        }
        if self.pan_deg[self.pan_deg.len() - 1] - self.pan_deg[0] > 360.0 + CLOSED_DEG {
            return fail("its pans are more than a turn", "give each direction once");
        }
        Ok(())
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

/// The direction of angles, unit, antenna frame.
pub(super) fn direction(tilt_deg: f64, pan_deg: f64) -> DVec3 {
    let ((z, r), (y, x)) = (tilt_deg.to_radians().sin_cos(), pan_deg.to_radians().sin_cos());
    DVec3::new(r * x, r * y, z)
}

/// Means over the sphere, by midpoints of cells of a degree, of so many quantities, whose values towards a direction `add` adds to sums.
pub(super) fn means(count: usize, add: impl Fn(DVec3, &mut [f64])) -> Vec<f64> {
    let cell = std::f64::consts::PI / 180.0;
    let mut sums = vec![0.0; count];
    let mut row = vec![0.0; count];
    for i in 0..180 {
        let tilt = -0.5 * std::f64::consts::PI + (f64::from(i) + 0.5) * cell;
        let (z, r) = tilt.sin_cos();
        row.fill(0.0);
        for j in 0..360 {
            let (sin, cos) = ((f64::from(j) + 0.5) * cell).sin_cos();
            add(DVec3::new(r * cos, r * sin, z), &mut row);
        }
        sums.iter_mut().zip(&row).for_each(|(sum, row)| *sum += row * r);
    }
    sums.iter().map(|sum| sum * cell * cell / (2.0 * std::f64::consts::TAU)).collect()
}
