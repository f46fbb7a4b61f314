//! The lobe that stands for an arrival, and where it reaches.

use super::Grid;
use corf_scene::model::ARRAY_FROM_CAMERA;
use corf_scene::{Equirectangular, Pinhole};
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, LN_10, PI, TAU};

/// Cut-off of all lobes, dB under the peak of the strongest one: its tail is part of the picture wherever the dataset's range is wide.
const CUTOFF_DB: f64 = 80.0;
/// Least cut-off of a lobe, dB under its own peak: 1e-4 of its power lies beyond. Most arrivals are faint, and their lobes then touch half
/// as many pixels.
const OWN_CUTOFF_DB: f64 = 40.0;

/// Standard deviations, in pixels at the middle of a pinhole camera's image, from which on a lobe's values at the pixels' centres sum up to
/// its power: by Poisson's formula within 2·2·2·exp(−2π²·0.6²) = 0.33 %, 0.014 dB, wherever between the pixels it stands.
const RESOLVED_PIXELS: f64 = 0.6;
/// The limit of [`RESOLVED_PIXELS`] in rows of an image of the sphere, whose meridians meet at the poles: there the sum of a lobe's values
/// is 1/(24·r²) too large, 4 % or 0.17 dB at r = 1 row.
const RESOLVED_ROWS: f64 = 1.0;
/// Relative rounding error allowed in a ratio that is meant to equal one of these limits.
const ROUNDING: f64 = 1e-9;

/// The Gaussian of the sphere (von Mises–Fisher, κ = 1/σ²) of standard deviation σ per axis, whose integral over solid angle is exactly 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct Lobe {
    /// σ, radians.
    pub sigma: f64,
    /// κ.
    pub kappa: f64,
    /// κ / (2π(1 − e^{−2κ})): the value at the centre, 1/sr.
    pub peak: f64,
}

impl Lobe {
    /// The lobe of a standard deviation in degrees.
    pub fn new(width_deg: f64) -> Self {
        let sigma = width_deg.to_radians();
        let kappa = 1.0 / (sigma * sigma);
        Self { sigma, kappa, peak: kappa / (TAU * (1.0 - (-2.0 * kappa).exp())) }
    }

    /// Whether its values at the pixels' centres times the pixels' solid angles sum up to its power within 0.2 dB, wherever it stands.
    pub fn is_resolved_by(&self, grid: &Grid) -> bool {
        let enough = |ratio: f64, least: f64| ratio >= least * (1.0 - ROUNDING);
        match grid {
            Grid::Pinhole(camera) => enough(self.sigma * camera.fx.min(camera.fy), RESOLVED_PIXELS),
            Grid::Sphere(sphere) => {
                enough(self.sigma * sphere.height as f64 / PI, RESOLVED_ROWS)
                    && enough(self.sigma * sphere.width as f64 / TAU, RESOLVED_PIXELS)
            }
        }
    }

    /// The squared chord beyond which nothing is added of an arrival, given the strongest one's power.
    pub fn cutoff_chord2(&self, power: f64, strongest: f64) -> f64 {
        let cutoff_db = (CUTOFF_DB + 10.0 * (power / strongest).log10()).max(OWN_CUTOFF_DB);
        // κ(1 − cosγ) = κ·chord²/2 reaches the cut-off at:
        (2.0 * cutoff_db / 10.0 * LN_10 / self.kappa).min(4.0)
    }
}

/// The angle that a chord spans, radians.
pub(super) fn angle_of_chord2(chord2: f64) -> f64 {
    2.0 * (0.5 * chord2.sqrt()).min(1.0).asin()
}

/// The part of an image that a cone touches, in pixels (centres at +0.5), not cut to the frame.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    /// Left and right; on the sphere beyond its edges where the cone crosses the seam, 2·width apart at most.
    pub columns: (f64, f64),
    /// Top and bottom.
    pub rows: (f64, f64),
}

impl Extent {
    /// Extent of a cone of half angle `radius`, radians, around a direction of the camera frame; `None` wholly behind a camera.
    pub fn pinhole(camera: &Pinhole, direction: DVec3, radius: f64) -> Option<Self> {
        let columns = tangents(direction.x, direction.z, radius, camera.fx, camera.cx)?;
        let rows = tangents(direction.y, direction.z, radius, camera.fy, camera.cy)?;
        Some(Self { columns, rows })
    }

    /// Columns and rows of a cone in an image of the sphere; `None` for the columns where the cone touches all of them.
    pub fn sphere(sphere: &Equirectangular, direction: DVec3, radius: f64) -> (Option<(f64, f64)>, (f64, f64)) {
        let at = sphere.project(ARRAY_FROM_CAMERA.rotation * direction);
        let row_half = radius / PI * sphere.height as f64;
        let rows = (at.y - row_half, at.y + row_half);
        // The meridians that touch the cone make asin(sin r / cos el) with its axis; none does when it holds a pole.
        let cos_elevation = direction.x.hypot(direction.z);
        if radius >= FRAC_PI_2 || cos_elevation <= radius.sin() {
            return (None, rows);
        }
        let half = (radius.sin() / cos_elevation).asin() / TAU * sphere.width as f64;
        (Some((at.x - half, at.x + half)), rows)
    }
}

/// The columns (or rows) that a cone of half angle `radius` around a direction touches; `x` is the direction's component along them.
fn tangents(x: f64, z: f64, radius: f64, focal: f64, centre: f64) -> Option<(f64, f64)> {
    // Seen along the other axis the cone's axis has length h ≤ 1 and its tangent planes make asin(sin r / h) with it.
    let h = x.hypot(z);
    if h <= radius.sin() || radius >= FRAC_PI_2 {
        return Some((f64::NEG_INFINITY, f64::INFINITY));
    }
    let half = (radius.sin() / h).asin();
    let angle = x.atan2(z);
    let edge = |a: f64| {
        if a <= -FRAC_PI_2 {
            f64::NEG_INFINITY
        } else if a >= FRAC_PI_2 {
            f64::INFINITY
        } else {
            focal * a.tan() + centre
        }
    };
    // Wholly behind the camera.
    if angle - half >= FRAC_PI_2 || angle + half <= -FRAC_PI_2 {
        return None;
    }
    Some((edge(angle - half), edge(angle + half)))
}
