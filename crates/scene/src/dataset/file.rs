//! `dataset.json` as it is written.

use super::conventions::Conventions;
use super::header::{DatasetHeader, MeanAndRange, SplitLists};
use crate::io;
use crate::keyframe::DbRange;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

/// `dataset.json`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DatasetFile {
    pub schema: String,
    pub generator: String,
    pub keyframes: usize,
    pub conventions: Conventions,
    /// The one dB range; null without radio.
    pub db_range: Option<DbRange>,
    /// Largest spectrum value of all keyframes, dB; null without radio.
    pub peak_db: Option<f64>,
    #[serde(rename = "rf_frames")]
    pub radio_frames: RadioFrames,
    pub split: SplitLists,
    pub header: DatasetHeader,
    /// Relative path (forward slashes) → size and SHA-256, of every file but this one.
    pub files: BTreeMap<String, FileRecord>,
}

/// Statistics of the spectra, one entry per keyframe.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RadioFrames {
    /// Largest spectrum value, dB; null without any power.
    pub peak_db: Vec<Option<f64>>,
    /// Share of the arriving power inside the RF frame.
    pub share_in_frame: Vec<Option<f64>>,
    /// Mean, smallest and largest of those.
    pub share_in_frame_summary: Option<MeanAndRange>,
}

/// One file of the dataset.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FileRecord {
    pub bytes: u64,
    pub sha256: String,
}

impl FileRecord {
    pub(super) fn of(bytes: &[u8]) -> Self {
        Self { bytes: bytes.len() as u64, sha256: io::sha256_hex(bytes) }
    }
}
