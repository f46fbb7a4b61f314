//! A run folder back to a predictor.

use crate::device::Backend;
use crate::files::json::read_numbers;
use crate::methods::family::SavedRun;
use crate::methods::interface::{Method, Predictor};
use crate::methods::registry;
use crate::metrics::input::{Input, Verify};
use crate::run::{RunInfo, SCHEMA};
use crate::split::Split;
use anyhow::{Context, Result, ensure};
use corf::RasterConfig;
use corf_scene::dataset::Dataset;
use std::path::Path;

/// A run, ready to be asked.
pub struct OpenRun {
    /// `run.json`.
    pub info: RunInfo,
    /// The dataset it was made from.
    pub input: Input,
    /// Its training and held-out split.
    pub split: Split,
    /// The method, made again.
    pub method: Box<dyn Method>,
    /// The field.
    pub predictor: Box<dyn Predictor>,
}

/// `run.json` of a run folder.
///
/// # Errors
/// A folder without it (not a run, or not finished), or one of another schema.
pub fn read_info(folder: &Path) -> Result<RunInfo> {
    let info: RunInfo = read_numbers(&folder.join("run.json")).with_context(|| {
        format!("{} holds no finished run\n  help: run `corf reconstruct` with --out {0} first", folder.display())
    })?;
    ensure!(info.schema == SCHEMA, "{}: schema {} is not {SCHEMA}", folder.display(), info.schema);
    Ok(info)
}

/// The rasteriser's settings that a run's Gaussians were trained with; none where its method keeps no PLY of Gaussians.
///
/// # Errors
/// A configuration of another version.
pub fn raster_of(folder: &Path, info: &RunInfo) -> Result<Option<RasterConfig>> {
    registry::raster_of(&info.method, &info.config)
        .with_context(|| format!("{}: the configuration is not of this version", folder.join("run.json").display()))
}

/// Opens a run folder; `dataset` says where the dataset is now, if it has moved, `verify` whether its files are checked, and `backend`
/// what renders its field.
///
/// # Errors
/// A folder without `run.json` (not a run, or not finished), a changed dataset, a damaged field.
pub fn open(folder: &Path, dataset: Option<&Path>, verify: Verify, backend: &Backend) -> Result<OpenRun> {
    open_with(|place| Dataset::open(place), folder, dataset, verify, backend)
}

/// The same of a data set of either kind: see [`Dataset::fixed_array`].
///
/// # Errors
/// Those of [`open`], but for the kind.
pub fn open_any(folder: &Path, dataset: Option<&Path>, verify: Verify, backend: &Backend) -> Result<OpenRun> {
    open_with(|place| Dataset::open_any(place), folder, dataset, verify, backend)
}

fn open_with(
    open: impl FnOnce(&Path) -> corf_scene::Result<Dataset>,
    folder: &Path,
    dataset: Option<&Path>,
    verify: Verify,
    backend: &Backend,
) -> Result<OpenRun> {
    let info = read_info(folder)?;
    let place = dataset.unwrap_or(&info.dataset);
    let dataset = open(place).with_context(|| "the run's dataset cannot be opened; name its place with --dataset")?;
    // Which dataset it is comes first: another one is whole as well.
    ensure!(
        dataset.hash() == info.dataset_hash,
        "{} is not the dataset this run was made from (hash {} instead of {})\n  help: name the right one with --dataset",
        place.display(),
        dataset.hash(),
        info.dataset_hash
    );
    let input = Input::of(dataset, verify.wanted())?;
    let dataset = &input.dataset;
    let split = Split::of(dataset, info.protocol)?;
    let mut method = registry::create_again(&info.method, &info.overrides, backend)?;
    method.settle(dataset)?;
    let saved = SavedRun { folder, config: &info.config, dataset, backend };
    let predictor = registry::open(&saved, method.as_ref(), info.seed, &split)?;
    Ok(OpenRun { info, input, split, method, predictor })
}
