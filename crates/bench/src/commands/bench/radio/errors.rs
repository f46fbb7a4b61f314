//! How far one sampling of the scattered light is from another: whole diffuse fields of other patches, lattices and photons, at some
//! positions. Their spread is the error of any one of them.
//!
//! An estimate from n samplings is itself uncertain, by 1/√(2n) where the spread is Gaussian and by more where a few heavy arrivals
//! make it: medians and shares hardly notice, but the *worst* of thousands of pixels is the one whose samplings happened to spread
//! most, so it comes out too large and falls towards the truth as samplings are added.
//!
//! Spread shows no bias. Where outliers are cut ([`DiffuseSettings::outlier_share`]), a reference that cuts none and looks along more
//! directions shows it: the distance of the samplings' means. That is blurred by both means' own errors, so it comes out too large as well.

use super::{AT_ONCE, Platform, power};
use crate::terminal::interrupt;
use crate::terminal::progress::Progress;
use anyhow::Result;
use corf_raytrace::radio::{Arrival, DiffuseField, DiffuseSettings, Transmitter};
use corf_raytrace::spectrum::SpectrumSettings;
use corf_scene::trajectory::TrajectoryPose;
use corf_scene::words::counted;
use rayon::prelude::*;
use serde::Serialize;

/// Pixels further under the spectrum's peak are left out of the error, dB.
const RANGE_DB: f64 = 30.0;
/// The standard error wanted of each of them, dB.
const WANTED_DB: f64 = 0.3;
/// A small relative difference in dB.
const DB: f64 = 10.0 / std::f64::consts::LN_10;

/// Sampling errors (one standard error of a single sampling), dB.
#[derive(Clone, Default, Serialize)]
pub(in crate::commands) struct Errors {
    replicas: u64,
    positions: usize,
    /// Error of all arriving power at the worst position, dB.
    total_worst_db: f64,
    /// Error of the diffuse power at the worst position, dB.
    diffuse_worst_db: f64,
    /// … and root mean square over the positions, which says more of few samplings than their worst does.
    diffuse_rms_db: f64,
    /// Pixels within [`RANGE_DB`] of their spectrum's peak.
    pixels: usize,
    pixel_median_db: Option<f64>,
    pixel_p99_db: Option<f64>,
    /// Share of them with an error of [`WANTED_DB`] at most.
    pixel_share_as_wanted: Option<f64>,
    pixel_worst_db: Option<f64>,
    /// Index of that pixel's position along the trajectory.
    pixel_worst_position: Option<usize>,
    /// Pixels of the whole dynamic range.
    pixel_all_median_db: Option<f64>,
    /// Pixels within [`RANGE_DB`] of the peak beside those of the reference, if there is one.
    beside_reference: Option<Beside>,
    /// The same by position.
    by_position: Vec<AtPosition>,
}

/// Errors at one position.
#[derive(Clone, Serialize)]
struct AtPosition {
    /// Its index along the trajectory.
    position: usize,
    total_db: f64,
    diffuse_db: f64,
    /// Pixels within [`RANGE_DB`] of the spectrum's peak.
    pixels: usize,
    pixel_median_db: Option<f64>,
    /// Number of them with an error of more than [`WANTED_DB`].
    pixels_over: usize,
    pixel_worst_db: Option<f64>,
}

/// Distance of samplings' pixels from a reference's.
#[derive(Clone, Serialize)]
struct Beside {
    /// Directions of a sampling of the reference, of which there are as many.
    directions: usize,
    /// Distance of the means.
    bias_median_db: f64,
    bias_p99_db: f64,
    bias_worst_db: f64,
    /// The distances' own standard error: of all pixels, root mean square.
    bias_uncertainty_db: f64,
    /// Standard error and distance together, root mean square: how far a sampling is from the reference.
    rms_median_db: f64,
    rms_p99_db: f64,
    rms_worst_db: f64,
    /// Share of the pixels where that is [`WANTED_DB`] at most.
    rms_share_as_wanted: f64,
}

/// Mean and sum of squared deviations of values that come one by one (Welford, Technometrics 4, 1962).
#[derive(Clone, Copy, Default)]
struct Moments {
    mean: f64,
    deviations: f64,
}

impl Moments {
    /// Takes in a value, the `count`-th.
    fn push(&mut self, value: f64, count: u64) {
        let from_old = value - self.mean;
        self.mean += from_old / count as f64;
        self.deviations += from_old * (value - self.mean);
    }

    /// The standard error of one of `count` values, dB (to first order); none without a mean.
    fn error_db(&self, count: u64) -> f64 {
        if self.mean <= 0.0 {
            return 0.0;
        }
        DB * (self.deviations / (count - 1) as f64).sqrt() / self.mean
    }
}

/// Results of the samplings at one position.
#[derive(Clone)]
struct Watched<'a> {
    /// Its index among all positions.
    index: usize,
    pose: &'a TrajectoryPose,
    /// Resolved arrivals by pair of antenna ports.
    resolved: Vec<Vec<Arrival>>,
    diffuse: Moments,
    total: Moments,
    /// Moments of the spectrum's pixels; empty where none is formed.
    pixels: Vec<Moments>,
}

impl Watched<'_> {
    /// Power below which its pixels are out of range.
    fn floor(&self, range_db: f64) -> f64 {
        self.pixels.iter().fold(0.0f64, |peak, pixel| peak.max(pixel.mean)) * 10f64.powf(-range_db / 10.0)
    }
}

/// A study of sampling errors.
pub(in crate::commands) struct Study<'a, 'p> {
    pub platform: &'a Platform<'p>,
    pub transmitter: &'a Transmitter<'a, 'a>,
    /// Makes the spectra; `None` where powers alone are asked for.
    pub form: Option<&'a SpectrumSettings>,
    pub poses: &'a [TrajectoryPose],
    /// Samplings of other phases, at least 2.
    pub replicas: u64,
    /// Positions, evenly spread.
    pub count: usize,
    /// Directions of a reference that cuts no outliers.
    pub reference: Option<usize>,
}

impl Study<'_, '_> {
    /// Errors of `sampling`.
    pub fn errors(&self, sampling: &DiffuseSettings) -> Result<Errors> {
        let camera = self.platform.config.radio_camera();
        let count = self.count.clamp(1, self.poses.len());
        let pixels = if self.form.is_some() { camera.width * camera.height } else { 0 };
        let watch = |i: usize| {
            let index = (2 * i + 1) * self.poses.len() / (2 * count);
            let pose = &self.poses[index].world_from_camera;
            Ok(Watched {
                index,
                pose: &self.poses[index],
                resolved: self.platform.port_pairs(&self.transmitter.paths(pose.translation)?, pose),
                diffuse: Moments::default(),
                total: Moments::default(),
                pixels: vec![Moments::default(); pixels],
            })
        };
        let mut positions = (0..count).map(watch).collect::<Result<Vec<_>>>()?;
        let mut beside = self.reference.map(|directions| (directions, positions.clone()));
        self.sample("replicas", sampling, 0, &mut positions)?;
        if let Some((directions, positions)) = &mut beside {
            // Other photons as well.
            let sampling = DiffuseSettings { directions: *directions, outlier_share: 0.0, ..*sampling };
            self.sample("reference", &sampling, self.replicas, positions)?;
        }
        let mut errors = Errors::of(&positions, self.replicas, self.platform.config.radio.dynamic_range_db);
        errors.beside_reference =
            beside.and_then(|(directions, beside)| Beside::of(&positions, &beside, directions, self.replicas));
        Ok(errors)
    }

    /// Takes in all samplings at the positions, of the phases that follow `before`.
    fn sample(&self, what: &'static str, sampling: &DiffuseSettings, before: u64, positions: &mut [Watched<'_>]) -> Result<()> {
        let (camera, count) = (self.platform.config.radio_camera(), positions.len());
        let mut progress = Progress::start(what, self.replicas as usize * count, "positions");
        for number in 1..=self.replicas {
            interrupt::check()?;
            let sampling = DiffuseSettings { phase: before + number, ..*sampling };
            let field = DiffuseField::new(self.platform.tracer, self.transmitter.position(), &sampling)?;
            for (i, batch) in positions.chunks_mut(AT_ONCE).enumerate() {
                interrupt::check()?;
                batch.par_iter_mut().try_for_each(|position| -> corf_scene::Result<()> {
                    let pose = &position.pose.world_from_camera;
                    let scattered = self.platform.gather(&field, pose)?;
                    position.diffuse.push(power(&scattered), number);
                    let mut port_pairs = position.resolved.clone();
                    port_pairs[0].extend(scattered);
                    position.total.push(power(port_pairs.iter().flatten()), number);
                    if let Some(form) = self.form {
                        let image = form.form(&port_pairs, &camera, pose);
                        for (moments, pixel) in position.pixels.iter_mut().zip(image.pixels()) {
                            moments.push(f64::from(*pixel), number);
                        }
                    }
                    Ok(())
                })?;
                let done = (number as usize - 1) * count + ((i + 1) * AT_ONCE).min(count);
                progress.set(done, self.replicas as usize * count);
            }
        }
        progress.finish();
        Ok(())
    }
}

impl Errors {
    fn of(positions: &[Watched<'_>], replicas: u64, dynamic_range_db: f64) -> Self {
        let (mut near, mut all) = (Vec::new(), Vec::new());
        // With its position; an error of nothing, where samplings agree exactly, is one too.
        let mut worst_pixel: Option<(f64, usize)> = None;
        let mut by_position = Vec::with_capacity(positions.len());
        for position in positions {
            let above = |range_db: f64| {
                let floor = position.floor(range_db);
                position.pixels.iter().filter(move |p| p.mean >= floor).map(|p| p.error_db(replicas))
            };
            let mut own: Vec<f64> = above(RANGE_DB).collect();
            own.sort_by(f64::total_cmp);
            if let Some(&error_db) = own.last()
                && worst_pixel.is_none_or(|(worst_db, _)| error_db > worst_db)
            {
                worst_pixel = Some((error_db, position.index));
            }
            by_position.push(AtPosition {
                position: position.index,
                total_db: position.total.error_db(replicas),
                diffuse_db: position.diffuse.error_db(replicas),
                pixels: own.len(),
                pixel_median_db: quantile(&own, 0.5),
                pixels_over: own.len() - own.partition_point(|error| *error <= WANTED_DB),
                pixel_worst_db: own.last().copied(),
            });
            near.extend(own);
            all.extend(above(dynamic_range_db));
        }
        near.sort_by(f64::total_cmp);
        all.sort_by(f64::total_cmp);
        let worst = |of: fn(&AtPosition) -> f64| by_position.iter().map(of).fold(0.0, f64::max);
        Self {
            replicas,
            positions: positions.len(),
            total_worst_db: worst(|p| p.total_db),
            diffuse_worst_db: worst(|p| p.diffuse_db),
            diffuse_rms_db: (by_position.iter().map(|p| p.diffuse_db.powi(2)).sum::<f64>() / positions.len() as f64).sqrt(),
            pixels: near.len(),
            pixel_median_db: quantile(&near, 0.5),
            pixel_p99_db: quantile(&near, 0.99),
            pixel_share_as_wanted: (!near.is_empty()).then(|| share_as_wanted(&near)),
            pixel_worst_db: worst_pixel.map(|(worst_db, _)| worst_db),
            pixel_worst_position: worst_pixel.map(|(_, position)| position),
            pixel_all_median_db: quantile(&all, 0.5),
            beside_reference: None,
            by_position,
        }
    }

    /// The errors as lines for a reader.
    pub(in crate::commands) fn text(&self) -> Vec<String> {
        let mut lines = vec![format!(
            "standard error ({}, {}): total {:.3} dB, diffuse {:.3} dB at worst, {:.3} dB rms",
            counted(self.replicas as usize, "sampling"),
            counted(self.positions, "position"),
            self.total_worst_db,
            self.diffuse_worst_db,
            self.diffuse_rms_db
        )];
        if let (Some(median), Some(share), Some(p99), Some(worst), Some(position), Some(all)) = (
            self.pixel_median_db,
            self.pixel_share_as_wanted,
            self.pixel_p99_db,
            self.pixel_worst_db,
            self.pixel_worst_position,
            self.pixel_all_median_db,
        ) {
            lines.push(format!(
                "pixels within {RANGE_DB:.0} dB of the peak ({}): median {median:.3} dB, {:.1} % up to {WANTED_DB} dB, 99 % under {p99:.3} dB, worst {worst:.3} dB (position {position}); all: median {all:.3} dB",
                self.pixels,
                share * 100.0
            ));
        }
        lines.extend(self.beside_reference.iter().map(Beside::text));
        lines
    }
}

impl Beside {
    /// Distance of samplings from as many of a reference at the same positions; `None` without pixels.
    fn of(positions: &[Watched<'_>], reference: &[Watched<'_>], directions: usize, replicas: u64) -> Option<Self> {
        let (mut biases, mut errors) = (Vec::new(), Vec::new());
        let mut variance = 0.0;
        for (position, reference) in positions.iter().zip(reference) {
            let floor = reference.floor(RANGE_DB);
            for (pixel, right) in position.pixels.iter().zip(&reference.pixels).filter(|(_, right)| right.mean >= floor) {
                let bias_db = DB * (pixel.mean / right.mean - 1.0);
                let error_db = pixel.error_db(replicas);
                biases.push(bias_db.abs());
                errors.push(bias_db.hypot(error_db));
                variance += (error_db.powi(2) + right.error_db(replicas).powi(2)) / replicas as f64;
            }
        }
        biases.sort_by(f64::total_cmp);
        errors.sort_by(f64::total_cmp);
        let of = |sorted: &[f64]| Some([quantile(sorted, 0.5)?, quantile(sorted, 0.99)?, quantile(sorted, 1.0)?]);
        let ([bias_median_db, bias_p99_db, bias_worst_db], [rms_median_db, rms_p99_db, rms_worst_db]) =
            (of(&biases)?, of(&errors)?);
        Some(Self {
            directions,
            bias_median_db,
            bias_p99_db,
            bias_worst_db,
            bias_uncertainty_db: (variance / biases.len() as f64).sqrt(),
            rms_median_db,
            rms_p99_db,
            rms_worst_db,
            rms_share_as_wanted: share_as_wanted(&errors),
        })
    }

    fn text(&self) -> String {
        format!(
            "beside as many samplings of {} directions that cut no outliers: means differ by {:.3} dB (median; 99 % under {:.3}, worst {:.3}; {:.3} is their own error), with the standard error {:.3} dB, {:.3} % up to {WANTED_DB} dB, 99 % under {:.3}, worst {:.3}",
            self.directions,
            self.bias_median_db,
            self.bias_p99_db,
            self.bias_worst_db,
            self.bias_uncertainty_db,
            self.rms_median_db,
            self.rms_share_as_wanted * 100.0,
            self.rms_p99_db,
            self.rms_worst_db
        )
    }
}

/// The value that a share `q` of sorted ones does not exceed.
fn quantile(sorted: &[f64], q: f64) -> Option<f64> {
    sorted.get(((sorted.len() as f64 - 1.0) * q) as usize).copied()
}

/// Share of sorted errors that are as small as wanted.
fn share_as_wanted(sorted: &[f64]) -> f64 {
    sorted.partition_point(|error| *error <= WANTED_DB) as f64 / sorted.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_those_of_the_values() {
        let values = [2.0, 2.2, 1.7, 2.1, 2.5];
        let mut moments = Moments::default();
        for (count, value) in (1..).zip(values) {
            moments.push(value, count);
        }
        let mean = values.iter().sum::<f64>() / 5.0;
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 4.0;
        assert!((moments.mean - mean).abs() < 1e-12);
        assert!((moments.error_db(5) - DB * variance.sqrt() / mean).abs() < 1e-12);
        assert_eq!(Moments::default().error_db(5), 0.0, "dark is no error");
    }
}
