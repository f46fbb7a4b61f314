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
use crate::metrics::lpips::LpipsNetworks;
use crate::note;
use crate::plan::{Cell, Plan};
use crate::predictions;
use crate::progress::Progress;
use crate::record::{ARCHIVE, Outcome, Record, read_archive};
use crate::report::{self, Report, row_folder};
use crate::split::{Protocol, Split};
use crate::table;
use anyhow::{Context, Result, bail};
use corf_scene::dataset::Dataset;
use corf_scene::io::write_atomic;
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
}

impl Written {
    /// Its tables for a terminal.
    pub fn text(&self) -> String {
        let table = |records: &[Record]| table::plain(&table::rows(records));
        if self.segment.is_empty() {
            return table(&self.records);
        }
        format!("{}\ncontiguous segment held out:\n{}", table(&self.records), table(&self.segment))
    }
}

/// Runs every cell of a plan that has no record yet on `backend`, then writes tables and report.
///
/// # Errors
/// A dataset that cannot be read, images too small for a network of LPIPS, an interrupt, or a folder that cannot be written.
pub fn run(plan: &Plan, input: &Input, out: &Path, backend: &Backend, networks: &LpipsNetworks) -> Result<Written> {
    networks.check(&input.dataset)?;
    let mut written = run_split(plan, input, out, backend, networks)?;
    if plan.segment {
        let plan = Plan { protocol: Protocol::Segment, segment: false, ..plan.clone() };
        written.segment = run_split(&plan, input, &out.join(SEGMENT), backend, networks)?.records;
    }
    Ok(written)
}

/// The cells of the plan's own protocol.
fn run_split(plan: &Plan, input: &Input, out: &Path, backend: &Backend, networks: &LpipsNetworks) -> Result<Written> {
    let dataset = &input.dataset;
    let split = Split::of(dataset, plan.protocol)?;
    let cells = out.join("cells");
    std::fs::create_dir_all(&cells).with_context(|| format!("cannot create {}", cells.display()))?;
    write_atomic(out.join("plan.toml"), toml::to_string(plan)?.as_bytes())?;
    let shown = predictions::shown(&split.held_out);
    let mut records = Vec::new();
    for cell in plan.cells() {
        interrupt::check()?;
        let path = cells.join(format!("{}.json", cell.stem()));
        let method = methods::create(&cell.row.method, &cell.row.config, backend)?;
        if let Some(record) = finished(&path, cell, plan.protocol, method.as_ref(), dataset, networks)? {
            note!("{}, seed {}: already there", cell.row.label, cell.seed);
            records.push(record);
            continue;
        }
        let label = format!("{}, seed {}", cell.row.label, cell.seed);
        let mut progress = Progress::start(label, split.train.len(), "keyframes");
        let mut watch = |advance: crate::method::Advance<'_>| {
            progress.set(advance.done, advance.total);
            interrupt::check()
        };
        let keep = cell.seed == plan.seeds[0];
        let folder = row_folder(&out.join("predictions"), &cell.row.label);
        let look = |truth: &corf_scene::Keyframe, prediction: &crate::metrics::Prediction| {
            if keep && shown.contains(&truth.index) { predictions::keep(&folder, truth, prediction) } else { Ok(()) }
        };
        let record = harness::run_cell(&cell.row.label, method.as_ref(), input, &split, cell.seed, networks, &mut watch, look)?;
        progress.finish();
        if let Outcome::Failed { error } = &record.outcome {
            note!("{}, seed {}: FAILED: {error}", cell.row.label, cell.seed);
        }
        record.write(&path)?;
        records.push(record);
    }
    write_results(plan, dataset, records, out)
}

/// The record of a cell that is finished already; a failed one is tried again.
fn finished(
    path: &Path,
    cell: Cell<'_>,
    protocol: Protocol,
    method: &dyn Method,
    dataset: &Dataset,
    networks: &LpipsNetworks,
) -> Result<Option<Record>> {
    if !path.exists() {
        return Ok(None);
    }
    let record = Record::read(path)?;
    let same = record.dataset_hash == dataset.hash()
        && record.method == method.id()
        && record.config == method.config()
        && record.row == cell.row.label
        && record.split == protocol
        && record.seed == cell.seed;
    if !same {
        bail!(
            "{} is of another dataset, method, configuration, protocol or seed\n  help: choose another --out, or remove that file",
            path.display()
        );
    }
    if record.lpips_weights != networks.sha256() {
        bail!(
            "{} was evaluated with other weights of LPIPS, or with some where now there are none, or the other way round\n  help: give the \
             same --lpips as before, choose another --out, or remove that file",
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
    let path = out.join("plan.toml");
    let text = std::fs::read_to_string(&path)
        .with_context(|| format!("cannot read {}: is this a folder of `corf bench run`?", path.display()))?;
    let mut plan = Plan::parse(&text).with_context(|| format!("in {}", path.display()))?;
    plan.dataset = out.join(&plan.dataset);
    let records =
        plan.cells().map(|cell| Record::read(&out.join("cells").join(format!("{}.json", cell.stem())))).collect::<Result<_>>()?;
    Ok((plan, records))
}

/// The records of a folder that `corf bench run` left or that `corf bench pack` made, in the plan's order.
///
/// # Errors
/// A record that is missing or damaged.
pub fn records(folder: &Path) -> Result<Vec<Record>> {
    let archive = folder.join(ARCHIVE);
    if archive.exists() { read_archive(&archive) } else { Ok(load(folder)?.1) }
}

/// Writes `table.md`, `table.csv`, `table.tex` and `report.html`.
///
/// # Errors
/// When a file cannot be written.
pub fn write_results(plan: &Plan, dataset: &Dataset, records: Vec<Record>, out: &Path) -> Result<Written> {
    let (table_path, report_path) = (out.join("table.md"), out.join("report.html"));
    let head = format!("# {}\n\n{}\n\n", escape::markdown(&plan.name), escape::without_html(&plan.analysis));
    write_tables(&head, &records, out)?;
    let report = Report {
        plan,
        dataset,
        split: &Split::of(dataset, plan.protocol)?,
        transmitter_m: dataset.header().transmitter.map(|t| t.position_m),
        records: &records,
        predictions: &out.join("predictions"),
    };
    report::write(&report, &report_path)?;
    Ok(Written { records, segment: Vec::new(), report: report_path, table: table_path })
}

/// Writes `table.md`, which begins with `head`, `table.csv` and `table.tex`.
///
/// # Errors
/// When a file cannot be written.
pub fn write_tables(head: &str, records: &[Record], out: &Path) -> Result<()> {
    let rows = table::rows(records);
    write_atomic(out.join("table.md"), format!("{head}{}", table::markdown(&rows)).as_bytes())?;
    write_atomic(out.join("table.csv"), table::csv(records).as_bytes())?;
    Ok(write_atomic(out.join("table.tex"), table::latex(&rows).as_bytes())?)
}
