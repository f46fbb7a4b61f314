//! The run folder: what `corf reconstruct` leaves and `corf render` and `corf evaluate` read.
//!
//! ```text
//! RUN/checkpoint    the state after a keyframe, while the run lasts
//! RUN/run.json      method, configuration, seed, dataset, time, curve (written last: a run without it is not finished)
//! RUN/*.ply         the field (CORF-GS, RF-3DGS), and the points that RF-3DGS began with
//! RUN/quality.svg   held-out quality over time, where it was asked for by `--evaluate-every`
//! RUN/metrics.json  written by `corf evaluate`, with beam.svg, rate.svg and outage.svg where spectra have beams
//! RUN/latency.svg   what each keyframe of such a run waited for
//! RUN/live.jsonl    what became of every keyframe, RUN/dataset the keyframes themselves (`corf reconstruct --follow`)
//! RUN/unfinished.json  what such a run was begun with, until it is finished: the same command goes on with it
//! ```

pub mod evaluation;
pub mod harness;
pub mod open;
pub mod picture;
pub mod quality;

use crate::files::ending::check_folder;
use crate::files::json::write_numbers;
use crate::files::output::{FreshFolder, clear_leftovers, has_unfinished, is_leftover, was_finishing};
use crate::live::LiveRecord;
use crate::methods::abilities;
use crate::methods::corf_gs::GeometryConfig;
use crate::methods::interface::{Method, StageTime};
use crate::record::CurvePoint;
use crate::record::provenance::Provenance;
use crate::run::harness::Reconstruction;
use crate::split::Protocol;
use anyhow::{Context, Result, bail};
use corf::depth::DepthQuality;
use corf::device::TrainingTimes;
use corf::{KeyframeTiming, LatencySummary};
use corf_scene::dataset::Dataset;
use corf_scene::io::{self, remove_temporary_files, sha256_hex, write_atomic};
use corf_scene::lock::FolderLock;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Folder of the runs that a comparison keeps, in its own.
pub const MODELS: &str = "models";

/// A run that a comparison keeps, and the viewer's page of it beside the report.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct KeptModel {
    /// Its run folder, which is named after its row.
    pub folder: PathBuf,
    /// The page, whether it is there or not: `viewer.html`, or of several models `viewer-ROW.html`.
    pub page: PathBuf,
}

impl KeptModel {
    /// The finished runs that the folder of a comparison keeps, by name.
    pub fn all(comparison: &Path) -> Vec<Self> {
        let models = std::fs::read_dir(comparison.join(MODELS));
        let mut folders: Vec<PathBuf> = models.into_iter().flatten().flatten().map(|entry| entry.path()).collect();
        folders.retain(|run| run.join("run.json").exists());
        folders.sort();
        let alone = folders.len() == 1;
        let page = |folder: &Path| match folder.file_name() {
            Some(name) if !alone => format!("viewer-{}.html", name.to_string_lossy()),
            _ => "viewer.html".to_owned(),
        };
        folders.into_iter().map(|folder| Self { page: comparison.join(page(&folder)), folder }).collect()
    }

    /// Whether the page is there and not older than the run.
    pub fn has_page(&self) -> bool {
        let changed = |path: &Path| std::fs::metadata(path).and_then(|m| m.modified()).ok();
        changed(&self.page).is_some_and(|page| changed(&self.folder.join("run.json")).is_some_and(|run| run <= page))
    }
}

/// File of the resolved configuration in a run folder.
pub const CONFIG: &str = "config.json";
/// Version of `run.json`.
pub const SCHEMA: &str = "corf-run/1";

/// `run.json`.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct RunInfo {
    /// [`SCHEMA`].
    pub schema: String,
    /// Method id.
    pub method: String,
    /// The overrides the method was made with, so that it can be made again.
    pub overrides: toml::Table,
    /// Resolved configuration.
    pub config: serde_json::Value,
    /// SHA-256 of the Gaussians that the run began with, where another program had trained some.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub initial_gaussians_sha256: Option<String>,
    /// Evaluation protocol of the training: the run may be evaluated on the split it held out.
    #[serde(default)]
    pub protocol: Protocol,
    /// Seed.
    pub seed: u64,
    /// Folder of the dataset, as it was given.
    pub dataset: PathBuf,
    /// Hash of the dataset.
    pub dataset_hash: String,
    /// What the dataset took off positions, metres ([`corf_scene::dataset::DatasetHeader::offset_m`]).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub dataset_offset_m: Option<[f64; 3]>,
    /// Whether every file of the dataset was checked against its recorded SHA-256 before it was read.
    #[serde(default)]
    pub dataset_verified: bool,
    /// Device the method ran on.
    pub device: String,
    /// Source and machine.
    pub provenance: Provenance,
    /// Reconstruction time, seconds, on the record's clock.
    pub seconds: f64,
    /// Gaussians in the field.
    pub gaussians: Option<usize>,
    /// Peak resident memory of the process, bytes.
    pub peak_memory_bytes: Option<u64>,
    /// Peak of what buffers took on the GPU, bytes; none where no GPU was at work.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub peak_device_memory_bytes: Option<u64>,
    /// Processor time of the process during the reconstruction, seconds: of all threads, reading files included.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub processor_s: Option<f64>,
    /// Growth over time.
    pub curve: Vec<CurvePoint>,
    /// Keyframes that came from a checkpoint of an interrupted run: time, memory, curve and latency are of what followed them.
    #[serde(default)]
    pub resumed_keyframes: usize,
    /// Latency of keyframes, for methods that work keyframe by keyframe.
    #[serde(default)]
    pub latency: Option<LatencySummary>,
    /// Errors of the depths of new Gaussians, for methods that estimate depth, where the dataset has the true depth.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub depth: Option<DepthQuality>,
    /// What the stages took, for methods that have some; unlike `seconds` over all sessions of a run that was resumed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stages: Vec<StageTime>,
    /// Where the time of training went, where that was asked for (`--time-kernels`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub training_times: Option<TrainingTimes>,
    /// Steps that came from a checkpoint of an interrupted run, for methods that work in steps: time, memory and curve are of what followed.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub resumed_steps: usize,
    /// What came of the keyframes of a live folder, where they came from one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub live: Option<LiveRecord>,
    /// Timing of each keyframe.
    #[serde(default)]
    pub keyframe_timings: Vec<KeyframeTiming>,
}

/// SHA-256 of the file of first Gaussians that a configuration names, if it names one.
///
/// # Errors
/// A file that cannot be read.
pub fn initial_hash(overrides: &toml::Table) -> Result<Option<String>> {
    let file = overrides.get("initial_gaussians").and_then(toml::Value::as_str);
    file.map(|file| Ok(sha256_hex(&io::read(file)?))).transpose()
}

impl RunInfo {
    /// What there is to say of a finished reconstruction by a method that was made with `overrides`, on a data set whose files were `verified` or
    /// not, from `trained` keyframes.
    ///
    /// # Errors
    /// When there is no working directory to make the data set's path absolute with.
    pub fn of(
        method: &dyn Method,
        overrides: &toml::Table,
        seed: u64,
        (dataset, verified): (&Dataset, bool),
        (protocol, trained): (Protocol, usize),
        result: &Reconstruction,
    ) -> Result<Self> {
        // These say what every keyframe of their session took; where radio alone is learnt, none is taken by itself.
        let config = method.config();
        let online = abilities(method.id()).online && GeometryConfig::of_config(&config).is_none();
        Ok(Self {
            schema: SCHEMA.to_owned(),
            method: method.id().to_owned(),
            overrides: overrides.clone(),
            config,
            initial_gaussians_sha256: initial_hash(overrides)?,
            protocol,
            seed,
            dataset: std::path::absolute(dataset.dir())?,
            dataset_hash: dataset.hash().to_owned(),
            dataset_offset_m: dataset.header().offset_m(),
            dataset_verified: verified,
            device: method.device(),
            provenance: Provenance::here(),
            seconds: result.seconds,
            gaussians: result.predictor.gaussians(),
            peak_memory_bytes: result.peak_memory_bytes,
            peak_device_memory_bytes: result.peak_device_memory_bytes,
            processor_s: result.processor_s,
            curve: result.curve.clone(),
            resumed_keyframes: if online { trained - result.keyframes.len() } else { 0 },
            latency: LatencySummary::of(&result.keyframes),
            depth: result.depth,
            stages: result.stages.clone(),
            training_times: result.training_times.clone(),
            resumed_steps: result.resumed_steps,
            live: None,
            keyframe_timings: result.keyframes.clone(),
        })
    }
}

/// Writes the configuration into a run folder, which is then a run's, finished or not.
///
/// # Errors
/// When it cannot be written.
pub fn write_config(folder: &Path, config: &serde_json::Value) -> Result<()> {
    Ok(write_atomic(folder.join(CONFIG), format!("{config:#}\n").as_bytes())?)
}

/// Writes a finished reconstruction into a run folder, `run.json` last.
///
/// # Errors
/// When a file cannot be written; a number that is none.
pub fn write_finished(folder: &Path, info: &RunInfo, result: &Reconstruction) -> Result<()> {
    result.predictor.save(folder)?;
    write_info(folder, info)
}

/// Writes `run.json`, with which a run folder is a finished run's.
///
/// # Errors
/// When it cannot be written; a number that is none.
pub fn write_info(folder: &Path, info: &RunInfo) -> Result<()> {
    write_numbers(&folder.join("run.json"), info)
}

fn is_zero(count: &usize) -> bool {
    *count == 0
}

/// Makes a folder for output, or refuses one that holds something already. It is this run's alone while the answer lives, and what a run
/// that was killed had begun to write there is gone.
///
/// # Errors
/// `folder` exists with content and neither `resume` nor anything else allows it; another run writes into it; or it cannot be made or
/// written.
pub fn claim_output(folder: &Path, resume: bool) -> Result<FolderLock> {
    let content = if resume { Content::Resumed } else { Content::Refused };
    claim(folder, content, "choose another --out, or pass --resume to go on with what is there")
}

/// Claims an empty or new folder for output that cannot be resumed, and is seen once it is whole; see [`claim_output`].
///
/// # Errors
/// Those of [`claim_output`].
pub fn claim_fresh(folder: &Path) -> Result<FreshFolder> {
    FreshFolder::begin(folder, claim(folder, Content::Refused, "choose another --out")?)
}

/// Claims a folder for output that the same command goes on with where `unfinished`, a file in it, says that it was begun; see [`claim_output`].
///
/// # Errors
/// Those of [`claim_output`].
pub fn claim_begun(folder: &Path, unfinished: &str) -> Result<FolderLock> {
    let content = if folder.join(unfinished).is_file() { Content::Resumed } else { Content::Refused };
    claim(folder, content, "choose another --out")
}

/// Claims a folder for output that is written beside or over the files in it; see [`claim_output`].
///
/// # Errors
/// Those of [`claim_output`], but for the content.
pub fn claim_shared(folder: &Path) -> Result<FolderLock> {
    claim(folder, Content::Kept, "")
}

/// Treatment of the present content of an output folder.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Content {
    /// Nothing may be there.
    Refused,
    /// It is gone on with; what had no name yet goes.
    Resumed,
    /// It stays.
    Kept,
}

fn claim(folder: &Path, content: Content, help: &str) -> Result<FolderLock> {
    if folder.is_file() {
        bail!("{} is a file\n  help: name a folder with --out", folder.display());
    }
    check_folder(folder)?;
    let refuse_content = || -> Result<()> {
        let counts = |entry: std::io::Result<std::fs::DirEntry>| entry.is_ok_and(|e| !is_leftover(&e.file_name()));
        let occupied = std::fs::read_dir(folder).is_ok_and(|mut entries| entries.any(counts));
        if occupied && content == Content::Refused {
            bail!("output folder {} exists and is not empty\n  help: {help}", folder.display());
        }
        Ok(())
    };
    // Before anything of it is touched; and again once nobody else can fill it.
    if !was_finishing(folder) {
        refuse_content()?;
    }
    let held = FolderLock::make(folder).with_context(|| {
        format!("cannot create output folder {}\n  help: choose a writable place with --out", folder.display())
    })?;
    // A folder that cannot be written is found now, not after the work.
    tempfile::tempfile_in(folder)
        .with_context(|| format!("cannot write into {}\n  help: choose a writable place with --out", folder.display()))?;
    // Where nobody can be kept out, nobody can be known to be dead.
    if !held.keeps_others_out() && has_unfinished(folder) {
        bail!(
            "output folder {} holds unfinished work, and its file system has no locks that would say whose\n  help: remove it if no process works \
             there, or choose another --out",
            folder.display()
        );
    }
    clear_leftovers(folder)?;
    refuse_content()?;
    if content == Content::Resumed {
        remove_temporary_files(folder)?;
    }
    Ok(held)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kept_models_are_the_finished_ones_and_each_has_a_page_of_its_own() {
        let dir = tempfile::tempdir().unwrap();
        assert!(KeptModel::all(dir.path()).is_empty());
        let make = |name: &str, file: &str| {
            let folder = dir.path().join(MODELS).join(name);
            std::fs::create_dir_all(&folder).unwrap();
            std::fs::write(folder.join(file), "{}").unwrap();
        };
        let pages = || -> Vec<String> {
            let models = KeptModel::all(dir.path());
            models.iter().map(|m| m.page.file_name().unwrap().to_string_lossy().into_owned()).collect()
        };
        make("corf-gs", "run.json");
        make("rf-3dgs", "config.json");
        assert_eq!(pages(), ["viewer.html"]);
        let [model] = KeptModel::all(dir.path()).try_into().unwrap();
        assert!(!model.has_page());
        std::fs::write(&model.page, "").unwrap();
        assert!(model.has_page());
        std::fs::File::open(&model.page).unwrap().set_modified(std::time::UNIX_EPOCH).unwrap();
        assert!(!model.has_page(), "a page of an earlier run is none of this one");
        make("rf-3dgs", "run.json");
        assert_eq!(pages(), ["viewer-corf-gs.html", "viewer-rf-3dgs.html"]);
    }

    #[test]
    fn an_occupied_folder_is_refused_and_kept() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("precious"), "x").unwrap();
        let error = claim_output(dir.path(), false).unwrap_err().to_string();
        assert!(error.contains("--resume"), "{error}");
        drop(claim_output(dir.path(), true).unwrap());
        let error = claim_fresh(dir.path()).unwrap_err().to_string();
        assert!(error.contains("--out") && !error.contains("--resume"), "{error}");
        assert!(dir.path().join("precious").exists());
    }
}
