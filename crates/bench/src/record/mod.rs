//! One run's record: `metrics.json`.

pub mod comparability;
pub mod folds;
pub mod prediction_folder;
pub mod predictions;
pub mod provenance;

use crate::files::json::write_numbers;
use crate::files::numbers;
use crate::methods::interface::StageTime;
use crate::metrics::stats::quantile;
use crate::metrics::{COLUMNS, Column, FrameMetrics};
use crate::record::provenance::Provenance;
use crate::split::Protocol;
use anyhow::{Context, Result, anyhow, bail, ensure};
use corf::LatencySummary;
use corf::depth::DepthQuality;
use corf_scene::io::{GzipLines, LineBounds, read_text_within, write_atomic};
use flate2::Compression;
use flate2::write::GzEncoder;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::io::Write;
use std::path::Path;

/// Version of the record's layout.
pub const SCHEMA: &str = "corf-metrics/1";
/// The evaluation protocol these numbers follow: held-out keyframes by [`Protocol`], metrics as the README defines them.
pub const PROTOCOL: &str = "corf-heldout/2";
/// Protocols whose records are read.
const PROTOCOLS: [&str; 2] = ["corf-heldout/1", PROTOCOL];
/// Description of the interval that a record's clock measures.
pub const CLOCK: &str = "from the first decoded training keyframe in memory to the finished field; reading and decoding files (ahead of the clock as far as memory allows), writing the field and evaluating are not included";

/// Method id of records of predictions that another program made and `corf` only scored.
pub const PREDICTIONS: &str = "predictions";
/// Device of such a record where its maker says none.
pub const NOT_STATED: &str = "not stated";
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
    /// Id of the planned cell ([`crate::experiment::cluster`]) that the record is of, where it was one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cell: Option<String>,
    /// Source and machine.
    pub provenance: Provenance,
    /// SHA-256 of the weights that LPIPS was computed with, by backbone; empty where it was not computed.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub lpips_weights: BTreeMap<String, String>,
    /// Device that LPIPS was computed on: `cpu`, a GPU's name, or both where the processor did what the GPU could not; absent where it was not computed, and in
    /// records of programs that did not say it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lpips_device: Option<String>,
    /// Device the method ran on.
    pub device: String,
    /// Whether the method read the data set's depth, as it is or through the simulated monocular prior: the ray tracer's own, but for
    /// `depth_imported`.
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
    /// Peak of what buffers took on the GPU during the cell, bytes; none where no GPU was at work.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub peak_device_memory_bytes: Option<u64>,
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
    /// Quality at that time, where it was evaluated; the evaluation is none of the seconds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub held_out: Option<HeldOutQuality>,
}

/// How well a field at work predicts the held-out keyframes: means over them.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeldOutQuality {
    /// PSNR of images, dB; none where none are predicted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_opt: Option<f64>,
    /// PSNR of spectra on the data set's decibel range, dB; none where none are predicted.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub psnr_rf_scalar: Option<f64>,
}

impl HeldOutQuality {
    /// That of evaluated frames.
    pub fn of(frames: &[FrameMetrics]) -> Self {
        let over = |key: &str| COLUMNS.iter().find(|column| column.key == key)?.over(frames);
        Self { psnr_opt: over("psnr_opt"), psnr_rf_scalar: over("psnr_rf_scalar") }
    }

    /// It in words; of what is not predicted, nothing.
    pub fn text(&self) -> String {
        let said = [("spectrum (dB)", self.psnr_rf_scalar), ("image", self.psnr_opt)];
        let said = said.into_iter().filter_map(|(of, psnr)| Some(format!("PSNR {of} {:.2} dB", psnr?)));
        said.collect::<Vec<_>>().join(", ")
    }
}

/// Most bytes of a record: one with ten thousand held-out keyframes has fewer.
const MOST_BYTES: u64 = 1 << 25;
/// Most numbers and texts in it.
const MOST_VALUES: usize = 1 << 19;
/// Most bytes that an archive unpacks to, and most of them for each of its own beyond [`MOST_BYTES`]: records shrink to a seventh or
/// so, and a file that unpacks to a thousand times its size was made to.
const MOST_UNPACKED_BYTES: (u64, u64) = (1 << 30, 64);

/// Largest difference between a mean and what its frames give, as a share of it: what sums in another order may differ by.
const ROUNDING: f64 = 1e-9;
const HELP: &str = "the record is damaged: make it again";

fn is_same(a: f64, b: f64) -> bool {
    (a - b).abs() <= ROUNDING * a.abs().max(b.abs()).max(1.0)
}

impl Record {
    /// Reads a record.
    ///
    /// # Errors
    /// A missing file, one that is not a record, or whatever in it cannot be, by its key.
    pub fn read(path: &Path) -> Result<Self> {
        let text = read_text_within(path, MOST_BYTES)?;
        Self::parse(&text).with_context(|| format!("{} is not the record expected here", path.display()))
    }

    /// Reads a record's JSON.
    fn parse(text: &str) -> Result<Self> {
        numbers::check_text(text, true, MOST_VALUES)?;
        let record: Self = serde_json::from_str(text)
            .map_err(|fault| anyhow!("{fault}\n  help: it is damaged, or no record of this version: make it again"))?;
        record.check_whole()?;
        Ok(record)
    }

    /// Checks that it is a record of this version, that nothing is missing that it cannot be without, and that its means are those of
    /// its frames.
    ///
    /// # Errors
    /// What is not so, by its key.
    pub fn check_whole(&self) -> Result<()> {
        ensure!(
            self.schema == SCHEMA,
            "schema is {:?}, and this version reads {SCHEMA:?}\n  help: read it with the version that wrote it, or make the record again",
            self.schema
        );
        ensure!(
            PROTOCOLS.contains(&self.protocol.as_str()),
            "protocol is {:?}, and this version knows {}\n  help: metrics of another protocol mean something else: evaluate again",
            self.protocol,
            PROTOCOLS.join(" and ")
        );
        ensure!(!self.row.trim().is_empty(), "row is empty, and a table's rows have names\n  help: {HELP}");
        let Outcome::Done(numbers) = &self.outcome else { return Ok(()) };
        ensure!(numbers.seconds.is_some() || self.method == PREDICTIONS, "seconds is missing\n  help: {HELP}");
        numbers.check_frames()?;
        numbers.check_means()?;
        numbers.check_curve()
    }

    /// Writes it whole, or not at all.
    ///
    /// # Errors
    /// A number that is none, by its key; a folder that cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        write_numbers(path, self)
    }
}

/// File of a run's record, in its folder.
pub const METRICS: &str = "metrics.json";

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

/// Reads what [`write_archive`] wrote, every member of the file, one line in memory at a time.
///
/// # Errors
/// A missing file, one that holds something else or nothing, or whatever in a record cannot be; the line is named.
pub fn read_archive(path: &Path) -> Result<Vec<Record>> {
    let packed_bytes = std::fs::metadata(path).map_or(0, |file| file.len());
    let (most, ratio) = MOST_UNPACKED_BYTES;
    let file_bytes = most.min(packed_bytes.saturating_mul(ratio).saturating_add(MOST_BYTES));
    let mut records = Vec::new();
    for (number, line) in GzipLines::open(path, LineBounds { line_bytes: MOST_BYTES, file_bytes })?.enumerate() {
        let place = || format!("{}, line {}, is not the record expected here", path.display(), number + 1);
        records.push(Record::parse(&line?).with_context(place)?);
    }
    ensure!(!records.is_empty(), "{} holds no records\n  help: pack the comparison again (`corf bench pack`)", path.display());
    Ok(records)
}

/// Median and 90th percentile of the peak AoA error of frames with spectra, degrees.
fn peak_errors(frames: &[FrameMetrics]) -> Option<[f64; 2]> {
    let mut errors: Vec<f64> = frames.iter().filter_map(|f| Some(f.spectrum?.radio?.peak_error_deg)).collect();
    errors.sort_by(f64::total_cmp);
    (!errors.is_empty()).then(|| [quantile(&errors, 0.5), quantile(&errors, 0.9)])
}

impl Numbers {
    /// Checks that all of them are numbers.
    ///
    /// # Errors
    /// The first that is not, by its key.
    pub fn check(&self) -> Result<()> {
        numbers::check(&serde_json::to_value(self)?)
    }

    /// Checks that there are frames, each of another keyframe, and that all tell the same.
    fn check_frames(&self) -> Result<()> {
        let Some(first) = self.frames.first() else { bail!("frames is empty\n  help: {HELP}") };
        let mut seen = BTreeSet::new();
        // An image that a mask covers has no metrics.
        let kinds = |frame: &FrameMetrics| [frame.light.is_some() || frame.masked_out, frame.spectrum.is_some()];
        for frame in &self.frames {
            let index = frame.index;
            ensure!(seen.insert(index), "the frame of keyframe {index} is there twice\n  help: {HELP}");
            ensure!(kinds(frame).contains(&true), "the frame of keyframe {index} has no metrics\n  help: {HELP}");
            ensure!(
                kinds(frame) == kinds(first),
                "the frames of keyframes {} and {index} have metrics of different kinds\n  help: {HELP}",
                first.index
            );
        }
        Ok(())
    }

    /// Checks that the curve goes forward in time, and that its shares are shares.
    fn check_curve(&self) -> Result<()> {
        let mut before_s = 0.0;
        for (i, point) in self.curve.iter().enumerate() {
            let CurvePoint { seconds, progress, .. } = *point;
            ensure!(
                (0.0..=1.0).contains(&progress),
                "curve[{i}].progress is {progress}, where it can be from 0 to 1\n  help: {HELP}"
            );
            ensure!(seconds >= before_s, "curve[{i}].seconds is {seconds}, after {before_s}\n  help: {HELP}");
            before_s = seconds;
        }
        Ok(())
    }

    /// Checks that metrics are what they can be, and that the means are those of the frames; a record that is older than a column has none of it.
    fn check_means(&self) -> Result<()> {
        for column in COLUMNS {
            let key = column.key;
            for frame in &self.frames {
                let value = (column.of)(frame).filter(|value| !column.can_be(*value));
                if let Some(value) = value {
                    let [least, most] = column.range;
                    bail!("{key} of keyframe {} is {value}, where it can be from {least} to {most}\n  help: {HELP}", frame.index);
                }
            }
            let Some(&mean) = self.means.get(key) else { continue };
            if let Some(frame) = self.frames.iter().find(|f| !column.leaves_out(f) && (column.of)(f).is_none()) {
                bail!("the frame of keyframe {} lacks what {key} needs\n  help: {HELP}", frame.index);
            }
            let Some(found) = column.over(&self.frames) else { bail!("means.{key} is of no frame\n  help: {HELP}") };
            ensure!(is_same(mean, found), "means.{key} is {mean}, and the frames give {found}\n  help: {HELP}");
        }
        if let Some(stated) = self.peak_error_median_p90_deg {
            let found = peak_errors(&self.frames);
            ensure!(
                found.is_some_and(|found| stated.iter().zip(found).all(|(a, b)| is_same(*a, b))),
                "peak_error_median_p90_deg is {stated:?}, and the frames give {}\n  help: {HELP}",
                found.map_or("none".to_owned(), |found| format!("{found:?}"))
            );
        }
        Ok(())
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
        let peak_error_median_p90_deg = peak_errors(&frames);
        Self {
            seconds,
            gaussians,
            peak_memory_bytes,
            peak_device_memory_bytes: None,
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

    /// The number of the column of a key.
    pub fn value_of(&self, key: &str) -> Option<f64> {
        COLUMNS.iter().find(|column| column.key == key).and_then(|column| self.value(column))
    }

    /// Adds the time of processes before this one, which the cell was gone on with from a checkpoint. Points of the curve are those since.
    pub fn add_earlier(&mut self, earlier_s: f64) {
        self.seconds = self.seconds.map(|seconds| seconds + earlier_s);
        self.curve.iter_mut().for_each(|point| point.seconds += earlier_s);
    }

    /// Adds the peak of the GPU's memory, bytes.
    pub fn with_device_memory(self, peak_device_memory_bytes: Option<u64>) -> Self {
        Self { peak_device_memory_bytes, ..self }
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

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::metrics::LightMetrics;
    use serde_json::{Value, json};

    /// A finished cell of `corf-gs` with its own settings, of two held-out keyframes.
    pub(crate) fn done(row: &str, seed: u64) -> Record {
        let light = |psnr_opt| Some(LightMetrics { psnr_opt, ssim_opt: 0.5 });
        let frame =
            |index, psnr| FrameMetrics { index, masked_out: false, light: light(psnr), spectrum: None, lpips: BTreeMap::new() };
        let frames = vec![frame(0, 20.0 + seed as f64), frame(8, 21.0)];
        let curve = vec![CurvePoint { seconds: 0.5, progress: 1.0, gaussians: Some(10), held_out: None }];
        Record {
            schema: SCHEMA.to_owned(),
            protocol: PROTOCOL.to_owned(),
            split: Protocol::TEST,
            row: row.to_owned(),
            method: "corf-gs".to_owned(),
            config: json!({"fine_tune_epochs": 0}),
            dataset: "d".to_owned(),
            dataset_hash: "f00d".repeat(16),
            dataset_verified: true,
            seed,
            cell: None,
            provenance: Provenance::here(),
            lpips_weights: BTreeMap::from([("vgg".to_owned(), "0".repeat(64))]),
            lpips_device: None,
            device: "cpu (2 threads)".to_owned(),
            uses_ground_truth_depth: false,
            depth_imported: false,
            uses_scene: false,
            clock: CLOCK.to_owned(),
            outcome: Outcome::Done(Box::new(Numbers::of(frames, Some(1.0), Some(10), None, curve, None))),
        }
    }

    /// Reads the record as JSON, changed.
    fn read(change: impl Fn(&mut Value)) -> Result<Record> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("metrics.json");
        let mut value = serde_json::to_value(done("a", 1)).unwrap();
        change(&mut value);
        std::fs::write(&path, value.to_string()).unwrap();
        Record::read(&path)
    }

    #[test]
    fn what_a_record_cannot_say_is_named() {
        let whole = read(|_| ()).unwrap();
        assert!(matches!(whole.outcome, Outcome::Done(numbers) if numbers.means["psnr_opt"] == 21.0));
        let of_old = read(|r| drop(r["means"].as_object_mut().unwrap().remove("psnr_opt"))).unwrap();
        let Outcome::Done(numbers) = &of_old.outcome else { panic!() };
        assert_eq!(numbers.value(&COLUMNS[0]), Some(21.0), "what an older record has no mean of is of its frames");
        assert_eq!(numbers.value_of("psnr_opt"), Some(21.0));
        let set = |pointer: &'static str, to: Value| move |r: &mut Value| *r.pointer_mut(pointer).unwrap() = to.clone();
        for (change, said) in [
            (set("/schema", json!("corf-x/999")), "schema is \"corf-x/999\", and this version reads \"corf-metrics/1\""),
            (set("/protocol", json!("corf-heldout/3")), "protocol is \"corf-heldout/3\""),
            (set("/seconds", json!(-1.5)), "seconds is -1.5, and no time is negative"),
            (set("/seconds", json!(-1)), "seconds is -1, and no time is negative"),
            (set("/curve/0/seconds", json!(-1e-3)), "curve[0].seconds is -0.001"),
            (set("/means/psnr_opt", json!(21.001)), "means.psnr_opt is 21.001, and the frames give 21"),
            (set("/means/psnr_opt", Value::Null), "means.psnr_opt is null"),
            (set("/row", json!(" ")), "row is empty"),
            (set("/row", Value::Null), "row is null"),
            (set("/frames/1/ssim_opt", json!(1.001)), "ssim_opt of keyframe 8 is 1.001, where it can be from -1 to 1"),
            (set("/frames/1/psnr_opt", json!(-3)), "psnr_opt of keyframe 8 is -3, where it can be from 0 to inf"),
            (set("/curve/0/progress", json!(7)), "curve[0].progress is 7, where it can be from 0 to 1"),
            (
                set("/curve", json!([{"seconds": 0.5, "progress": 0.5}, {"seconds": 0.25, "progress": 1.0}])),
                "curve[1].seconds is 0.25, after 0.5",
            ),
            (set("/means/ssim_opt", json!("0.5")), "invalid type: string"),
            (set("/frames/1/psnr_opt", json!(25.0)), "means.psnr_opt is 21, and the frames give 23"),
            (set("/frames/1/index", json!(0)), "keyframe 0 is there twice"),
            (set("/frames/1", json!({"index": 8})), "keyframe 8 has no metrics"),
            (set("/frames/1", json!({"index": 8, "ssim_opt": 0.5})), "keyframe 8 has no metrics"),
            (set("/frames", json!([])), "frames is empty"),
            (set("/peak_memory_bytes", json!(-1)), "invalid value"),
        ] {
            let error = format!("{:#}", read(change).unwrap_err());
            assert!(error.contains(said) && error.contains("metrics.json"), "{said}: {error}");
        }
    }

    #[test]
    fn an_archive_is_all_of_its_members_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let [one, two, path] = ["1", "2", ARCHIVE].map(|name| folder.path().join(name));
        write_archive(&one, &[done("a", 1), done("b", 1)]).unwrap();
        write_archive(&two, &[done("a", 2)]).unwrap();
        let [one, two] = [one, two].map(|path| std::fs::read(path).unwrap());
        let read = |bytes: &[&[u8]]| {
            std::fs::write(&path, bytes.concat()).unwrap();
            read_archive(&path).map(|records| records.iter().map(|r| (r.row.clone(), r.seed)).collect::<Vec<_>>())
        };
        let cells = [("a", 1), ("b", 1), ("a", 2)].map(|(row, seed)| (row.to_owned(), seed));
        assert_eq!(read(&[&one, &two]).unwrap(), cells);
        let gzip = |text: &str| corf_scene::io::gzip(text.as_bytes()).unwrap();
        for (bytes, said) in [
            (vec![&one[..], b"more"], "line 3"),
            (vec![&one[..], &two[..two.len() - 3]], "gzip text"),
            (vec![&gzip("")[..]], "holds no records"),
            (vec![&b""[..]], ARCHIVE),
            (vec![&one[..], &gzip("\n")], "line 3, is not the record"),
            (vec![&one[..], &gzip("{}\n")], "line 3, is not the record"),
        ] {
            let error = format!("{:#}", read(&bytes).unwrap_err());
            assert!(error.contains(said) && error.contains(ARCHIVE), "{said}: {error}");
        }
        // What unpacks to a thousand times its size, in one line and in many.
        for (text, said) in [
            ("[".repeat(1 << 26), "line 1"),
            ("\n".repeat(1 << 26), "line 1, is not"),
            ("[".to_owned() + &"0,".repeat(1 << 21), "more than 524288"),
        ] {
            let error = format!("{:#}", read(&[&gzip(&text)]).unwrap_err());
            assert!(error.contains(said), "{said}: {error}");
        }
    }
}
