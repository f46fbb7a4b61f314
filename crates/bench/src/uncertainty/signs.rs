//! What is looked at around a pixel of a predicted spectrum to tell how far it may be off.

use crate::methods::distance_m;
use anyhow::{Context, Result, ensure};
use corf_scene::keyframe::DbRange;
use corf_scene::{Pinhole, Raster, Rigid3};
use glam::DVec3;
use rayon::prelude::*;

/// Training keyframes that are looked at around a pose.
const NEIGHBOURS: usize = 3;
/// Half a window's side, degrees in the middle of the image: errors are where lobes are, and lobes are not exactly where they are predicted.
const REACH_DEG: f64 = 3.0;
/// Metres that one radian of rotation counts, as in the lookups.
const METRES_PER_RADIAN: f64 = 1.0;
/// Added to distances, metres: closer keyframes are no better.
pub(super) const SOFTENING_M: f64 = 0.1;
/// Added to squares before their logarithm, dB²: what is flat to a decibel is flat.
const SOFTENING_DB2: f64 = 1.0;

/// Number of signs.
pub const COUNT: usize = 5;
/// Place of the sign of distance among them.
pub(super) const OF_DISTANCE: usize = 4;

/// Signs of a pixel: 1, then logarithms of how rough the prediction is around it, of how wrong the training keyframes around it are in its direction, of
/// how far the prediction is from what they have observed there, and of how far away the nearest of them is.
pub type Signs = [f64; COUNT];

/// A training keyframe: what was observed there, and how far a field is off at what it was trained with.
#[derive(Clone, Debug)]
pub struct Known {
    pose: Rigid3,
    observed_db: Raster<f32>,
    /// Mean of squared errors over the window around each pixel, dB².
    error2: Raster<f32>,
    mean_error2: f64,
}

/// The training keyframes of a field, with their errors.
#[derive(Clone, Debug)]
pub struct TrainingKeyframes {
    camera: Pinhole,
    range: DbRange,
    reach_px: usize,
    known: Vec<Known>,
}

impl TrainingKeyframes {
    /// Nothing known yet, of spectra of a camera over a range of decibels.
    pub fn new(camera: Pinhole, range: DbRange) -> Self {
        let reach_px = (REACH_DEG.to_radians() * camera.fx).round().max(1.0) as usize;
        Self { camera, range, reach_px, known: Vec::new() }
    }

    /// The range that levels are on.
    pub fn range(&self) -> &DbRange {
        &self.range
    }

    /// Adds a training keyframe: its spectrum, linear, and the levels in `[0, 1]` that the field predicts there.
    ///
    /// # Errors
    /// Rasters of another size than the camera's.
    pub fn add(&mut self, pose: Rigid3, observed: &Raster<f32>, predicted: &Raster<f32>) -> Result<()> {
        for raster in [observed, predicted] {
            ensure!(
                (raster.width(), raster.height()) == (self.camera.width, self.camera.height),
                "a spectrum is {}x{} and the camera says {}x{}",
                raster.width(),
                raster.height(),
                self.camera.width,
                self.camera.height
            );
        }
        let observed_db = self.decibels(&observed.map(|&s| self.range.scalar(s)));
        let predicted_db = self.decibels(predicted);
        let squares = Raster::from_fn(observed.width(), observed.height(), |x, y| {
            f64::from(predicted_db[(x, y)] - observed_db[(x, y)]).powi(2)
        });
        let mean_error2 = squares.pixels().iter().sum::<f64>() / squares.pixels().len() as f64;
        let error2 = smoothed(&squares, self.reach_px).map(|&v| v as f32);
        self.known.push(Known { pose, observed_db, error2, mean_error2 });
        Ok(())
    }

    /// Levels in decibels.
    pub fn decibels(&self, scalar: &Raster<f32>) -> Raster<f32> {
        scalar.map(|&s| self.range.db(s) as f32)
    }

    /// Distance of the nearest training keyframe from a pose, metres, with turns counted in.
    ///
    /// # Errors
    /// No training keyframe.
    pub fn nearest_m(&self, pose: &Rigid3) -> Result<f64> {
        Ok(self.nearest(pose)?[0].0)
    }

    fn nearest(&self, pose: &Rigid3) -> Result<Vec<(f64, &Known)>> {
        let mut near: Vec<_> = self.known.iter().map(|k| (distance_m(&k.pose, pose, METRES_PER_RADIAN), k)).collect();
        near.sort_by(|a, b| a.0.total_cmp(&b.0));
        near.truncate(NEIGHBOURS);
        ensure!(!near.is_empty(), "there is no training keyframe with a spectrum to compare with");
        Ok(near)
    }

    /// The signs of every pixel of a spectrum that is predicted at a pose as levels in `[0, 1]`, by rows.
    ///
    /// # Errors
    /// No training keyframe; a prediction of another size than the camera's.
    pub fn signs(&self, pose: &Rigid3, predicted: &Raster<f32>) -> Result<Vec<Signs>> {
        let (width, height) = (self.camera.width, self.camera.height);
        ensure!((predicted.width(), predicted.height()) == (width, height), "the prediction is not of the data set's spectra");
        let near = self.nearest(pose)?;
        let predicted = self.decibels(predicted).map(|&v| f64::from(v));
        let means = smoothed(&predicted, self.reach_px);
        let squares = smoothed(&predicted.map(|v| v * v), self.reach_px);
        let everywhere = near.iter().map(|(_, k)| k.mean_error2).sum::<f64>() / near.len() as f64;
        let pixel = |i: usize| {
            let (x, y) = (i % width, i / width);
            let direction = pose.transform_vector(self.camera.pixel_direction(x, y));
            let (mut weights, mut error2, mut apart2) = (0.0, 0.0, 0.0);
            for (distance, known) in &near {
                let Some(at) = self.pixel_of(known, direction) else { continue };
                let weight = 1.0 / (distance + SOFTENING_M);
                weights += weight;
                error2 += weight * f64::from(known.error2[at]);
                apart2 += weight * (predicted.pixels()[i] - f64::from(known.observed_db[at])).powi(2);
            }
            if weights > 0.0 { [error2 / weights, apart2 / weights] } else { [everywhere, f64::NAN] }
        };
        let seen: Vec<[f64; 2]> = (0..width * height).into_par_iter().map(pixel).collect();
        // Where no neighbour looks, the prediction is taken to be as far from them as elsewhere in the image, in the mean.
        let (sum, count) = seen.iter().filter(|s| s[1].is_finite()).fold((0.0, 0), |(sum, n), s| (sum + s[1], n + 1));
        let elsewhere = if count > 0 { sum / f64::from(count) } else { everywhere };
        let apart =
            Raster::from_vec(width, height, seen.iter().map(|s| if s[1].is_finite() { s[1] } else { elsewhere }).collect());
        let apart = smoothed(&apart, self.reach_px);
        let log = |square: f64| 0.5 * (square.max(0.0) + SOFTENING_DB2).ln();
        let distance = (near[0].0 + SOFTENING_M).ln();
        let signs = |i: usize| {
            let rough = squares.pixels()[i] - means.pixels()[i].powi(2);
            [1.0, log(rough), log(seen[i][0]), log(apart.pixels()[i]), distance]
        };
        Ok((0..width * height).map(signs).collect())
    }

    /// The pixel of a training keyframe that looks in a direction of the world.
    fn pixel_of(&self, known: &Known, direction: DVec3) -> Option<(usize, usize)> {
        let at = self.camera.project(known.pose.rotation.transpose() * direction)?;
        let inside = at.x >= 0.0 && at.y >= 0.0 && at.x < self.camera.width as f64 && at.y < self.camera.height as f64;
        inside.then_some((at.x as usize, at.y as usize))
    }

    /// Errors of a prediction in dB, by rows: predicted minus observed, both on the range.
    pub fn errors(&self, predicted: &Raster<f32>, observed: &Raster<f32>) -> Vec<f64> {
        let pairs = predicted.pixels().iter().zip(observed.pixels());
        pairs.map(|(p, o)| self.range.db(*p) - self.range.db(self.range.scalar(*o))).collect()
    }
}

/// Means over windows of `2·reach + 1` pixels a side; beyond the edges the pixels there go on.
fn smoothed(raster: &Raster<f64>, reach: usize) -> Raster<f64> {
    let along = |count: usize, at: &dyn Fn(usize) -> f64| -> Vec<f64> {
        let value = |i: isize| at(i.clamp(0, count as isize - 1) as usize);
        let (reach, share) = (reach as isize, 1.0 / (2 * reach + 1) as f64);
        let mut sum: f64 = (-reach..=reach).map(value).sum();
        let mut out = Vec::with_capacity(count);
        for i in 0..count as isize {
            out.push(sum * share);
            sum += value(i + reach + 1) - value(i - reach);
        }
        out
    };
    let (width, height) = (raster.width(), raster.height());
    let rows: Vec<f64> = (0..height).flat_map(|y| along(width, &|x| raster[(x, y)])).collect();
    let columns: Vec<Vec<f64>> = (0..width).map(|x| along(height, &|y| rows[y * width + x])).collect();
    Raster::from_fn(width, height, |x, y| columns[x][y])
}

impl TrainingKeyframes {
    /// The training keyframes of a run, at each of which its field is rendered once; `render` answers levels in `[0, 1]`.
    ///
    /// # Errors
    /// A data set without spectra, an unreadable keyframe, what `render` answers.
    pub fn of(
        dataset: &corf_scene::dataset::Dataset,
        train: &[usize],
        mut render: impl FnMut(&Rigid3) -> Result<Raster<f32>>,
    ) -> Result<Self> {
        let place = || format!("{} has no spectra, of which decibels would be uncertain", dataset.dir().display());
        let mut surroundings = Self::new(dataset.radio_camera(), dataset.db_range().with_context(place)?);
        for &index in train {
            let keyframe = dataset.keyframe(index).with_context(|| format!("while reading training keyframe {index}"))?;
            let radio = keyframe.radio.with_context(place)?;
            surroundings.add(keyframe.world_from_camera, &radio.spectrum, &render(&keyframe.world_from_camera)?)?;
        }
        Ok(surroundings)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_take_means_and_go_on_beyond_the_edges() {
        let raster = Raster::from_fn(5, 1, |x, _| x as f64);
        let near = |a: f64, b: f64| (a - b).abs() < 1e-12;
        let means = smoothed(&raster, 1);
        assert!(means.pixels().iter().zip([1.0 / 3.0, 1.0, 2.0, 3.0, 11.0 / 3.0]).all(|(a, b)| near(*a, b)), "{means:?}");
        assert!(smoothed(&Raster::filled(3, 4, 2.5), 7).pixels().iter().all(|v| near(*v, 2.5)));
    }

    #[test]
    fn errors_of_the_keyframes_around_are_found_in_their_direction_of_the_world() {
        let camera = Pinhole::from_horizontal_fov(48, 32, 90.0);
        let range = DbRange { min_db: -110.0, max_db: -40.0 };
        let looking =
            |x: f64, towards: DVec3| Rigid3::looking_at(DVec3::new(x, 0.0, 1.5), DVec3::new(x, 0.0, 1.5) + towards, DVec3::Z);
        let mut around = TrainingKeyframes::new(camera, range);
        let silent = Raster::filled(48, 32, 0.0);
        // It looks along x and is wrong by 7 dB in its left half, which looks to +y.
        let wrong = Raster::from_fn(48, 32, |x, _| if x < 24 { 0.1 } else { 0.0 });
        around.add(looking(0.0, DVec3::X), &silent, &wrong).unwrap();
        // Turned by 45° to the right, its left half looks where the other's right half does, which is right, and its right half where nobody has looked.
        let pose = looking(0.3, DVec3::new(1.0, -1.0, 0.0));
        let signs = around.signs(&pose, &silent).unwrap();
        let error = |x: usize| ((2.0 * signs[16 * 48 + x][2]).exp() - SOFTENING_DB2).max(0.0).sqrt();
        assert!(error(10) < 0.1, "{}", error(10));
        let mean = (7.0_f64.powi(2) / 2.0).sqrt();
        assert!((error(40) - mean).abs() < 0.1, "where it does not look: its mean, {} of {mean}", error(40));
        let back = around.signs(&looking(0.3, DVec3::X), &silent).unwrap();
        let error = |x: usize| ((2.0 * back[16 * 48 + x][2]).exp() - SOFTENING_DB2).max(0.0).sqrt();
        assert!((error(5) - 7.0).abs() < 0.1 && error(40) < 0.1, "{} {}", error(5), error(40));
        assert!((around.nearest_m(&pose).unwrap() - 0.3 - std::f64::consts::FRAC_PI_4).abs() < 1e-9);
    }
}
