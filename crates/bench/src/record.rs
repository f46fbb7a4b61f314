//! One run's record: `metrics.json`.

use crate::json::{read_json, write_numbers};
use crate::method::StageTime;
use crate::metrics::{COLUMNS, Column, FrameMetrics};
use crate::numbers;
use crate::provenance::Provenance;
use crate::split::Protocol;
use crate::stats::quantile;
use anyhow::{Context, Result, bail, ensure};
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

/// Method id of records of predictions that another program made and `corf` only scored.
pub const PREDICTIONS: &str = "predictions";
/// Description of the interval of such a record's seconds.
pub const STATED_CLOCK: &str = "as the maker of the predictions states it; not measured here";

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
    /// Id of the planned cell ([`crate::cluster`]) that the record is of, where it was one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cell: Option<String>,
    /// Source and machine.
    pub provenance: Provenance,
    /// SHA-256 of the weights that LPIPS was computed with, by backbone; empty where it was not computed.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub lpips_weights: BTreeMap<String, String>,
    /// Device the method ran on.
    pub device: String,
    /// Whether the method read the data set's depth, as it is or through the simulated monocular prior: the ray tracer's own, but for `depth_imported`.
    pub uses_ground_truth_depth: bool,
    /// Whether the depth that was read came with an imported capture, and is as true as whatever measured it.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub depth_imported: bool,
    /// Whether the method knew the true scene, as an oracle does.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub uses_scene: bool,
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
    /// Reconstruction time, seconds (see `clock`); predictions made elsewhere may come without.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Gaussians in the finished field.
    pub gaussians: Option<usize>,
    /// Peak resident memory of the process during the cell, bytes.
    pub peak_memory_bytes: Option<u64>,
    /// The columns' numbers by key: means over the held-out frames, or what else the column says.
    pub means: BTreeMap<String, f64>,
    /// Median and 90th percentile of the peak AoA error, degrees, where spectra were predicted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub peak_error_median_p90_deg: Option<[f64; 2]>,
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
    /// What the stages took, for methods that have some.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stages: Vec<StageTime>,
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
        let record: Self =
            serde_json::from_value(value).with_context(|| format!("{} is not the JSON expected here", path.display()))?;
        record.check_whole().with_context(|| format!("in {}", path.display()))?;
        Ok(record)
    }

    /// Checks that nothing is missing that the record cannot be without.
    ///
    /// # Errors
    /// A method's time, or a frame's metric whose mean is there, by its key.
    fn check_whole(&self) -> Result<()> {
        const HELP: &str = "the record is damaged: make it again";
        let Outcome::Done(numbers) = &self.outcome else { return Ok(()) };
        ensure!(numbers.seconds.is_some() || self.method == PREDICTIONS, "seconds is missing\n  help: {HELP}");
        for column in COLUMNS.iter().filter(|c| numbers.means.contains_key(c.key)) {
            if let Some(frame) = numbers.frames.iter().find(|f| !column.leaves_out(f) && (column.of)(f).is_none()) {
                bail!("the frame of keyframe {} lacks what {} needs\n  help: {HELP}", frame.index, column.key);
            }
        }
        Ok(())
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
    let file = corf_scene::io::open(path)?;
    let lines = BufReader::new(GzDecoder::new(file).take(LARGEST_ARCHIVE)).lines();
    let record = |(number, line): (usize, std::io::Result<String>)| {
        let read = || -> Result<Record> {
            let value: serde_json::Value = serde_json::from_str(&line?)?;
            numbers::check(&value)?;
            let record: Record = serde_json::from_value(value)?;
            record.check_whole()?;
            Ok(record)
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
        seconds: Option<f64>,
        gaussians: Option<usize>,
        peak_memory_bytes: Option<u64>,
        curve: Vec<CurvePoint>,
        latency: Option<LatencySummary>,
    ) -> Self {
        let means = COLUMNS.iter().filter_map(|c| Some((c.key.to_owned(), c.over(&frames)?))).collect();
        let mut errors: Vec<f64> = frames.iter().filter_map(|f| Some(f.spectrum?.radio.peak_error_deg)).collect();
        errors.sort_by(f64::total_cmp);
        let peak_error_median_p90_deg = (!errors.is_empty()).then(|| [quantile(&errors, 0.5), quantile(&errors, 0.9)]);
        Self {
            seconds,
            gaussians,
            peak_memory_bytes,
            means,
            peak_error_median_p90_deg,
            frames,
            curve,
            latency,
            depth: None,
            stages: Vec::new(),
        }
    }

    /// Held-out images that the metrics of images leave out, for none of their pixels count.
    pub fn masked_out(&self) -> usize {
        self.frames.iter().filter(|f| f.masked_out).count()
    }

    /// A column's number; of records that are older than the column, what their frames give. `None` where they give none.
    pub fn value(&self, column: &Column) -> Option<f64> {
        self.means.get(column.key).copied().or_else(|| column.over(&self.frames))
    }

    /// Adds the time of processes before this one, which the cell was gone on with from a checkpoint. Points of the curve are those since.
    pub fn add_earlier(&mut self, earlier_s: f64) {
        self.seconds = self.seconds.map(|seconds| seconds + earlier_s);
        self.curve.iter_mut().for_each(|point| point.seconds += earlier_s);
    }

    /// Adds the errors of the depths.
    pub fn with_depth(self, depth: Option<DepthQuality>) -> Self {
        Self { depth, ..self }
    }

    /// Adds what the stages took.
    pub fn with_stages(self, stages: Vec<StageTime>) -> Self {
        Self { stages, ..self }
    }
}
