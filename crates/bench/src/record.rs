//! One run's record: `metrics.json`.

use crate::json::{read_json, write_numbers};
use crate::metrics::{COLUMNS, Column, FrameMetrics};
use crate::numbers;
use crate::provenance::Provenance;
use crate::split::Protocol;
use anyhow::{Context, Result};
use corf::LatencySummary;
use corf::depth::DepthQuality;
use corf_scene::io::write_atomic;
use flate2::Compression;
use flate2::read::GzDecoder;
use flate2::write::GzEncoder;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;

/// Version of the record's layout.
pub const SCHEMA: &str = "corf-metrics/1";
/// The evaluation protocol these numbers follow: held-out keyframes by [`Protocol`], metrics as the README defines them.
pub const PROTOCOL: &str = "corf-heldout/2";
/// Description of the interval that a record's clock measures.
pub const CLOCK: &str = "from the first decoded training keyframe in memory to the finished field; reading and decoding files (ahead of the clock as far as memory allows), writing the field and evaluating are not included";

/// Everything one cell (method × dataset × seed) has to say.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Record {
    /// [`SCHEMA`].
    pub schema: String,
    /// [`PROTOCOL`].
    pub protocol: String,
    /// Evaluation protocol: the split into training and held-out keyframes.
    #[serde(default)]
    pub split: Protocol,
    /// The row of the table this cell belongs to.
    pub row: String,
    /// Method id.
    pub method: String,
    /// Resolved configuration of the method.
    pub config: serde_json::Value,
    /// Name of the dataset.
    pub dataset: String,
    /// Hash of the dataset.
    pub dataset_hash: String,
    /// Whether every file of the dataset was checked against its recorded SHA-256 before it was read.
    #[serde(default)]
    pub dataset_verified: bool,
    /// Seed.
    pub seed: u64,
    /// Source and machine.
    pub provenance: Provenance,
    /// SHA-256 of the weights that LPIPS was computed with, by backbone; empty where it was not computed.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub lpips_weights: BTreeMap<String, String>,
    /// Device the method ran on.
    pub device: String,
    /// Whether the method read ground-truth depth through the simulated monocular prior.
    pub uses_ground_truth_depth: bool,
    /// Description of the interval that the clock measured ([`CLOCK`]).
    pub clock: String,
    /// Results, or the reason why there are none.
    #[serde(flatten)]
    pub outcome: Outcome,
}

/// A cell ends in numbers or in the reason why there are none; failed cells stay in the table.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(tag = "status", rename_all = "snake_case")]
pub enum Outcome {
    /// Numbers.
    Done(Box<Numbers>),
    /// The reason.
    Failed {
        /// The error.
        error: String,
    },
}

/// The numbers of a finished cell.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct Numbers {
    /// Reconstruction time, seconds (see `clock`).
    pub seconds: f64,
    /// Gaussians in the finished field.
    pub gaussians: Option<usize>,
    /// Peak resident memory of the process during the cell, bytes.
    pub peak_memory_bytes: Option<u64>,
    /// Means over the held-out frames, by column key, of what every frame has.
    pub means: BTreeMap<String, f64>,
    /// Median and 90th percentile of the peak AoA error, degrees.
    pub peak_error_median_p90_deg: [f64; 2],
    /// Raw metrics of every held-out frame.
    pub frames: Vec<FrameMetrics>,
    /// Growth over time.
    pub curve: Vec<CurvePoint>,
    /// Latency of keyframes, for methods that work keyframe by keyframe.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub latency: Option<LatencySummary>,
    /// Errors of the depths of new Gaussians, for methods that estimate depth, where the dataset has the true depth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth: Option<DepthQuality>,
}

/// One point of the time and Gaussian-count curves.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct CurvePoint {
    /// Seconds on the record's clock.
    pub seconds: f64,
    /// Share of the work done, `[0, 1]`.
    pub progress: f64,
    /// Gaussians at that time.
    pub gaussians: Option<usize>,
}

/// No archive unpacks to more, bytes.
const LARGEST_ARCHIVE: u64 = 1 << 30;

impl Record {
    /// Reads a record.
    ///
    /// # Errors
    /// A missing file, one that is not a record, or a number in it that is none, by its key.
    pub fn read(path: &Path) -> Result<Self> {
        let value: serde_json::Value = read_json(path)?;
        numbers::check(&value).with_context(|| format!("in {}", path.display()))?;
        serde_json::from_value(value).with_context(|| format!("{} is not the JSON expected here", path.display()))
    }

    /// Writes it whole, or not at all.
    ///
    /// # Errors
    /// A number that is none, by its key; a folder that cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        write_numbers(path, self)
    }
}

/// File of a results folder that holds all its records, one a line.
pub const ARCHIVE: &str = "records.jsonl.gz";

/// Writes records into one file, in their order.
///
/// # Errors
/// A number that is none, by its key; a folder that cannot be written.
pub fn write_archive(path: &Path, records: &[Record]) -> Result<()> {
    let mut packed = GzEncoder::new(Vec::new(), Compression::best());
    for record in records {
        let value = serde_json::to_value(record)?;
        numbers::check(&value).with_context(|| format!("{} is not written", path.display()))?;
        writeln!(packed, "{value}")?;
    }
    Ok(write_atomic(path, &packed.finish()?)?)
}

/// Reads what [`write_archive`] wrote.
///
/// # Errors
/// A missing file, one that holds something else, or a number in it that is none; the line is named.
pub fn read_archive(path: &Path) -> Result<Vec<Record>> {
    let file = std::fs::File::open(path).with_context(|| format!("cannot read {}", path.display()))?;
    let lines = BufReader::new(GzDecoder::new(file).take(LARGEST_ARCHIVE)).lines();
    let record = |(number, line): (usize, std::io::Result<String>)| {
        let read = || -> Result<Record> {
            let value: serde_json::Value = serde_json::from_str(&line?)?;
            numbers::check(&value)?;
            Ok(serde_json::from_value(value)?)
        };
        read().with_context(|| format!("{}, line {}, is not the record expected here", path.display(), number + 1))
    };
    lines.enumerate().map(record).collect()
}

impl Numbers {
    /// Checks that all of them are numbers.
    ///
    /// # Errors
    /// The first that is not, by its key.
    pub fn check(&self) -> Result<()> {
        numbers::check(&serde_json::to_value(self)?)
    }

    /// Means and percentiles from raw frames.
    pub fn of(
        frames: Vec<FrameMetrics>,
        seconds: f64,
        gaussians: Option<usize>,
        peak_memory_bytes: Option<u64>,
        curve: Vec<CurvePoint>,
        latency: Option<LatencySummary>,
    ) -> Self {
        let mean = |c: &Column| Some(frames.iter().map(c.of).sum::<Option<f64>>()? / frames.len().max(1) as f64);
        let means = COLUMNS.iter().filter_map(|c| Some((c.key.to_owned(), mean(c)?))).collect();
        let mut errors: Vec<f64> = frames.iter().map(|f| f.radio.peak_error_deg).collect();
        errors.sort_by(f64::total_cmp);
        let peak_error_median_p90_deg = [quantile(&errors, 0.5), quantile(&errors, 0.9)];
        Self { seconds, gaussians, peak_memory_bytes, means, peak_error_median_p90_deg, frames, curve, latency, depth: None }
    }

    /// Adds the errors of the depths.
    pub fn with_depth(self, depth: Option<DepthQuality>) -> Self {
        Self { depth, ..self }
    }
}

/// A quantile of sorted values by linear interpolation; 0 without any.
fn quantile(sorted: &[f64], q: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return 0.0 };
    let at = q * last as f64;
    let (low, high) = (at.floor() as usize, at.ceil() as usize);
    sorted[low] + (sorted[high] - sorted[low]) * (at - low as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_interpolate() {
        let values = [0.0, 1.0, 2.0, 3.0, 10.0];
        assert_eq!(quantile(&values, 0.5), 2.0);
        assert!((quantile(&values, 0.9) - 7.2).abs() < 1e-12);
        assert_eq!(quantile(&[], 0.5), 0.0);
    }
}
