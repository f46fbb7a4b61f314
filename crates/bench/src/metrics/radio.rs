//! Physical metrics of an angular power spectrum, on linear power with the solid angle of every pixel.

use corf_scene::keyframe::DbRange;
use corf_scene::model::ARRAY_FROM_CAMERA;
use corf_scene::{Pinhole, Raster};
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Range below the true peak within which a pixel counts as strong, dB.
const STRONG_DB: f64 = 30.0;

/// Physical metrics of one predicted spectrum.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RadioMetrics {
    /// Root mean square error in dB over pixels within 30 dB of the true peak.
    pub rmse_db_30: f64,
    /// Root mean square error in dB over all pixels, both on the dataset's dB range.
    pub rmse_db: f64,
    /// Power-angular-spectrum similarity `1 − ½ Σ |ŜΩ/ΣŜΩ − SΩ/ΣSΩ|` (3GPP TS 38.151), in `[0, 1]`.
    pub psp_similarity: f64,
    /// |10·log10(ΣŜΩ / ΣSΩ)|, dB.
    pub total_power_error_db: f64,
    /// Angle between the strongest true and the strongest predicted direction, degrees.
    pub peak_error_deg: f64,
    /// `10·log10(max S / S(argmax Ŝ))`: what a beam pointed by the prediction loses, dB.
    pub beam_loss_db: f64,
    /// Share of the true in-frame power inside the predicted strongest 1 % of the frame's solid angle.
    pub energy_capture_1: f64,
    /// Share of the true in-frame power inside the predicted strongest 5 % of the frame's solid angle.
    pub energy_capture_5: f64,
    /// |difference| of the circular azimuth spreads (3GPP TR 38.901 Annex A, array frame), degrees.
    pub azimuth_spread_error_deg: f64,
}

/// Compares a predicted scalar spectrum (`[0, 1]` on `range`) with the true linear one, in whatever unit the data set's `Quantity` has.
pub fn compare(predicted: &Raster<f32>, truth: &Raster<f32>, camera: &Pinhole, range: &DbRange) -> RadioMetrics {
    let pixels: Vec<Pixel> = (0..camera.width * camera.height)
        .map(|i| {
            let (x, y) = (i % camera.width, i / camera.width);
            let scalar = predicted[(x, y)].clamp(0.0, 1.0);
            let solid_angle_sr = camera.pixel_solid_angle_sr(x, y);
            Pixel {
                direction: camera.pixel_direction(x, y),
                solid_angle_sr,
                truth: f64::from(truth[(x, y)]).max(0.0),
                predicted: linear(scalar, range),
                truth_db: range.db(range.scalar(truth[(x, y)])),
                predicted_db: range.db(scalar),
            }
        })
        .collect();
    let strongest_true = argmax(&pixels, |p| p.truth);
    let strongest_predicted = argmax(&pixels, |p| p.predicted);
    let strong_from_db = strongest_true.truth_db - STRONG_DB;
    let total_true: f64 = pixels.iter().map(|p| p.truth * p.solid_angle_sr).sum();
    let total_predicted: f64 = pixels.iter().map(|p| p.predicted * p.solid_angle_sr).sum();
    let difference: f64 =
        pixels.iter().map(|p| p.solid_angle_sr * (share(p.predicted, total_predicted) - share(p.truth, total_true)).abs()).sum();
    RadioMetrics {
        rmse_db_30: rmse_db(pixels.iter().filter(|p| p.truth_db >= strong_from_db)),
        rmse_db: rmse_db(pixels.iter()),
        psp_similarity: 1.0 - 0.5 * difference,
        total_power_error_db: ratio_db(total_predicted, total_true, range).abs(),
        peak_error_deg: strongest_true.direction.angle_between(strongest_predicted.direction).to_degrees(),
        beam_loss_db: ratio_db(strongest_true.truth, strongest_predicted.truth, range),
        energy_capture_1: energy_capture(&pixels, 0.01, total_true),
        energy_capture_5: energy_capture(&pixels, 0.05, total_true),
        azimuth_spread_error_deg: (azimuth_spread_deg(&pixels, |p| p.predicted) - azimuth_spread_deg(&pixels, |p| p.truth)).abs(),
    }
}

/// Linear power of a predicted scalar: a bin on the floor is empty by the dataset's rule, not full of floor-level power.
pub fn linear(scalar: f32, range: &DbRange) -> f64 {
    let scalar = scalar.clamp(0.0, 1.0);
    if scalar > 0.0 { range.linear(scalar) } else { 0.0 }
}

struct Pixel {
    direction: DVec3,
    solid_angle_sr: f64,
    truth: f64,
    predicted: f64,
    truth_db: f64,
    predicted_db: f64,
}

fn share(power: f64, total: f64) -> f64 {
    if total > 0.0 { power / total } else { 0.0 }
}

/// The first pixel of the largest value.
fn argmax(pixels: &[Pixel], value: impl Fn(&Pixel) -> f64) -> &Pixel {
    pixels.iter().reduce(|best, p| if value(p) > value(best) { p } else { best }).expect("a camera has pixels")
}

/// A ratio in dB, limited to the dataset's range so that an empty spectrum gives a large error and not an infinite one.
fn ratio_db(a: f64, b: f64, range: &DbRange) -> f64 {
    let limit = range.max_db - range.min_db;
    if a <= 0.0 && b <= 0.0 { 0.0 } else { (10.0 * (a / b).log10()).clamp(-limit, limit) }
}

fn rmse_db<'a>(pixels: impl Iterator<Item = &'a Pixel>) -> f64 {
    let (sum, n) = pixels.fold((0.0, 0usize), |(sum, n), p| (sum + (p.predicted_db - p.truth_db).powi(2), n + 1));
    (sum / n.max(1) as f64).sqrt()
}

fn energy_capture(pixels: &[Pixel], share_of_solid_angle: f64, total_true: f64) -> f64 {
    let mut order: Vec<&Pixel> = pixels.iter().collect();
    order.sort_by(|a, b| b.predicted.total_cmp(&a.predicted));
    let budget_sr = share_of_solid_angle * pixels.iter().map(|p| p.solid_angle_sr).sum::<f64>();
    let mut used_sr = 0.0;
    let captured: f64 = order
        .iter()
        .take_while(|p| {
            used_sr += p.solid_angle_sr;
            used_sr <= budget_sr
        })
        .map(|p| p.truth * p.solid_angle_sr)
        .sum();
    share(captured, total_true)
}

/// TR 38.901 Annex A, Eq.: `AS = sqrt(−2 ln |Σ e^{jφ} P / Σ P|)`.
fn azimuth_spread_deg(pixels: &[Pixel], power: impl Fn(&Pixel) -> f64) -> f64 {
    let (mut re, mut im, mut total) = (0.0, 0.0, 0.0);
    for p in pixels {
        let d = ARRAY_FROM_CAMERA.transform_vector(p.direction);
        let azimuth_rad = d.y.atan2(d.x);
        let w = power(p) * p.solid_angle_sr;
        re += w * azimuth_rad.cos();
        im += w * azimuth_rad.sin();
        total += w;
    }
    if total <= 0.0 {
        return 0.0;
    }
    (-2.0 * ((re * re + im * im).sqrt() / total).min(1.0).ln()).max(0.0).sqrt().to_degrees()
}

#[cfg(test)]
mod tests {
    use super::*;

    const RANGE: DbRange = DbRange { min_db: -120.0, max_db: -60.0 };

    fn camera() -> Pinhole {
        Pinhole::from_horizontal_fov(96, 64, 90.0)
    }

    /// One Gaussian lobe at an image position over a floor.
    fn lobe(u: f64, v: f64) -> Raster<f32> {
        Raster::from_fn(96, 64, |x, y| {
            let d2 = (x as f64 + 0.5 - u).powi(2) + (y as f64 + 0.5 - v).powi(2);
            (1e-7 * (-0.5 * d2 / 9.0).exp() + 1e-11) as f32
        })
    }

    #[test]
    fn a_perfect_prediction_has_no_error() {
        let truth = lobe(40.0, 30.0);
        let m = compare(&truth.map(|&s| RANGE.scalar(s)), &truth, &camera(), &RANGE);
        assert!(m.rmse_db < 1e-4 && m.rmse_db_30 < 1e-4, "{m:?}");
        assert!((m.psp_similarity - 1.0).abs() < 1e-4);
        assert!(m.peak_error_deg < 1e-6 && m.beam_loss_db < 1e-9 && m.total_power_error_db < 1e-3);
        assert!(m.azimuth_spread_error_deg < 1e-2);
        assert!(m.energy_capture_5 > 0.95 && m.energy_capture_1 < m.energy_capture_5);
    }

    #[test]
    fn a_shifted_peak_is_measured_in_degrees_and_in_lost_power() {
        let camera = camera();
        let (truth, wrong) = (lobe(40.5, 30.5), lobe(70.5, 30.5));
        let m = compare(&wrong.map(|&s| RANGE.scalar(s)), &truth, &camera, &RANGE);
        let expected = camera.unproject(40.5, 30.5).angle_between(camera.unproject(70.5, 30.5)).to_degrees();
        assert!((m.peak_error_deg - expected).abs() < 1e-9, "{m:?}");
        // The truth at the wrong peak is the floor: 10 log10(1e-7 / 1e-11) = 40 dB.
        assert!((m.beam_loss_db - 40.0).abs() < 0.01, "{m:?}");
        assert!(m.psp_similarity < 0.2 && m.energy_capture_1 < 0.05);
    }

    #[test]
    fn uniform_power_error_is_read_back() {
        let truth = lobe(40.0, 30.0);
        let m = compare(&truth.map(|&s| RANGE.scalar(2.0 * s)), &truth, &camera(), &RANGE);
        assert!((m.total_power_error_db - 3.0103).abs() < 1e-3, "{m:?}");
        assert!((m.rmse_db - 3.0103).abs() < 1e-3 && (m.psp_similarity - 1.0).abs() < 1e-4);
    }

    /// Equal powers in the pixels of image row 32 whose columns are given.
    fn paths(columns: &[usize]) -> Raster<f32> {
        let camera = camera();
        let power = |x: usize, y: usize| (1e-10 / camera.pixel_solid_angle_sr(x, y)) as f32;
        Raster::from_fn(96, 64, |x, y| if y == 32 && columns.contains(&x) { power(x, y) } else { 0.0 })
    }

    #[test]
    fn two_equal_paths_spread_as_the_formula_says() {
        // Columns 27 and 68 lie as far left of the middle as right of it: R = cos θ, AS = √(−2 ln cos θ).
        let (truth, camera) = (paths(&[27, 68]), camera());
        let d = camera.pixel_direction(68, 32);
        let theta = d.x.atan2(d.z);
        let spread_deg = (-2.0 * theta.cos().ln()).sqrt().to_degrees();
        assert!((20.0..30.0).contains(&spread_deg), "{spread_deg}");
        let lone = paths(&[48]);
        let m = compare(&lone.map(|&s| RANGE.scalar(s)), &truth, &camera, &RANGE);
        assert!((m.azimuth_spread_error_deg - spread_deg).abs() < 1e-4, "{m:?}, {spread_deg}");
        let m = compare(&truth.map(|&s| RANGE.scalar(s)), &truth, &camera, &RANGE);
        assert!(m.azimuth_spread_error_deg < 1e-3, "{m:?}");
    }

    #[test]
    fn total_power_is_counted_path_by_path_and_as_far_as_the_range_reaches() {
        let camera = camera();
        let total = |predicted: &Raster<f32>, truth: &Raster<f32>| {
            compare(&predicted.map(|&s| RANGE.scalar(s)), truth, &camera, &RANGE).total_power_error_db
        };
        let two = paths(&[27, 68]);
        assert!((total(&paths(&[27]), &two) - 10.0 * 2f64.log10()).abs() < 1e-4);
        assert!(total(&paths(&[10, 80]), &two) < 1e-4, "where power is does not matter to how much it is");
        // 1e-4 /sr is over the range's upper end of −60 dB: the best that can be predicted is 20 dB less.
        let strong = two.map(|&s| if s > 0.0 { 1e-4 } else { 0.0 });
        assert!((total(&strong, &strong) - 20.0).abs() < 1e-4);
        // What is observed under the floor counts as observed, and can only be predicted as nothing.
        let with_floor = two.map(|&s| if s > 0.0 { s } else { 0.9e-12 });
        let image_sr: f64 = (0..96 * 64).map(|i| camera.pixel_solid_angle_sr(i % 96, i / 96)).sum();
        let expected = 10.0 * (1.0 + 0.9e-12 * image_sr / 2e-10).log10();
        assert!((total(&with_floor, &with_floor) - expected).abs() < 1e-4, "{expected}");
    }

    #[test]
    fn an_empty_prediction_is_finite_and_bad() {
        let truth = lobe(40.0, 30.0);
        let m = compare(&Raster::filled(96, 64, 0.0), &truth, &camera(), &RANGE);
        assert_eq!(m.total_power_error_db, 60.0);
        assert!((m.psp_similarity - 0.5).abs() < 1e-9 && m.rmse_db.is_finite());
    }
}
