//! The strongest directions of a spectrum.

use corf_raytrace::spectrum::Grid;
use corf_scene::Raster;
use corf_scene::keyframe::DbRange;
use corf_scene::model::ARRAY_FROM_CAMERA;
use glam::DVec3;
use serde::Serialize;

/// Most peaks of one spectrum.
const MOST: usize = 4;
/// Peaks lie within this of the strongest, dB.
const WITHIN_DB: f64 = 25.0;
/// Least angle between two peaks, degrees.
const APART_DEG: f64 = 8.0;

/// A direction from which more power comes than from those around it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Peak {
    /// Middle of its pixel as a share of the picture's width.
    pub x: f64,
    /// The same down the picture.
    pub y: f64,
    /// Azimuth in the array's frame, degrees, positive to the left of straight ahead.
    pub azimuth_deg: f64,
    /// Elevation in the array's frame, degrees.
    pub elevation_deg: f64,
    /// Level, dB.
    pub db: f64,
}

/// The peaks of a scalar spectrum on the pixels of `grid`, the strongest first: no weaker neighbour, not at the floor, within [`WITHIN_DB`] of the
/// strongest, [`APART_DEG`] apart.
pub fn find(scalar: &Raster<f32>, grid: &Grid, range: &DbRange) -> Vec<Peak> {
    let (width, height) = (scalar.width(), scalar.height());
    let is_highest = |x: usize, y: usize| {
        let value = scalar[(x, y)];
        let rows = y.saturating_sub(1)..(y + 2).min(height);
        let mut around = rows.flat_map(|v| (x.saturating_sub(1)..(x + 2).min(width)).map(move |u| (u, v)));
        value > 0.0 && around.all(|at| scalar[at] <= value)
    };
    let mut highest: Vec<(usize, usize)> =
        (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).filter(|&(x, y)| is_highest(x, y)).collect();
    // Stable: of equal levels the first in reading order comes first.
    highest.sort_by(|a, b| scalar[*b].total_cmp(&scalar[*a]));
    let directions = grid.directions();
    let mut found: Vec<(DVec3, Peak)> = Vec::new();
    for (x, y) in highest {
        let (direction, db) = (directions[y * width + x], range.db(scalar[(x, y)]));
        let too_weak = found.first().is_some_and(|(_, strongest)| db < strongest.db - WITHIN_DB);
        if found.len() == MOST || too_weak {
            break;
        }
        if found.iter().any(|(other, _)| other.angle_between(direction).to_degrees() < APART_DEG) {
            continue;
        }
        let d = ARRAY_FROM_CAMERA.rotation * direction;
        found.push((
            direction,
            Peak {
                x: (x as f64 + 0.5) / width as f64,
                y: (y as f64 + 0.5) / height as f64,
                azimuth_deg: d.y.atan2(d.x).to_degrees(),
                elevation_deg: d.z.clamp(-1.0, 1.0).asin().to_degrees(),
                db,
            },
        ));
    }
    found.into_iter().map(|(_, peak)| peak).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::{Equirectangular, Pinhole};

    const RANGE: DbRange = DbRange { min_db: -100.0, max_db: -40.0 };

    #[test]
    fn peaks_are_apart_strong_and_in_the_arrays_frame() {
        let camera = Pinhole::from_horizontal_fov(60, 40, 90.0);
        let bump = |x: usize, y: usize, at: (f32, f32), height: f32| {
            height - 0.02 * ((x as f32 - at.0).powi(2) + (y as f32 - at.1).powi(2)).sqrt()
        };
        let scalar = Raster::from_fn(60, 40, |x, y| {
            let strong = bump(x, y, (10.0, 8.0), 0.9);
            let beside = bump(x, y, (12.0, 8.0), 0.89);
            let other = bump(x, y, (45.0, 30.0), 0.7);
            let weak = bump(x, y, (40.0, 5.0), 0.4);
            [strong, beside, other, weak].into_iter().fold(0.0, f32::max)
        });
        let peaks = find(&scalar, &Grid::Pinhole(camera), &RANGE);
        assert_eq!(peaks.len(), 2, "one beside the strongest and one 30 dB below are none: {peaks:?}");
        let at = |p: &Peak| ((p.x * 60.0) as usize, (p.y * 40.0) as usize);
        assert_eq!((at(&peaks[0]), at(&peaks[1])), ((10, 8), (45, 30)));
        assert!((peaks[0].db - RANGE.db(0.9)).abs() < 1e-3);
        // Left of the middle and above it: f = 30 pixels, 19.5 to the left, 11.5 up.
        let azimuth = (19.5_f64 / 30.0).atan().to_degrees();
        let elevation = (11.5 / (30.0_f64.powi(2) + 19.5_f64.powi(2)).sqrt()).atan().to_degrees();
        assert!((peaks[0].azimuth_deg - azimuth).abs() < 1e-9 && (peaks[0].elevation_deg - elevation).abs() < 1e-9);
        assert!(peaks[1].azimuth_deg < 0.0 && peaks[1].elevation_deg < 0.0);
    }

    #[test]
    fn a_spectrum_without_power_has_no_peak() {
        let camera = Grid::Pinhole(Pinhole::from_horizontal_fov(8, 6, 90.0));
        assert!(find(&Raster::filled(8, 6, 0.0), &camera, &RANGE).is_empty());
        // All equal: one direction, the first.
        assert_eq!(find(&Raster::filled(8, 6, 0.5), &Grid::Pinhole(Pinhole::from_horizontal_fov(8, 6, 5.0)), &RANGE).len(), 1);
    }

    #[test]
    fn a_peak_of_the_sphere_has_its_azimuth_and_elevation() {
        let sphere = Equirectangular { width: 36, height: 18 };
        let scalar = Raster::from_fn(36, 18, |x, y| if (x, y) == (3, 4) { 0.8 } else { 0.1 });
        let peaks = find(&scalar, &Grid::Sphere(sphere), &RANGE);
        assert!((peaks[0].azimuth_deg - 145.0).abs() < 1e-9 && (peaks[0].elevation_deg - 45.0).abs() < 1e-9, "{peaks:?}");
    }
}
