//! A plan's cells under one protocol: where their records are, and how one is run.

use crate::device::Backend;
use crate::experiment::cell_clock::CellClock;
use crate::experiment::plan::{Cell, Plan, RowKind, slug, stem};
use crate::methods;
use crate::methods::interface::{Checkpoints, Method, TrainingSet};
use crate::methods::registry;
use crate::metrics::input::Input;
use crate::metrics::{Halves, Prediction};
use crate::note;
use crate::record::prediction_folder::{PredictionFolder, Tally};
use crate::record::predictions;
use crate::record::{Outcome, PREDICTIONS, PROTOCOL, Record};
use crate::report::row_folder;
use crate::run::evaluation;
use crate::run::harness::{self, Reconstruction};
use crate::run::quality::QualityWatch;
use crate::run::{self, RunInfo};
use crate::split::{Protocol, Split};
use crate::terminal::interrupt;
use crate::terminal::progress::Progress;
use anyhow::{Context, Result, bail};
use corf_scene::Keyframe;
use corf_scene::dataset::Dataset;
use corf_scene::io::write_atomic;
use std::path::{Path, PathBuf};

/// The cells of a plan's own protocol, in their folder.
#[derive(Clone, Debug)]
pub struct Part {
    /// The plan.
    pub plan: Plan,
    /// Folder of its records, tables and report.
    pub out: PathBuf,
}

/// Folder of the records in a comparison's folder.
pub const CELLS: &str = "cells";

/// Path of a cell's record in a comparison's folder.
pub fn record_path(out: &Path, cell: Cell<'_>) -> PathBuf {
    out.join(CELLS).join(format!("{}.json", cell.stem()))
}

/// Reads a cell's record.
///
/// # Errors
/// A damaged record, or one of another cell than its file is named after.
pub fn read_record(path: &Path, cell: Cell<'_>) -> Result<Record> {
    let record = Record::read(path)?;
    let method = if cell.row.kind == RowKind::Predictions { PREDICTIONS } else { &cell.row.method };
    let is = (record.row.as_str(), record.seed, record.split, record.method.as_str());
    if is != (cell.row.label.as_str(), cell.seed, cell.split, method) {
        bail!(
            "{} holds the record of {:?}, seed {}, {} ({}), where that of {:?}, seed {}, {} ({method}) belongs\n  help: put every record \
             under its own name, or remove that file and run the cell again",
            path.display(),
            record.row,
            record.seed,
            record.split.name(),
            record.method,
            cell.row.label,
            cell.seed,
            cell.split.name()
        );
    }
    Ok(record)
}

/// Path of the record that belongs to a model's run folder, which is a row's, in the folder of the comparison that keeps it.
pub fn record_of_model(model: &Path, seed: u64, split: Protocol) -> Option<PathBuf> {
    let (comparison, row) = (model.parent()?.parent()?, model.file_name()?.to_str()?);
    Some(comparison.join(CELLS).join(format!("{}.json", stem(row, seed, split))))
}

/// Run folder of a row's first seed in a comparison's folder.
fn model_folder(out: &Path, label: &str) -> PathBuf {
    out.join(run::MODELS).join(slug(label))
}

/// Method id and resolved configuration of a cell, as its record has them.
///
/// # Errors
/// A row that cannot run.
pub fn settings_of(cell: Cell<'_>, split: &Split, dataset: &Dataset) -> Result<(String, serde_json::Value)> {
    let source = Source::of(cell, split, dataset, &Backend::Cpu)?;
    let (method, config) = source.identity();
    Ok((method.to_owned(), config))
}

impl Part {
    /// Path of a cell's record.
    pub fn record_path(&self, cell: Cell<'_>) -> PathBuf {
        record_path(&self.out, cell)
    }

    /// Makes the folder of the records and writes the plan beside it.
    ///
    /// # Errors
    /// When they cannot be written.
    pub fn write_plan(&self) -> Result<()> {
        let cells = self.out.join(CELLS);
        std::fs::create_dir_all(&cells).with_context(|| format!("cannot create {}", cells.display()))?;
        Ok(write_atomic(self.out.join("plan.toml"), toml::to_string(&self.plan)?.as_bytes())?)
    }

    /// The record of a cell that is finished already; a failed one is tried again.
    ///
    /// # Errors
    /// A record of something else, or a damaged one.
    pub fn finished(&self, cell: Cell<'_>, input: &Input) -> Result<Option<Record>> {
        let dataset = &input.dataset;
        let path = self.record_path(cell);
        if !path.exists() {
            return Ok(None);
        }
        let record = read_record(&path, cell)?;
        // One that failed is tried again, with whatever settings the plan has by now.
        if matches!(record.outcome, Outcome::Failed { .. }) {
            return Ok(None);
        }
        let (method, config) = settings_of(cell, &Split::of(dataset, cell.split)?, dataset)?;
        let same = record.dataset_hash == dataset.hash()
            && record.method == method
            && methods::without_retired(&record.config) == config
            && record.protocol == PROTOCOL;
        if !same {
            bail!(
                "{} is of another dataset, method, configuration or protocol, or of other predictions\n  help: choose another --out, or remove that file",
                path.display()
            );
        }
        if record.lpips_weights != input.networks.sha256() {
            bail!(
                "{} was evaluated with other weights of LPIPS, or with some where now there are none, or the other way round\n  help: give the \
                 same --lpips as before, choose another --out, or remove that file",
                path.display()
            );
        }
        Ok(Some(record))
    }

    /// Runs a cell; a method that fails gives a record that says so. The predictions of the first seed are kept beside the records, small, and its
    /// run folder where the row asks for it. With a folder to `work` in, a method that keeps checkpoints keeps them there and goes on from
    /// them, and the record's time is that of all its processes.
    ///
    /// # Errors
    /// An interrupt, or files that cannot be read or written.
    pub fn run_cell(&self, cell: Cell<'_>, input: &Input, backend: &Backend, work: Option<&Path>) -> Result<Record> {
        let (plan, dataset) = (&self.plan, &input.dataset);
        let split = Split::of(dataset, cell.split)?;
        let label = format!("{}, {}", cell.row.label, cell.which());
        let keep = cell.seed == plan.seeds[0];
        let folder = row_folder(&self.out.join("predictions"), &cell.row.label);
        let look = |truth: &Keyframe, prediction: Halves<'_>| {
            if keep { predictions::keep(&folder, truth, prediction) } else { Ok(()) }
        };
        let mut method = match Source::of(cell, &split, dataset, backend)? {
            Source::Method(method) => method,
            Source::Folder(folder) => {
                let (frames, warnings) = evaluation::evaluate_folder(&folder, input, &split, look)?;
                warnings.iter().for_each(|warning| note!("{label}: {warning}"));
                return Ok(harness::folder_record(&cell.row.label, &folder, input, cell.split, cell.seed, frames));
            }
        };
        let device = method.device();
        let mut clock = work.map(|work| CellClock::open(work, &device)).transpose()?;
        if let Some(clock) = &clock {
            let tag = format!("{} {} {} {}", dataset.hash(), cell.split.name(), method.config(), cell.seed);
            let path = clock.checkpoint().to_owned();
            method.keep_checkpoints(Checkpoints { path, every: None, resume: true, tag, device });
        }
        let mut progress = Progress::start(&label, split.train.len(), method.unit());
        let mut watch = |advance: crate::methods::interface::Advance<'_>| {
            progress.set(advance.done, advance.total);
            clock.as_mut().map_or(Ok(()), CellClock::keep)?;
            interrupt::check()
        };
        let look = |truth: &Keyframe, prediction: &Prediction| look(truth, prediction.halves());
        let keep_model = |result: &Reconstruction| {
            // Of folds the first, as of seeds.
            if !(keep && cell.row.keep_model && cell.split.fold().unwrap_or(1) == 1) {
                return Ok(());
            }
            let folder = model_folder(&self.out, &cell.row.label);
            // One that an interrupted or failed cell has left is none any more.
            if folder.exists() {
                std::fs::remove_dir_all(&folder).with_context(|| format!("cannot remove {}", folder.display()))?;
            }
            std::fs::create_dir_all(&folder).with_context(|| format!("cannot create {}", folder.display()))?;
            let info = RunInfo::of(
                method.as_ref(),
                &cell.row.config,
                cell.seed,
                (&input.dataset, input.verified),
                (split.protocol, split.train.len()),
                result,
            )?;
            run::write_config(&folder, &info.config)?;
            run::write_finished(&folder, &info, result)
        };
        let every = plan.evaluate_every.map(std::num::NonZeroUsize::get);
        let quality = QualityWatch::where_possible(every, method.as_ref(), input, &split, backend)?;
        let record =
            harness::run_cell(&cell.row.label, method.as_ref(), input, &split, cell.seed, quality, &mut watch, look, keep_model);
        progress.finish();
        if record.is_err()
            && let Some(clock) = &mut clock
        {
            // Interrupted: the method has saved its state behind the last report.
            clock.keep()?;
        }
        let mut record = record?;
        match (&mut record.outcome, clock) {
            (Outcome::Failed { error }, _) => note!("{label}: FAILED: {error}"),
            (Outcome::Done(numbers), Some(clock)) => {
                numbers.add_earlier(clock.earlier_s());
                clock.remove();
            }
            (Outcome::Done(_), None) => {}
        }
        Ok(record)
    }

    /// The record of a cell that ended in an error.
    ///
    /// # Errors
    /// A row that cannot run.
    pub fn failed(&self, cell: Cell<'_>, input: &Input, error: String) -> Result<Record> {
        let (row, protocol, outcome) = (&cell.row.label, cell.split, Outcome::Failed { error });
        let split = Split::of(&input.dataset, protocol)?;
        Ok(match Source::of(cell, &split, &input.dataset, &Backend::Cpu)? {
            Source::Method(method) => harness::record(row, method.as_ref(), input, protocol, cell.seed, outcome),
            Source::Folder(folder) => {
                let record = harness::folder_record(row, &folder, input, protocol, cell.seed, Vec::new());
                Record { outcome, ..record }
            }
        })
    }
}

/// What a cell's numbers come from.
enum Source {
    Method(Box<dyn Method>),
    Folder(PredictionFolder),
}

impl Source {
    fn of(cell: Cell<'_>, split: &Split, dataset: &Dataset, backend: &Backend) -> Result<Self> {
        Ok(match folder_of(cell, split, dataset)? {
            Some(folder) => Self::Folder(folder),
            None => {
                let mut method = methods::create(&cell.row.method, &cell.row.config, backend)?;
                method.settle(dataset)?;
                Self::Method(method)
            }
        })
    }

    /// Method id and configuration, as the record has them.
    fn identity(&self) -> (&str, serde_json::Value) {
        match self {
            Self::Method(method) => (method.id(), method.config()),
            Self::Folder(folder) => (PREDICTIONS, folder.config()),
        }
    }
}

/// The predictions that a cell is of; `None` where it is of a method.
fn folder_of(cell: Cell<'_>, split: &Split, dataset: &Dataset) -> Result<Option<PredictionFolder>> {
    let Some(dir) = cell.row.folder(cell.seed, split.protocol) else { return Ok(None) };
    let of_row = || format!("row \"{}\"", cell.row.label);
    let folder = PredictionFolder::open(&dir, dataset, split).with_context(of_row)?;
    let stated = folder.statement().seed;
    if !cell.row.is_single() && stated.is_some_and(|seed| seed != cell.seed) {
        bail!(
            "row \"{}\": {} is stated to be of seed {}, and stands for seed {}\n  help: {{seed}} in dir stands for the seed",
            cell.row.label,
            dir.display(),
            stated.unwrap_or_default(),
            cell.seed
        );
    }
    Ok(Some(folder))
}

/// Asks every method of a plan whether it takes the data set, and reads every file of the plan's predictions, so that what is wrong is found before
/// anything is run.
///
/// # Errors
/// The first row that cannot run, or whose file is missing or cannot be used.
pub fn check_rows(plan: &Plan, dataset: &Dataset) -> Result<()> {
    let protocols = plan.protocol.folds().into_iter().chain(plan.segment.then_some(Protocol::SEGMENT));
    for protocol in protocols {
        let split = Split::of(dataset, protocol)?;
        for row in plan.rows.iter().filter(|row| row.kind == RowKind::Method) {
            let check = || {
                let mut method = methods::create(&row.method, &row.config, &Backend::Cpu)?;
                harness::check_training(method.as_ref(), dataset, &split)?;
                registry::check_data_set(method.as_mut(), &row.config, &TrainingSet::new(dataset, &split))
            };
            check().with_context(|| format!("row \"{}\"", row.label))?;
        }
        for cell in plan.cells().filter(|cell| cell.split == protocol || protocol == Protocol::SEGMENT) {
            let Some(folder) = folder_of(cell, &split, dataset)? else { continue };
            for &index in &split.held_out {
                interrupt::check()?;
                let read = folder.read(index, dataset, &mut Tally::default());
                read.with_context(|| format!("row \"{}\"", cell.row.label))?;
            }
        }
    }
    Ok(())
}
