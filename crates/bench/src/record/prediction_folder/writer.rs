//! Writes a run's predictions as a folder that any evaluator, this one included, can score.

use super::{PredictionStatement, STATEMENT, statement::SCHEMA};
use crate::files::json::write_numbers;
use crate::files::output::FreshFolder;
use crate::methods::interface::Method;
use crate::metrics::Prediction;
use crate::run::{RunInfo, claim_fresh};
use anyhow::{Context, Result, ensure};
use corf::FieldMeta;
use corf_scene::color::quantize8;
use corf_scene::dataset::{Dataset, stem};
use corf_scene::io;
use corf_scene::keyframe::DbRange;
use std::path::Path;

/// A new folder that is being filled: `images/` and `jet/` as 8-bit PNG, which is what their metrics look at, `linear/` as EXR.
pub struct PredictionWriter {
    folder: FreshFolder,
    /// Of the data set's spectra; none where it has none, and none are written.
    range: Option<DbRange>,
}

impl PredictionWriter {
    /// Claims an empty or new folder for predictions of a data set's keyframes.
    ///
    /// # Errors
    /// A folder that holds something already, or cannot be written.
    pub fn create(dir: &Path, dataset: &Dataset) -> Result<Self> {
        let writer = Self { folder: claim_fresh(dir)?, range: dataset.db_range() };
        if writer.range.is_some() {
            writer.make("jet")?;
            writer.make("linear")?;
        }
        Ok(writer)
    }

    /// Makes one of the folders, where it is not there.
    fn make(&self, name: &str) -> Result<()> {
        let folder = self.folder.path().join(name);
        std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))
    }

    /// Writes the prediction of a keyframe.
    ///
    /// # Errors
    /// A pixel that is no number, or a file that cannot be written.
    pub fn write(&self, index: usize, prediction: &Prediction) -> Result<()> {
        ensure!(
            prediction.is_finite(),
            "keyframe {index}: a pixel of the prediction is not a finite number\n  help: the field has diverged; reconstruct it with smaller rates"
        );
        let file = |folder: &str, ending: &str| self.folder.path().join(folder).join(format!("{}.{ending}", stem(index)));
        if let Some(image) = &prediction.image {
            self.make("images")?;
            io::write_png(file("images", "png"), &image.map(|c| c.map(quantize8)))?;
        }
        if let (Some(radio), Some(range)) = (&prediction.radio, &self.range) {
            io::write_png(file("jet", "png"), &radio.jet.map(|c| c.map(quantize8)))?;
            let linear = radio.scalar.map(|&s| crate::metrics::radio::linear(s, range) as f32);
            io::write_atomic(file("linear", "exr"), &io::encode_exr_f32(&linear, "Y")?)?;
        }
        Ok(())
    }

    /// Writes the statement, with which the folder is whole and may be shown.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn finish(self, statement: &PredictionStatement) -> Result<FreshFolder> {
        write_numbers(&self.folder.path().join(STATEMENT), statement)?;
        Ok(self.folder)
    }
}

/// What is to be stated of predictions of a data set by a method's run.
pub fn stated_of(info: &RunInfo, method: &dyn Method, dataset: &Dataset) -> PredictionStatement {
    PredictionStatement {
        schema: Some(SCHEMA.to_owned()),
        method: Some(info.method.clone()),
        gaussians: info.gaussians,
        seconds: Some(info.seconds),
        seed: Some(info.seed),
        device: Some(info.device.clone()),
        uses_ground_truth_depth: Some(method.uses_ground_truth_depth()),
        uses_scene: method.uses_scene().then_some(true),
        dataset_hash: Some(dataset.hash().to_owned()),
        protocol: Some(info.protocol),
        names: None,
        db_range: Some(dataset.db_range().unwrap_or(FieldMeta::RANGE_WITHOUT_RADIO)),
    }
}
