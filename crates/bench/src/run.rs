//! The run folder: what `corf reconstruct` leaves and `corf render` and `corf evaluate` read.
//!
//! ```text
//! RUN/checkpoint    the state after a keyframe, while the run lasts
//! RUN/run.json      method, configuration, seed, dataset, time, curve (written last: a run without it is not finished)
//! RUN/*.ply         the field (CORF-GS)
//! RUN/metrics.json  written by `corf evaluate`
//! ```

use crate::provenance::Provenance;
use crate::record::CurvePoint;
use anyhow::{Context, Result, bail};
use corf::{KeyframeTiming, LatencySummary};
use corf_scene::io::write_atomic;
use serde::{Deserialize, Serialize, de::DeserializeOwned};
use std::path::{Path, PathBuf};

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
    /// Seed.
    pub seed: u64,
    /// Folder of the dataset, as it was given.
    pub dataset: PathBuf,
    /// Hash of the dataset.
    pub dataset_hash: String,
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
    /// Growth over time.
    pub curve: Vec<CurvePoint>,
    /// Keyframes that came from a checkpoint of an interrupted run: time, memory, curve and latency are of what followed them.
    #[serde(default)]
    pub resumed_keyframes: usize,
    /// Latency of keyframes, for methods that work keyframe by keyframe.
    #[serde(default)]
    pub latency: Option<LatencySummary>,
    /// What each keyframe took.
    #[serde(default)]
    pub keyframe_timings: Vec<KeyframeTiming>,
}

/// Writes pretty JSON atomically.
///
/// # Errors
/// When the folder cannot be written; the path is named.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<()> {
    let mut text = serde_json::to_string_pretty(value)?;
    text.push('\n');
    Ok(write_atomic(path, text.as_bytes())?)
}

/// As [`write_json`], of what is read again: a number that JSON cannot hold, which would come back as none, is refused.
///
/// # Errors
/// As [`write_json`], or what the value cannot be read back for.
pub fn write_record<T: Serialize + DeserializeOwned>(path: &Path, value: &T) -> Result<()> {
    serde_json::from_str::<T>(&serde_json::to_string(value)?)
        .with_context(|| format!("{}: a result is not a finite number: the method has diverged", path.display()))?;
    write_json(path, value)
}

/// Reads JSON.
///
/// # Errors
/// A missing file, or one that is not what it should be; line and column are named.
pub fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let text = std::fs::read_to_string(path).with_context(|| format!("cannot read {}", path.display()))?;
    serde_json::from_str(&text).with_context(|| format!("{} is not the JSON expected here", path.display()))
}

/// Makes a folder for output, or refuses one that holds something already.
///
/// # Errors
/// `folder` exists with content and neither `resume` nor anything else allows it; or it cannot be made or written.
pub fn claim_output(folder: &Path, resume: bool) -> Result<()> {
    claim(folder, resume, "choose another --out, or pass --resume to go on with what is there")
}

/// As [`claim_output`], for what is done at once.
///
/// # Errors
/// As [`claim_output`].
pub fn claim_fresh(folder: &Path) -> Result<()> {
    claim(folder, false, "choose another --out")
}

fn claim(folder: &Path, resume: bool, help: &str) -> Result<()> {
    if folder.is_file() {
        bail!("{} is a file\n  help: name a folder with --out", folder.display());
    }
    let occupied = std::fs::read_dir(folder).is_ok_and(|mut entries| entries.next().is_some());
    if occupied && !resume {
        bail!("output folder {} exists and is not empty\n  help: {help}", folder.display());
    }
    std::fs::create_dir_all(folder).with_context(|| {
        format!("cannot create output folder {}\n  help: choose a writable place with --out", folder.display())
    })?;
    // A folder that cannot be written is found now, not after the work.
    tempfile::tempfile_in(folder)
        .with_context(|| format!("cannot write into {}\n  help: choose a writable place with --out", folder.display()))?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_occupied_folder_is_refused_and_kept() {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("precious"), "x").unwrap();
        let error = claim_output(dir.path(), false).unwrap_err().to_string();
        assert!(error.contains("--resume"), "{error}");
        claim_output(dir.path(), true).unwrap();
        let error = claim_fresh(dir.path()).unwrap_err().to_string();
        assert!(error.contains("--out") && !error.contains("--resume"), "{error}");
        assert!(dir.path().join("precious").exists());
    }

    #[test]
    fn writing_replaces_whole_files_only() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.json");
        write_json(&path, &[1, 2]).unwrap();
        write_json(&path, &[3]).unwrap();
        assert_eq!(read_json::<Vec<i32>>(&path).unwrap(), [3]);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }
}
