//! The file of a calibration: what held-out keyframes have taught about the errors of a method.

use super::NOMINAL;
use super::coverage::Judged;
use super::fit::{factor, log_deviation, weights};
use super::signs::{COUNT, OF_DISTANCE, SOFTENING_M, Signs};
use crate::files::json::{read_numbers, write_numbers};
use crate::split::Protocol;
use anyhow::{Context, Result, ensure};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Version of the file.
const SCHEMA: &str = "corf-uncertainty/1";
/// Fewer held-out keyframes than this tell nothing of others.
pub const LEAST_KEYFRAMES: usize = 4;
/// Least and greatest standard deviation, dB.
const BOUNDS_DB: [f64; 2] = [0.01, 200.0];
/// Examples of a keyframe that are learnt from at most: pixels that lie close together tell the same.
const MOST_OF_A_KEYFRAME: usize = 20_000;
/// Spreads of an ensemble under this say nothing, dB.
const LEAST_SPREAD_DB: f64 = 0.1;

/// Signs and errors of the pixels of a held-out keyframe, and the spread of an ensemble at them, where there is one.
#[derive(Clone, Debug)]
pub struct Examples {
    /// Index of the keyframe.
    pub index: usize,
    /// Signs, by rows.
    pub signs: Vec<Signs>,
    /// Predicted minus observed, dB.
    pub errors_db: Vec<f64>,
    /// Standard deviation over an ensemble, dB.
    pub spread_db: Option<Vec<f64>>,
}

/// What makes the spread of an ensemble a standard deviation: ln σ = w₀ + w₁·ln spread.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct OfEnsemble {
    /// w₀ and w₁.
    pub weights: [f64; 2],
    /// Half an interval in standard deviations.
    pub factor_90: f64,
    /// Runs in it.
    pub runs: usize,
}

impl OfEnsemble {
    fn signs(spread_db: f64) -> [f64; 2] {
        [1.0, spread_db.max(LEAST_SPREAD_DB).ln()]
    }

    /// Judges a held-out keyframe by the spread there; nothing where there is none.
    pub fn judge<'e>(&self, examples: &'e Examples) -> Option<Judged<'e>> {
        let spread_db = examples.spread_db.as_ref()?;
        let deviations_db = spread_db.iter().map(|s| deviation_db(&self.weights, &Self::signs(*s))).collect();
        Some(Judged { index: examples.index, errors_db: &examples.errors_db, deviations_db, factor: self.factor_90 })
    }
}

/// A calibration.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Calibration {
    schema: String,
    /// Method whose errors it knows.
    pub method: String,
    /// Name of the data set that it was fitted on.
    pub dataset: String,
    /// Hash of it.
    pub dataset_hash: String,
    /// Protocol whose held-out keyframes it was fitted on.
    pub protocol: Protocol,
    /// Number of these.
    pub keyframes: usize,
    /// Weights of the signs: ln σ = Σ w·s, σ in dB.
    pub weights: [f64; COUNT],
    /// Half a 90 % interval in standard deviations.
    pub factor_90: f64,
    /// Share of errors within the interval at each of these keyframes, fitted on the others.
    pub coverage_left_out: f64,
    /// The least of these shares.
    pub least_coverage_left_out: f64,
    /// The ensemble that it was compared with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub ensemble: Option<OfEnsemble>,
}

/// σ within its bounds, dB.
fn deviation_db<const N: usize>(weights: &[f64; N], signs: &[f64; N]) -> f64 {
    log_deviation(weights, signs).exp().clamp(BOUNDS_DB[0], BOUNDS_DB[1])
}

/// Every so many examples of a keyframe.
fn thinned<const N: usize>(examples: impl ExactSizeIterator<Item = ([f64; N], f64)>) -> Vec<([f64; N], f64)> {
    let every = examples.len().div_ceil(MOST_OF_A_KEYFRAME).max(1);
    examples.step_by(every).collect()
}

/// Weights of the examples of some keyframes, and the factor with which intervals hold the nominal share of them.
fn fitted<const N: usize>(keyframes: &[&[([f64; N], f64)]]) -> Result<([f64; N], f64)> {
    let all = keyframes.concat();
    let weights = weights(&all)?;
    let mut ratios: Vec<f64> = all.iter().map(|(signs, error)| error.abs() / deviation_db(&weights, signs)).collect();
    Ok((weights, factor(&mut ratios, NOMINAL)))
}

impl Calibration {
    /// Fits held-out keyframes of a method's run on a data set.
    ///
    /// # Errors
    /// Too few keyframes; errors of which nothing follows.
    pub fn fit(
        method: &str,
        [dataset, dataset_hash]: [&str; 2],
        protocol: Protocol,
        examples: &[Examples],
        runs: usize,
    ) -> Result<Self> {
        ensure!(
            examples.len() >= LEAST_KEYFRAMES,
            "{} held-out keyframes are too few: what is learnt from fewer than {LEAST_KEYFRAMES} says nothing of others\n  help: generate more \
             keyframes, or hold more out (split.test_every)",
            examples.len()
        );
        let of = |e: &Examples| thinned(e.signs.iter().copied().zip(e.errors_db.iter().copied()));
        let keyframes: Vec<_> = examples.iter().map(of).collect();
        let all: Vec<&[_]> = keyframes.iter().map(Vec::as_slice).collect();
        let (weights, factor_90) = fitted(&all)?;
        let left_out = (0..all.len()).map(|k| -> Result<f64> {
            let others: Vec<&[_]> = all.iter().enumerate().filter(|(i, _)| *i != k).map(|(_, e)| *e).collect();
            let (weights, factor) = fitted(&others)?;
            let within = all[k].iter().filter(|(signs, error)| error.abs() <= factor * deviation_db(&weights, signs)).count();
            Ok(within as f64 / all[k].len() as f64)
        });
        let left_out: Vec<f64> = left_out.collect::<Result<_>>()?;
        let of_ensemble = |e: &Examples| {
            let spread = e.spread_db.as_ref()?;
            Some(thinned(spread.iter().map(|s| OfEnsemble::signs(*s)).zip(e.errors_db.iter().copied())))
        };
        let ensemble = match examples.iter().map(of_ensemble).collect::<Option<Vec<_>>>() {
            Some(spreads) => {
                let (weights, factor_90) = fitted(&spreads.iter().map(Vec::as_slice).collect::<Vec<_>>())?;
                Some(OfEnsemble { weights, factor_90, runs })
            }
            None => None,
        };
        Ok(Self {
            schema: SCHEMA.to_owned(),
            method: method.to_owned(),
            dataset: dataset.to_owned(),
            dataset_hash: dataset_hash.to_owned(),
            protocol,
            keyframes: examples.len(),
            weights,
            factor_90,
            coverage_left_out: left_out.iter().sum::<f64>() / left_out.len() as f64,
            least_coverage_left_out: left_out.iter().copied().fold(1.0, f64::min),
            ensemble,
        })
    }

    /// Standard deviations of pixels, dB.
    pub fn deviations_db(&self, signs: &[Signs]) -> Vec<f64> {
        signs.iter().map(|s| deviation_db(&self.weights, s)).collect()
    }

    /// Judges held-out keyframes by it.
    pub fn judge<'e>(&self, examples: &'e Examples) -> Judged<'e> {
        Judged {
            index: examples.index,
            errors_db: &examples.errors_db,
            deviations_db: self.deviations_db(&examples.signs),
            factor: self.factor_90,
        }
    }

    /// The factor by which standard deviations at a pose change when its nearest training keyframe is `to_m` away instead of `from_m`; no less than the
    /// square root of the distances' ratio is taken, and no more than all of it.
    pub fn nearer(&self, from_m: f64, to_m: f64) -> f64 {
        ((to_m.min(from_m) + SOFTENING_M) / (from_m + SOFTENING_M)).powf(self.weights[OF_DISTANCE].clamp(0.5, 1.0))
    }

    /// Writes it.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        write_numbers(path, self)
    }

    /// Reads it, for a method.
    ///
    /// # Errors
    /// A file that is none, of another version, or of another method.
    pub fn read(path: &Path, method: &str) -> Result<Self> {
        let place = path.display();
        let read: Self =
            read_numbers(path).with_context(|| format!("{place} is no calibration\n  help: `corf uncertainty fit` makes one"))?;
        ensure!(read.schema == SCHEMA, "{place}: schema {} is not {SCHEMA}", read.schema);
        let sound = read.factor_90 > 0.0 && read.weights.iter().all(|w| w.abs() < 1e3);
        ensure!(sound, "{place}: it is damaged\n  help: make it again with `corf uncertainty fit`");
        ensure!(
            read.method == method,
            "{place} knows the errors of {}, and the run is one of {method}\n  help: fit a run of {method} that was made with --protocol validation",
            read.method
        );
        Ok(read)
    }
}

#[cfg(test)]
impl Calibration {
    /// One of these weights.
    pub(super) fn of_weights(weights: [f64; COUNT]) -> Self {
        Self {
            schema: SCHEMA.to_owned(),
            method: "corf-gs".to_owned(),
            dataset: "made".to_owned(),
            dataset_hash: "0".to_owned(),
            protocol: Protocol::VALIDATION,
            keyframes: LEAST_KEYFRAMES,
            weights,
            factor_90: 1.645,
            coverage_left_out: 0.9,
            least_coverage_left_out: 0.9,
            ensemble: None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::uncertainty::{Coverage, TrainingKeyframes};
    use corf_scene::keyframe::DbRange;
    use corf_scene::{Pinhole, Raster, Rigid3, Rng};
    use glam::DVec3;

    const RANGE: DbRange = DbRange { min_db: -110.0, max_db: -40.0 };
    const LEVEL_DB: f64 = -75.0;
    const WIDTH: usize = 48;
    const HEIGHT: usize = 32;

    /// A made field: what is observed is level everywhere, and predictions are off by 6 dB to the left and by 1 dB to the right of every pose.
    fn made(rng: &mut Rng) -> (Raster<f32>, Raster<f32>) {
        let observed = Raster::filled(WIDTH, HEIGHT, 10f32.powf(0.1 * LEVEL_DB as f32));
        let predicted = Raster::from_fn(WIDTH, HEIGHT, |x, _| {
            let db = LEVEL_DB + rng.normal() * if x < WIDTH / 2 { 6.0 } else { 1.0 };
            ((db - RANGE.min_db) / (RANGE.max_db - RANGE.min_db)) as f32
        });
        (observed, predicted)
    }

    fn pose(x: f64) -> Rigid3 {
        let eye = DVec3::new(x, 0.0, 1.5);
        Rigid3::looking_at(eye, eye + DVec3::Y, DVec3::Z)
    }

    /// Training keyframes 0.4 m apart, and examples of poses between them.
    fn world() -> (TrainingKeyframes, Vec<Examples>) {
        let mut rng = Rng::keyed(5, 6, 7);
        let mut around = TrainingKeyframes::new(Pinhole::from_horizontal_fov(WIDTH, HEIGHT, 90.0), RANGE);
        for i in 0..14 {
            let (observed, predicted) = made(&mut rng);
            around.add(pose(0.4 * f64::from(i)), &observed, &predicted).unwrap();
        }
        let between = |i: usize| {
            let (observed, predicted) = made(&mut rng);
            let pose = pose(0.4 * i as f64 + 0.2);
            let signs = around.signs(&pose, &predicted).unwrap();
            Examples { index: i, signs, errors_db: around.errors(&predicted, &observed), spread_db: None }
        };
        let examples = (0..12).map(between).collect();
        (around, examples)
    }

    /// The examples of one half of their images alone.
    fn half(examples: &Examples, left: bool) -> Examples {
        let take = |i: &usize| (i % WIDTH < WIDTH / 2) == left;
        let pixels: Vec<usize> = (0..examples.signs.len()).filter(take).collect();
        Examples {
            index: examples.index,
            signs: pixels.iter().map(|&i| examples.signs[i]).collect(),
            errors_db: pixels.iter().map(|&i| examples.errors_db[i]).collect(),
            spread_db: None,
        }
    }

    /// Shares of fresh keyframes: of 9 216 pixels, so that a share of 0.9 is known within 0.003.
    fn coverage(calibration: &Calibration, examples: &[Examples]) -> f64 {
        Coverage::of(&examples.iter().map(|e| calibration.judge(e)).collect::<Vec<_>>()).unwrap().coverage
    }

    #[test]
    fn intervals_of_a_made_field_hold_what_they_claim_where_errors_are_large_and_where_they_are_small() {
        let (_, examples) = world();
        let (fitted, fresh) = examples.split_at(6);
        let calibration = Calibration::fit("corf-gs", ["made", "0"], Protocol::VALIDATION, fitted, 1).unwrap();
        let all = coverage(&calibration, fresh);
        assert!((all - NOMINAL).abs() < 0.02, "{all}");
        assert!((calibration.coverage_left_out - NOMINAL).abs() < 0.02, "{}", calibration.coverage_left_out);
        let halves = [true, false].map(|left| fresh.iter().map(|e| half(e, left)).collect::<Vec<_>>());
        for examples in &halves {
            let share = coverage(&calibration, examples);
            assert!((share - NOMINAL).abs() < 0.05, "{share}");
        }
        // One width for all would hold as many errors in all and be wrong in both halves.
        let level = |e: &Examples| Examples { signs: vec![[1.0, 0.0, 0.0, 0.0, 0.0]; e.signs.len()], ..e.clone() };
        let blind =
            Calibration::fit("corf-gs", ["made", "0"], Protocol::VALIDATION, &fitted.iter().map(level).collect::<Vec<_>>(), 1)
                .unwrap();
        let shares = halves.each_ref().map(|half| coverage(&blind, &half.iter().map(level).collect::<Vec<_>>()));
        assert!(shares[0] < 0.83 && shares[1] > 0.99, "{shares:?}");
    }

    #[test]
    fn a_calibration_comes_back_from_its_file_and_is_of_one_method() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("c.json");
        let (_, examples) = world();
        let calibration = Calibration::fit("corf-gs", ["made", "0"], Protocol::VALIDATION, &examples[..5], 1).unwrap();
        calibration.write(&path).unwrap();
        assert_eq!(Calibration::read(&path, "corf-gs").unwrap(), calibration);
        let error = Calibration::read(&path, "corf-array").unwrap_err().to_string();
        assert!(error.contains("errors of corf-gs") && error.contains("--protocol validation"), "{error}");
        let error = Calibration::fit("corf-gs", ["made", "0"], Protocol::VALIDATION, &examples[..3], 1).unwrap_err().to_string();
        assert!(error.contains("too few"), "{error}");
        std::fs::write(&path, "{}").unwrap();
        assert!(format!("{:#}", Calibration::read(&path, "corf-gs").unwrap_err()).contains("no calibration"));
    }

    #[test]
    fn the_spread_of_an_ensemble_is_made_a_standard_deviation() {
        let mut rng = Rng::keyed(8, 9, 10);
        let mut example = |index| {
            let spread: Vec<f64> = (0..4000).map(|_| 0.2 + 3.8 * rng.uniform_f64()).collect();
            let errors_db = spread.iter().map(|s| 2.0 * s * rng.normal()).collect();
            Examples { index, signs: vec![[1.0, 0.0, 0.0, 0.0, 0.0]; spread.len()], errors_db, spread_db: Some(spread) }
        };
        let examples: Vec<Examples> = (0..4).map(&mut example).collect();
        let calibration = Calibration::fit("corf-gs", ["made", "0"], Protocol::VALIDATION, &examples, 3).unwrap();
        let of = calibration.ensemble.unwrap();
        // Errors are twice the spread: w₀ = ln 2, w₁ = 1.
        assert!((of.weights[0] - 2.0_f64.ln()).abs() < 0.03 && (of.weights[1] - 1.0).abs() < 0.03 && of.runs == 3, "{of:?}");
        assert!((of.factor_90 - 1.645).abs() < 0.05);
    }
}
