//! `predictions.json`: what the maker of a folder of predictions says of them.

use crate::split::Protocol;
use anyhow::{Result, ensure};
use corf_scene::dataset::Dataset;
use corf_scene::keyframe::DbRange;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Version of the layout of the folder.
pub const SCHEMA: &str = "corf-predictions/1";

/// `predictions.json`; every key may be left out.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PredictionStatement {
    /// [`SCHEMA`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub schema: Option<String>,
    /// Name of the method.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub method: Option<String>,
    /// Gaussians in its field.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub gaussians: Option<usize>,
    /// Seconds that the reconstruction took.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seconds: Option<f64>,
    /// Seed.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub seed: Option<u64>,
    /// Device that it ran on.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub device: Option<String>,
    /// Whether the data set's depth was read, the ray tracer's or a capture's (the points of `sparse/0/points3D.txt` are made from it).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uses_ground_truth_depth: Option<bool>,
    /// Whether the true scene was known, as an oracle's is.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub uses_scene: Option<bool>,
    /// SHA-256 of the data set's `dataset.json`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub dataset_hash: Option<String>,
    /// Protocol by which keyframes were held out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub protocol: Option<Protocol>,
    /// What the number in a file's name counts.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub names: Option<Names>,
    /// Decibel range of the images in `jet/` and `scalar/`; it has to be the data set's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub db_range: Option<DbRange>,
}

/// What the number in a file's name counts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Names {
    /// The data set's file stems, from 00001.
    #[default]
    Stem,
    /// Keyframe indices along the trajectory, from 0.
    Index,
}

/// Two decibel ranges are one if their ends differ by no more than what a decimal fraction loses in writing, dB.
const SAME_DB: f64 = 1e-6;

impl PredictionStatement {
    /// Checks what is stated against the data set and the protocol; `place` is the file.
    ///
    /// # Errors
    /// What does not fit, by its key.
    pub fn check(&self, dataset: &Dataset, protocol: Protocol, place: &Path) -> Result<()> {
        let place = place.display();
        if let Some(schema) = &self.schema {
            ensure!(schema == SCHEMA, "{place}: schema is \"{schema}\"\n  help: this version reads \"{SCHEMA}\"");
        }
        if let Some(seconds) = self.seconds {
            ensure!(
                seconds.is_finite() && seconds >= 0.0,
                "{place}: seconds is {seconds}\n  help: give the time of the reconstruction in seconds, or leave it out"
            );
        }
        if let Some(hash) = &self.dataset_hash {
            ensure!(
                hash == dataset.hash(),
                "{place}: dataset_hash is {hash}, and {} is {}\n  help: give the data set that was trained on with --dataset",
                dataset.dir().display(),
                dataset.hash()
            );
        }
        if let Some(stated) = self.protocol {
            ensure!(
                stated == protocol,
                "{place}: the predictions are of the protocol \"{}\", asked for is \"{}\"\n  help: keyframes of another protocol were trained on; \
                 ask for \"{0}\", or train again",
                stated.name(),
                protocol.name()
            );
        }
        // Without spectra there is nothing that a range could be wrong for.
        if let Some((range, own)) = self.db_range.zip(dataset.db_range()) {
            ensure!(
                (range.min_db - own.min_db).abs() <= SAME_DB && (range.max_db - own.max_db).abs() <= SAME_DB,
                "{place}: db_range is {} to {} dB, the data set's {} to {} dB\n  help: map decibels onto the data set's range (db_range in \
                 dataset.json), or give linear power in linear/",
                range.min_db,
                range.max_db,
                own.min_db,
                own.max_db
            );
        }
        Ok(())
    }
}
