//! Runs a plan's cells and writes its tables and report.
//!
//! ```text
//! OUT/plan.toml          the plan as it was run
//! OUT/cells/*.json       one record a cell: what is there is not run again
//! OUT/models/*/          run folders of the rows that ask for it, first seed
//! OUT/viewer*.html       a page of each, to look around in it; the report links to it
//! OUT/predictions/*/     the held-out keyframes as every row's first seed predicts them, small
//! OUT/table.md|csv|tex   OUT/report.html
//! OUT/beam.svg, rate.svg, outage.svg    best beam, rate and outage along the way
//! OUT/segment/           the same with a contiguous segment held out, if the plan asks for it
//! ```

use crate::device::Backend;
use crate::experiment::cells::{self, CELLS, Part};
use crate::experiment::plan::{Cell, Plan};
use crate::files::escape;
use crate::files::json::read_text;
use crate::files::output::is_leftover;
use crate::metrics::input::{Input, Verify};
use crate::note;
use crate::record::comparability::{self, Joined};
use crate::record::folds;
use crate::record::{ARCHIVE, Record, read_archive};
use crate::report::along::Figures;
use crate::report::{self, Report};
use crate::run::KeptModel;
use crate::split::{Protocol, Split};
use crate::table::{self, Columns};
use crate::terminal;
use crate::terminal::interrupt::{self, Interrupted};
use crate::viewer::{self, Subject};
use anyhow::{Context, Result, ensure};
use corf_scene::dataset::Dataset;
use corf_scene::io::write_atomic;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The plan in a comparison's folder.
const PLAN: &str = "plan.toml";
/// Folder of the contiguous segment's cells, tables and report.
pub const SEGMENT: &str = "segment";

/// Output of a suite: its records, and the paths of its report and table.
pub struct Written {
    /// All records, in the plan's order.
    pub records: Vec<Record>,
    /// Records of the contiguous segment, if the plan asks for it.
    pub segment: Vec<Record>,
    /// Path of `report.html`; none of a data set whose array stands still, for a report shows what a platform saw on its way.
    pub report: Option<PathBuf>,
    /// Path of `table.md`.
    pub table: PathBuf,
    /// Columns of the tables.
    pub columns: Columns,
}

impl Written {
    /// Where to look at it: the report, or where there is none the table.
    pub fn place(&self) -> String {
        match &self.report {
            Some(report) => format!("report: {}", report.display()),
            None => format!("table: {}", self.table.display()),
        }
    }

    /// Its tables for a terminal.
    pub fn text(&self) -> String {
        let table = |records: &[Record]| table::plain(&table::rows(records), &self.columns, terminal::width());
        if self.segment.is_empty() {
            return table(&self.records);
        }
        format!("{}\ncontiguous segment held out:\n{}", table(&self.records), table(&self.segment))
    }
}

/// The parts of a plan in a folder: its own protocol, and the contiguous segment if the plan asks for it.
pub fn parts(plan: &Plan, out: &Path) -> Vec<Part> {
    let own = Part { plan: plan.clone(), out: out.to_owned() };
    let segment = Plan { protocol: Protocol::SEGMENT, segment: false, ..plan.clone() };
    let segment = plan.segment.then(|| Part { plan: segment, out: out.join(SEGMENT) });
    std::iter::once(own).chain(segment).collect()
}

/// Runs every cell of a plan that has no record yet on `backend`, then writes tables and report.
///
/// # Errors
/// A dataset that cannot be read, an interrupt, or a folder that cannot be written.
pub fn run(plan: &Plan, input: &Input, out: &Path, backend: &Backend) -> Result<Written> {
    let parts = parts(plan, out);
    let mut written = run_part(&parts[0], input, backend)?;
    for part in &parts[1..] {
        written.segment = run_part(part, input, backend)?.records;
    }
    Ok(written)
}

fn run_part(part: &Part, input: &Input, backend: &Backend) -> Result<Written> {
    part.write_plan()?;
    let mut records: BTreeMap<usize, Record> = BTreeMap::new();
    for (place, cell) in part.plan.interleaved() {
        interrupt::check()?;
        let path = part.record_path(cell);
        let record = match part.finished(cell, input)? {
            Some(record) => {
                note!("{}, {}: already there", cell.row.label, cell.which());
                record
            }
            None => {
                let record = part.run_cell(cell, input, backend, None)?;
                record.write(&path)?;
                record
            }
        };
        records.insert(place, record);
    }
    write_viewers(&part.out, input, backend)?;
    write_results(&part.plan, &input.dataset, records.into_values().collect(), &part.out)
}

/// Writes the viewer's page of every model that a comparison keeps, unless it is there. It is no result: where it cannot be written, that is said
/// and the comparison goes on.
fn write_viewers(out: &Path, input: &Input, backend: &Backend) -> Result<()> {
    for model in KeptModel::all(out).into_iter().filter(|model| !model.has_page()) {
        let subject = Subject::of_run(&model.folder, Some(input.dataset.dir()), Verify::DONE, backend);
        match subject.and_then(|mut subject| viewer::export(&mut subject, &model.page)) {
            Ok(bytes) => note!("{} ({:.1} MB)", model.page.display(), bytes as f64 / 1e6),
            Err(error) if error.is::<Interrupted>() => return Err(error),
            Err(error) => {
                // One that is there is of an earlier model.
                let _ = std::fs::remove_file(&model.page);
                note!("{} has no viewer's page: {error:#}", model.folder.display());
            }
        }
    }
    Ok(())
}

/// Reads the records of a suite's folder in the plan's order.
///
/// # Errors
/// A record that is missing, damaged or of another cell, or records that may not stand in one table.
pub fn load(out: &Path) -> Result<(Plan, Vec<Record>)> {
    let mut plan = load_plan(out)?;
    plan.dataset = out.join(&plan.dataset);
    let paths: Vec<PathBuf> = plan.cells().map(|cell| cells::record_path(out, cell)).collect();
    let read = |(cell, path): (Cell<'_>, &PathBuf)| {
        ensure!(
            path.exists(),
            "{} is missing: the plan has the cell {:?}, {}\n  help: `corf bench run PLAN.toml --out {} --resume` runs what is missing; or \
             take the cell out of {}",
            path.display(),
            cell.row.label,
            cell.which(),
            out.display(),
            out.join(PLAN).display()
        );
        cells::read_record(path, cell)
    };
    let records: Vec<Record> = plan.cells().zip(&paths).map(read).collect::<Result<_>>()?;
    for stray in strays(out, &paths)? {
        note!("{} is of no cell of {}: it is left out", stray.display(), out.join(PLAN).display());
    }
    comparability::check(&records, &|at| paths[at].display().to_string(), &Joined::of(out)?)?;
    Ok((plan, records))
}

/// What is among the records that no cell of the plan has, in order of its name.
fn strays(out: &Path, paths: &[PathBuf]) -> Result<Vec<PathBuf>> {
    let cells = out.join(CELLS);
    let context = || format!("cannot read {}", cells.display());
    let mut strays = Vec::new();
    for entry in std::fs::read_dir(&cells).with_context(context)? {
        let entry = entry.with_context(context)?;
        if !is_leftover(&entry.file_name()) && !paths.contains(&entry.path()) {
            strays.push(entry.path());
        }
    }
    strays.sort();
    Ok(strays)
}

/// The plan of a suite's folder, as it was run.
///
/// # Errors
/// A file that is missing, or that is no plan.
pub fn load_plan(out: &Path) -> Result<Plan> {
    let path = out.join(PLAN);
    let text =
        read_text(&path).with_context(|| format!("cannot read {}: is this a folder of `corf bench run`?", path.display()))?;
    Plan::parse(&text).with_context(|| format!("in {}", path.display()))
}

/// The records of a folder that `corf bench run` left or that `corf bench pack` made, in the plan's order.
///
/// # Errors
/// Those of [`load`], or an archive beside cells.
pub fn records(folder: &Path) -> Result<Vec<Record>> {
    let archive = folder.join(ARCHIVE);
    if !archive.exists() {
        return Ok(load(folder)?.1);
    }
    ensure!(
        !folder.join(CELLS).exists(),
        "{} has records in {ARCHIVE} and in {CELLS}/\n  help: they may differ: keep those that are meant",
        folder.display()
    );
    let records = read_archive(&archive)?;
    comparability::check(&records, &|at| format!("{}, line {}", archive.display(), at + 1), &Joined::of(folder)?)?;
    Ok(records)
}

/// The words for the columns of a folder's tables: the plan's, where there is a plan.
///
/// # Errors
/// A plan that cannot be read.
pub fn columns_of(folder: &Path) -> Result<Vec<String>> {
    if folder.join(ARCHIVE).exists() { Ok(Vec::new()) } else { Ok(load_plan(folder)?.columns) }
}

/// Writes `table.md`, `table.csv`, `table.tex`, the figures along the way and `report.html`.
///
/// # Errors
/// When a file cannot be written.
pub fn write_results(plan: &Plan, dataset: &Dataset, records: Vec<Record>, out: &Path) -> Result<Written> {
    let (table_path, report_path) = (out.join("table.md"), out.join("report.html"));
    let head = format!("# {}\n\n{}\n\n", escape::markdown(&plan.name), escape::without_html(&plan.analysis));
    let columns = table::columns(&plan.columns)?;
    write_tables(&head, &records, &columns, out)?;
    let whole = folds::together(&records);
    let figures = Figures::of(&whole, dataset)?;
    figures.iter().try_for_each(|figures| figures.write(out))?;
    if dataset.fixed_array().is_some() {
        drop(whole);
        return Ok(Written { records, segment: Vec::new(), report: None, table: table_path, columns });
    }
    let report = Report {
        plan,
        dataset,
        split: &Split::of_all_folds(dataset, plan.protocol)?,
        transmitter_m: dataset.header().transmitter.map(|t| t.position_m),
        records: &whole,
        predictions: &out.join("predictions"),
        figures,
        models: &KeptModel::all(out),
    };
    report::write(&report, &report_path)?;
    drop(whole);
    Ok(Written { records, segment: Vec::new(), report: Some(report_path), table: table_path, columns })
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
