//! What is looked at: a run with its data set, a data set alone, or a reconstruction at work.

use super::growth::Growth;
use super::opening::opening;
use crate::device::{Backend, DeviceChoice};
use crate::methods::interface::Predictor;
use crate::metrics::Evaluator;
use crate::metrics::input::Verify;
use crate::run::open::{self, OpenRun};
use crate::run::{KeptModel, RunInfo};
use crate::split::Split;
use anyhow::{Result, bail, ensure};
use corf::{Field, RasterConfig};
use corf_scene::dataset::Dataset;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Part that a keyframe plays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Role {
    /// Reconstructions learn from it.
    Train,
    /// They are judged by it.
    Test,
    /// Neither.
    Other,
}

/// A finished run.
pub(super) struct Run {
    /// `run.json`.
    pub info: RunInfo,
    /// Keyframes that it was trained on, and that it is judged by.
    pub split: Split,
    /// What predicts a keyframe.
    pub predictor: Box<dyn Predictor>,
    /// What compares a prediction with the keyframe.
    pub evaluator: Evaluator,
    /// Its Gaussians and how they are drawn; methods without Gaussians have none.
    pub field: Option<(Field, RasterConfig)>,
}

/// A reconstruction at work.
pub(super) struct Work {
    /// Id of its method.
    pub method: String,
    /// Its seed.
    pub seed: u64,
    /// Keyframes that it is trained on, and that it will be judged by.
    pub split: Split,
    /// How far it is.
    pub growth: Arc<Growth>,
}

/// A run with its data set, a data set alone, or a reconstruction at work with the data set that it works on.
pub struct Subject {
    /// The data set.
    pub(super) dataset: Dataset,
    /// The run.
    pub(super) run: Option<Run>,
    /// The reconstruction at work.
    pub(super) work: Option<Work>,
    /// Index of the keyframe that the page opens on.
    pub(super) opening: usize,
}

/// The one run that a comparison's folder keeps.
fn kept_run(folder: &Path) -> Result<PathBuf> {
    let runs: Vec<PathBuf> = KeptModel::all(folder).into_iter().map(|model| model.folder).collect();
    match runs.as_slice() {
        [run] => Ok(run.clone()),
        [] => bail!(
            "{} holds a comparison and no model\n  help: `keep_model = true` in a row of its plan keeps one; or make a run with `corf reconstruct`",
            folder.display()
        ),
        several => bail!(
            "{} holds {} models\n  help: name one of them: {}",
            folder.display(),
            several.len(),
            several.iter().map(|run| run.display().to_string()).collect::<Vec<_>>().join(", ")
        ),
    }
}

impl Subject {
    /// Folder of the data set.
    pub fn dataset_folder(&self) -> &Path {
        self.dataset.dir()
    }

    /// Opens a run folder, the folder of a comparison that keeps one run (`corf demo`), or a data set; `dataset` says where a run's data set is now,
    /// `device` renders its predictions.
    ///
    /// # Errors
    /// A folder that is not there or is none of the three, a run or data set that is not finished, damaged or elsewhere, or no such device.
    pub fn open(folder: &Path, dataset: Option<&Path>, verify: Verify, device: DeviceChoice) -> Result<Self> {
        ensure!(
            folder.is_dir(),
            "{} is no folder\n  help: name a run (`corf reconstruct`), a data set, or the folder of `corf demo`",
            folder.display()
        );
        let holds = |file: &str| folder.join(file).exists();
        if holds("run.json") || holds("config.json") {
            return Self::of_run(folder, dataset, verify, &device.resolve()?);
        }
        if holds("plan.toml") {
            let kept = kept_run(folder)?;
            // The folder of a demo may have been moved, with the data set in it.
            let beside = folder.join("dataset");
            let beside = beside.join("dataset.json").exists().then_some(beside);
            return Self::of_run(&kept, dataset.or(beside.as_deref()), verify, &device.resolve()?);
        }
        if !holds("dataset.json") && !holds("dataset.partial.json") {
            bail!(
                "{} is neither a run nor a data set: there is no run.json and no dataset.json in it\n  help: name the folder that `corf reconstruct`, \
                 `corf dataset` or `corf demo` wrote",
                folder.display()
            );
        }
        ensure!(dataset.is_none(), "{} is a data set itself\n  help: leave --dataset out", folder.display());
        Ok(Self { dataset: verify.open(folder)?.dataset, run: None, work: None, opening: 0 })
    }

    /// Opens a run folder; `dataset` says where its data set is now, if it has moved, `backend` renders its predictions.
    ///
    /// # Errors
    /// A run or data set that is not finished, damaged or elsewhere.
    pub fn of_run(folder: &Path, dataset: Option<&Path>, verify: Verify, backend: &Backend) -> Result<Self> {
        let OpenRun { info, input, split, predictor, .. } = open::open(folder, dataset, verify, backend)?;
        let raster = open::raster_of(folder, &info)?;
        let field = raster.map(|raster| Ok::<_, corf::Error>((Field::read(folder)?, raster))).transpose()?;
        let evaluator = Evaluator::of(&input);
        let opening = opening(folder, &info, &split);
        Ok(Self { dataset: input.dataset, run: Some(Run { info, split, predictor, evaluator, field }), work: None, opening })
    }

    /// A reconstruction at work on a data set.
    pub(super) fn at_work(dataset: Dataset, work: Work) -> Self {
        Self { dataset, run: None, work: Some(work), opening: 0 }
    }

    /// The split that training keeps to, where there is one.
    fn split(&self) -> Option<&Split> {
        self.run.as_ref().map(|run| &run.split).or(self.work.as_ref().map(|work| &work.split))
    }

    /// The part that keyframe `index` plays.
    pub(super) fn role(&self, index: usize) -> Role {
        let (train, test) = match self.split() {
            Some(split) => (split.train.as_slice(), split.held_out.as_slice()),
            None => (self.dataset.train_indices(), self.dataset.test_indices()),
        };
        match index {
            i if test.contains(&i) => Role::Test,
            i if train.contains(&i) => Role::Train,
            _ => Role::Other,
        }
    }
}
