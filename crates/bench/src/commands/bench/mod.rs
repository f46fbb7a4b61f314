//! `corf bench`: plans to tables, and what the parts cost.

mod array;
mod cells;
mod density;
mod light;
mod network;
mod paper;
mod publish;
mod radio;
mod scale;
mod step;

use self::cells::{CellCommand, Collect, PlanCommand, Submit};
use super::{Verdict, print, show};
use crate::comparison::suite;
use crate::comparison::sweep::Sweep;
use crate::device::DeviceChoice;
use crate::experiment::cells::check_rows;
use crate::experiment::plan::Plan;
use crate::files::separation::{Reads, keep_apart};
use crate::metrics::input::Verify;
use crate::metrics::lpips::LpipsOption;
use crate::record::comparability::JOINED;
use crate::record::{ARCHIVE, write_archive};
use crate::report::along;
use crate::run::{claim_fresh, claim_output, claim_shared};
use crate::table;
use crate::terminal;
use anyhow::{Context, Result};
use clap::{Args, Subcommand};
use corf_scene::io::{read, write_atomic};
use corf_scene::words::counted;
use std::path::{Path, PathBuf};

/// Run plans, write tables and reports.
#[derive(Subcommand)]
pub enum Bench {
    /// Run every cell of a plan, then write tables and report.
    Run(Run),
    /// Write the list of a plan's cells, each named by a hash of all it depends on, to run them apart: on a cluster, or several at once.
    Plan(PlanCommand),
    /// Run one cell of a list; one that is finished answers at once.
    Cell(CellCommand),
    /// Run the unfinished cells of a list: as a Slurm job array with a collecting job, or several at once on this machine.
    Submit(Submit),
    /// Write tables and report from the records of a list's cells, of which those without one are failed cells; or again from an archive.
    Collect(Collect),
    /// Compare changes of a method's constants on the validation keyframes of several datasets.
    Sweep(SweepCommand),
    /// Run a plan on thinner and thinner training keyframes, and say at which distance to the nearest one a field overtakes copying.
    Density(density::Density),
    /// Print a finished comparison's table.
    Table(Table),
    /// Write a finished comparison's tables and report again.
    Report(Report),
    /// Write the tables and the time figure of the CORF-GS paper from a finished comparison, each figure beside the paper's.
    Paper(paper::Paper),
    /// Measure how far a dataset's images are from converged ones, and their cost.
    Light(light::Light),
    /// Measure the cost of tracing a dataset's radio half, stage by stage, and its sampling error.
    Radio(radio::Radio),
    /// Put the records of a comparison into one file, with its tables, as results are published.
    Pack(Pack),
    /// Put a finished comparison into one archive of plan, records, tables, report and environment, which `corf bench collect` writes again byte for
    /// byte.
    Publish(publish::Publish),
    /// Measure training steps, stage by stage, beside the least time their bytes and operations take.
    Step(step::Step),
    /// Measure the networks of the baselines NeRF² and WRF-GS+: a layer's matrix products and whole steps, beside the device's peak.
    Network(network::Network),
    /// Measure how many poses a second the radio field of `corf-array` is observed at, beside the least time its bytes and operations take.
    Array(array::Array),
    /// Measure how time and memory grow with Gaussians, pixels, triangles, receivers and keyframes: tables, fitted exponents, plots.
    Scale(scale::Scale),
}

/// Folder of the cells, and options of their runs.
#[derive(Args)]
struct Cells {
    /// Output folder.
    #[arg(long)]
    out: PathBuf,
    /// Go on with a folder that holds finished cells.
    #[arg(long)]
    resume: bool,
    #[command(flatten)]
    verify: Verify,
    /// Device that reconstructs: auto, cpu, gpu, or gpu:N for the N-th adapter.
    #[arg(long, default_value_t)]
    device: DeviceChoice,
}

/// `corf bench run`.
#[derive(Args)]
pub struct Run {
    /// Plan file (TOML): dataset, seeds, rows.
    plan: PathBuf,
    #[command(flatten)]
    cells: Cells,
    #[command(flatten)]
    lpips: LpipsOption,
}

/// `corf bench sweep`.
#[derive(Args)]
pub struct SweepCommand {
    /// Sweep file (TOML): datasets, seeds, method, changes.
    sweep: PathBuf,
    #[command(flatten)]
    cells: Cells,
}

/// `corf bench table`.
#[derive(Args)]
pub struct Table {
    /// Folder of `corf bench run`, `corf demo` or `corf bench pack`.
    folder: PathBuf,
    /// Notation of the table.
    #[arg(long, value_enum, default_value_t = Notation::Markdown)]
    format: Notation,
    /// Columns, with commas between: keys, short, radio, all …; --help lists them. Without it those of the plan.
    #[arg(
        long,
        value_delimiter = ',',
        value_name = "KEY,KEY",
        allow_hyphen_values = true,
        long_help = table::help_of_keys() + "\n\nWithout it those of the plan."
    )]
    columns: Vec<String>,
}

/// Notations of a table.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Notation {
    /// A table of Markdown.
    Markdown,
    /// Every metric of every cell, a line each.
    Csv,
    /// A tabular of LaTeX with booktabs.
    Latex,
    /// The same with columns of siunitx, in which numbers stand under each other by their points.
    Siunitx,
    /// Aligned text, broken to the terminal's width.
    Plain,
}

/// `corf bench pack`.
#[derive(Args)]
pub struct Pack {
    /// Folder of `corf bench run` or `corf demo`.
    folder: PathBuf,
    /// Output folder: records.jsonl.gz, table.md, table.csv, table.tex, and the figures beam.svg, rate.svg and outage.svg where the comparison has
    /// them; the same in segment/ where there is one.
    #[arg(long)]
    out: PathBuf,
}

/// `corf bench report`.
#[derive(Args)]
pub struct Report {
    /// Folder of `corf bench run` or `corf demo`.
    folder: PathBuf,
    #[command(flatten)]
    verify: Verify,
}

impl Bench {
    /// Runs the sub-command.
    ///
    /// # Errors
    /// Bad plans, unreadable datasets or folders, an interrupt.
    pub fn run(self, json: bool) -> Result<Verdict> {
        match self {
            Self::Run(c) => c.run(json),
            Self::Plan(c) => c.run(json),
            Self::Cell(c) => c.run(json),
            Self::Submit(c) => c.run(json),
            Self::Collect(c) => c.run(json),
            Self::Sweep(c) => c.run(json),
            Self::Density(c) => c.run(json),
            Self::Table(c) => c.run(json),
            Self::Report(c) => c.run(json),
            Self::Paper(c) => c.run(json),
            Self::Pack(c) => c.run(json),
            Self::Publish(c) => c.run(json),
            Self::Light(c) => c.run(json),
            Self::Radio(c) => c.run(json),
            Self::Step(c) => c.run(json),
            Self::Network(c) => c.run(json),
            Self::Array(c) => c.run(json),
            Self::Scale(c) => c.run(json),
        }
    }
}

impl Run {
    fn run(self, json: bool) -> Result<Verdict> {
        let mut plan = Plan::load(&self.plan)?;
        plan.make_absolute()?;
        keep_apart("--out", &self.cells.out, &[Reads::Folder(&plan.dataset)])?;
        let backend = self.cells.device.resolve()?;
        let networks = self.lpips.read(&backend)?;
        let input = self.cells.verify.open_any(&plan.dataset)?.with_networks(&networks)?;
        check_rows(&plan, &input.dataset)?;
        let _held = claim_output(&self.cells.out, self.cells.resume)?;
        let written = suite::run(&plan, &input, &self.cells.out, &backend)?;
        let text = format!("{}\n{}", written.text(), written.place());
        let all = [written.records, written.segment].concat();
        show(json, &all, &text)?;
        Ok(Verdict::of(&all))
    }
}

impl SweepCommand {
    fn run(self, json: bool) -> Result<Verdict> {
        let sweep = Sweep::load(&self.sweep)?;
        let reads: Vec<Reads<'_>> = sweep.datasets.iter().map(|folder| Reads::Folder(folder)).collect();
        keep_apart("--out", &self.cells.out, &reads)?;
        let backend = self.cells.device.resolve()?;
        let _held = claim_output(&self.cells.out, self.cells.resume)?;
        let (text, records) = sweep.run(&self.cells.out, self.cells.verify, &backend)?;
        show(json, &records, &text)?;
        Ok(Verdict::of(&records))
    }
}

impl Table {
    fn run(self, json: bool) -> Result<Verdict> {
        let records = suite::records(&self.folder)?;
        let words = if self.columns.is_empty() { suite::columns_of(&self.folder)? } else { self.columns };
        let (rows, columns) = (table::rows(&records), table::columns(&words)?);
        if json {
            show(true, &records, "")?;
        } else {
            print(&match self.format {
                Notation::Markdown => table::markdown(&rows, &columns),
                Notation::Csv => table::csv(&records),
                Notation::Latex => table::latex(&rows, &columns),
                Notation::Siunitx => table::siunitx(&rows, &columns),
                Notation::Plain => table::plain(&rows, &columns, terminal::width()),
            })?;
        }
        Ok(Verdict::of(&records))
    }
}

impl Pack {
    fn run(self, json: bool) -> Result<Verdict> {
        // The comparison itself, and that of the contiguous segment where there is one.
        let parts = [Path::new(""), Path::new(suite::SEGMENT)];
        let parts = parts.into_iter().filter(|part| part.as_os_str().is_empty() || self.folder.join(part).exists());
        // All of them are read before anything is written.
        let parts: Vec<_> = parts.map(|part| Ok((part, suite::load(&self.folder.join(part))?.1))).collect::<Result<_>>()?;
        keep_apart("--out", &self.out, &[Reads::Folder(&self.folder)])?;
        let packed = claim_fresh(&self.out)?;
        let mut all = Vec::new();
        for (part, records) in parts {
            let (folder, out) = (self.folder.join(part), packed.path().join(part));
            std::fs::create_dir_all(&out).with_context(|| format!("cannot create {}", out.display()))?;
            write_archive(&out.join(ARCHIVE), &records)?;
            suite::write_tables("", &records, &table::short_columns(), &out)?;
            for figure in along::FILES.iter().chain([&JOINED]).filter(|name| folder.join(name).exists()) {
                write_atomic(out.join(figure), &read(folder.join(figure))?)?;
            }
            all.extend(records);
        }
        packed.finish()?;
        let text = format!("{} in {}", counted(all.len(), "record"), self.out.display());
        show(json, &serde_json::json!({ "records": all.len(), "out": self.out }), &text)?;
        Ok(Verdict::Done)
    }
}

impl Report {
    fn run(self, json: bool) -> Result<Verdict> {
        let (plan, records) = suite::load(&self.folder)?;
        let dataset = self.verify.open_any(&plan.dataset)?.dataset;
        let _held = claim_shared(&self.folder)?;
        let written = suite::write_results(&plan, &dataset, records, &self.folder)?;
        show(json, &serde_json::json!({ "report": written.report, "table": written.table }), &written.place())?;
        Ok(Verdict::Done)
    }
}
