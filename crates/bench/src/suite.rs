//! Runs a plan's cells and writes its tables and report.
//!
//! ```text
//! OUT/plan.toml          the plan as it was run
//! OUT/cells/*.json       one record a cell: what is there is not run again
//! OUT/predictions/*/     a few predicted frames of every row's first seed
//! OUT/table.md|csv|tex   OUT/report.html
//! OUT/segment/           the same with a contiguous segment held out, if the plan asks for it
//! ```

use crate::device::Backend;
use crate::escape;
use crate::harness;
use crate::input::Input;
use crate::interrupt;
use crate::method::Method;
use crate::methods;
use crate::metrics::{Column, Halves, Prediction};
use crate::note;
use crate::plan::{Cell, Plan};
use crate::prediction_folder::{PredictionFolder, Tally};
use crate::predictions;
use crate::progress::Progress;
use crate::record::{ARCHIVE, Outcome, PREDICTIONS, Record, read_archive};
use crate::report::{self, Report, row_folder};
use crate::split::{Protocol, Split};
use crate::table;
use anyhow::{Context, Result, bail};
use corf_scene::Keyframe;
use corf_scene::dataset::Dataset;
use corf_scene::io::write_atomic;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Folder of the contiguous segment's cells, tables and report.
pub const SEGMENT: &str = "segment";

/// Output of a suite: its records, and the paths of its report and table.
pub struct Written {
    /// All records, in the plan's order.
    pub records: Vec<Record>,
    /// Records of the contiguous segment, if the plan asks for it.
    pub segment: Vec<Record>,
    /// Path of `report.html`.
    pub report: PathBuf,
    /// Path of `table.md`.
    pub table: PathBuf,
    /// Columns of the tables.
    pub columns: Vec<&'static Column>,
}

impl Written {
    /// Its tables for a terminal.
    pub fn text(&self) -> String {
        let table = |records: &[Record]| table::plain(&table::rows(records), &self.columns);
        if self.segment.is_empty() {
            return table(&self.records);
        }
        format!("{}\ncontiguous segment held out:\n{}", table(&self.records), table(&self.segment))
    }
}

/// Runs every cell of a plan that has no record yet on `backend`, then writes tables and report.
///
/// # Errors
/// A dataset that cannot be read, an interrupt, or a folder that cannot be written.
pub fn run(plan: &Plan, input: &Input, out: &Path, backend: &Backend) -> Result<Written> {
    let mut written = run_split(plan, input, out, backend)?;
    if plan.segment {
        let plan = Plan { protocol: Protocol::Segment, segment: false, ..plan.clone() };
        written.segment = run_split(&plan, input, &out.join(SEGMENT), backend)?.records;
    }
    Ok(written)
}

/// The cells of the plan's own protocol.
fn run_split(plan: &Plan, input: &Input, out: &Path, backend: &Backend) -> Result<Written> {
    let dataset = &input.dataset;
    let split = Split::of(dataset, plan.protocol)?;
    let cells = out.join("cells");
    std::fs::create_dir_all(&cells).with_context(|| format!("cannot create {}", cells.display()))?;
    write_atomic(out.join("plan.toml"), toml::to_string(plan)?.as_bytes())?;
    let shown = predictions::shown(&split.held_out);
    let mut records: BTreeMap<usize, Record> = BTreeMap::new();
    for (place, cell) in plan.interleaved() {
        interrupt::check()?;
        let path = cells.join(format!("{}.json", cell.stem()));
        let source = Source::of(cell, &split, dataset, backend)?;
        if let Some(record) = finished(&path, cell, plan.protocol, &source, dataset)? {
            note!("{}, seed {}: already there", cell.row.label, cell.seed);
            records.insert(place, record);
            continue;
        }
        let label = format!("{}, seed {}", cell.row.label, cell.seed);
        let keep = cell.seed == plan.seeds[0];
        let folder = row_folder(&out.join("predictions"), &cell.row.label);
        let look = |truth: &Keyframe, prediction: Halves<'_>| {
            if keep && shown.contains(&truth.index) { predictions::keep(&folder, truth, prediction) } else { Ok(()) }
        };
        let method = match &source {
            Source::Method(method) => method.as_ref(),
            Source::Folder(folder) => {
                let (frames, warnings) = harness::evaluate_folder(folder, dataset, &split, look)?;
                warnings.iter().for_each(|warning| note!("{label}: {warning}"));
                let record = harness::folder_record(&cell.row.label, folder, input, plan.protocol, cell.seed, frames);
                record.write(&path)?;
                records.insert(place, record);
                continue;
            }
        };
        let mut progress = Progress::start(label, split.train.len(), "keyframes");
        let mut watch = |advance: crate::method::Advance<'_>| {
            progress.set(advance.done, advance.total);
            interrupt::check()
        };
        let look = |truth: &Keyframe, prediction: &Prediction| look(truth, prediction.halves());
        let record = harness::run_cell(&cell.row.label, method, input, &split, cell.seed, &mut watch, look)?;
        progress.finish();
        if let Outcome::Failed { error } = &record.outcome {
            note!("{}, seed {}: FAILED: {error}", cell.row.label, cell.seed);
        }
        record.write(&path)?;
        records.insert(place, record);
    }
    write_results(plan, dataset, records.into_values().collect(), out)
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
            None => Self::Method(methods::create(&cell.row.method, &cell.row.config, backend)?),
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

/// Reads every file of the plan's predictions, so that what is wrong with them is found before anything is run.
///
/// # Errors
/// The first that is missing or cannot be used, with its row.
pub fn check_folders(plan: &Plan, dataset: &Dataset) -> Result<()> {
    let protocols = [Some(plan.protocol), plan.segment.then_some(Protocol::Segment)];
    for protocol in protocols.into_iter().flatten() {
        let split = Split::of(dataset, protocol)?;
        for cell in plan.cells() {
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

/// The record of a cell that is finished already; a failed one is tried again.
fn finished(path: &Path, cell: Cell<'_>, protocol: Protocol, source: &Source, dataset: &Dataset) -> Result<Option<Record>> {
    if !path.exists() {
        return Ok(None);
    }
    let record = Record::read(path)?;
    let (method, config) = source.identity();
    let same = record.dataset_hash == dataset.hash()
        && record.method == method
        && record.config == config
        && record.row == cell.row.label
        && record.split == protocol
        && record.seed == cell.seed;
    if !same {
        bail!(
            "{} is of another dataset, method, configuration, protocol or seed, or of other predictions\n  help: choose another --out, or remove that file",
            path.display()
        );
    }
    Ok(matches!(record.outcome, Outcome::Done(_)).then_some(record))
}

/// Reads the records of a suite's folder in the plan's order.
///
/// # Errors
/// A record that is missing or damaged.
pub fn load(out: &Path) -> Result<(Plan, Vec<Record>)> {
    let mut plan = load_plan(out)?;
    plan.dataset = out.join(&plan.dataset);
    let records =
        plan.cells().map(|cell| Record::read(&out.join("cells").join(format!("{}.json", cell.stem())))).collect::<Result<_>>()?;
    Ok((plan, records))
}

/// The plan of a suite's folder, as it was run.
fn load_plan(out: &Path) -> Result<Plan> {
    let path = out.join("plan.toml");
    let text = std::fs::read_to_string(&path)
        .with_context(|| format!("cannot read {}: is this a folder of `corf bench run`?", path.display()))?;
    Plan::parse(&text).with_context(|| format!("in {}", path.display()))
}

/// The records of a folder that `corf bench run` left or that `corf bench pack` made, in the plan's order.
///
/// # Errors
/// A record that is missing or damaged.
pub fn records(folder: &Path) -> Result<Vec<Record>> {
    let archive = folder.join(ARCHIVE);
    if archive.exists() { read_archive(&archive) } else { Ok(load(folder)?.1) }
}

/// The words for the columns of a folder's tables: the plan's, where there is a plan.
///
/// # Errors
/// A plan that cannot be read.
pub fn columns_of(folder: &Path) -> Result<Vec<String>> {
    if folder.join(ARCHIVE).exists() { Ok(Vec::new()) } else { Ok(load_plan(folder)?.columns) }
}

/// Writes `table.md`, `table.csv`, `table.tex` and `report.html`.
///
/// # Errors
/// When a file cannot be written.
pub fn write_results(plan: &Plan, dataset: &Dataset, records: Vec<Record>, out: &Path) -> Result<Written> {
    let (table_path, report_path) = (out.join("table.md"), out.join("report.html"));
    let head = format!("# {}\n\n{}\n\n", escape::markdown(&plan.name), escape::without_html(&plan.analysis));
    let columns = table::columns(&plan.columns)?;
    write_tables(&head, &records, &columns, out)?;
    let report = Report {
        plan,
        dataset,
        split: &Split::of(dataset, plan.protocol)?,
        transmitter_m: dataset.header().transmitter.map(|t| t.position_m),
        records: &records,
        predictions: &out.join("predictions"),
    };
    report::write(&report, &report_path)?;
    Ok(Written { records, segment: Vec::new(), report: report_path, table: table_path, columns })
}

/// Writes `table.md`, which begins with `head`, `table.csv` and `table.tex`.
///
/// # Errors
/// When a file cannot be written.
pub fn write_tables(head: &str, records: &[Record], columns: &table::Columns, out: &Path) -> Result<()> {
    let rows = table::rows(records);
    write_atomic(out.join("table.md"), format!("{head}{}", table::markdown(&rows, columns)).as_bytes())?;
    write_atomic(out.join("table.csv"), table::csv(records).as_bytes())?;
    Ok(write_atomic(out.join("table.tex"), table::latex(&rows, columns).as_bytes())?)
}
