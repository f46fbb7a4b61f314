//! `corf bench plan`, `cell`, `submit` and `collect`: a comparison's cells run apart.

use super::super::{Verdict, show};
use crate::comparison::{archive, suite};
use crate::device::{Backend, DeviceChoice};
use crate::experiment::cells;
use crate::experiment::cluster::{CellList, Planned, local, slurm};
use crate::experiment::plan::Plan;
use crate::files::separation::{Reads, keep_apart};
use crate::metrics::input::Verify;
use crate::metrics::lpips::LpipsOption;
use crate::note;
use crate::record::{Outcome, Record};
use crate::run::{claim_fresh, claim_output, claim_shared};
use crate::terminal::progress::duration;
use anyhow::Result;
use clap::Args;
use corf_scene::Error;
use corf_scene::words::counted;
use serde::Serialize;
use serde_json::json;
use std::path::PathBuf;
use std::time::Duration;

/// `corf bench plan`.
#[derive(Args)]
pub struct PlanCommand {
    /// Plan file (TOML): dataset, seeds, rows.
    plan: PathBuf,
    /// Output folder; every machine that runs cells must see it under this path, and the dataset too.
    #[arg(long)]
    out: PathBuf,
    /// Write the list again beside records that are there: those of cells that are still the same count as finished.
    #[arg(long)]
    resume: bool,
    #[command(flatten)]
    verify: Verify,
    #[command(flatten)]
    lpips: LpipsOption,
}

/// What `corf bench plan` says: the list, and what is still to be done.
#[derive(Serialize)]
struct Forecast<'a> {
    #[serde(flatten)]
    list: &'a CellList,
    /// Cells to run.
    to_run: usize,
    /// Seconds that those take whose rows say `seconds`, …
    expected_s: f64,
    /// … and how many cells are in rows that do not.
    without_seconds: usize,
}

/// `corf bench cell`.
#[derive(Args)]
pub struct CellCommand {
    /// Folder of `corf bench plan`.
    folder: PathBuf,
    /// Id of the cell.
    id: String,
    #[command(flatten)]
    verify: Verify,
    /// Device that reconstructs: auto, cpu, gpu, or gpu:N for the N-th adapter.
    #[arg(long, default_value_t)]
    device: DeviceChoice,
}

/// `corf bench submit`.
#[derive(Args)]
#[command(group(clap::ArgGroup::new("where").required(true).args(["slurm", "local"])))]
pub struct Submit {
    /// Folder of `corf bench plan`.
    folder: PathBuf,
    /// Submit Slurm job arrays over the unfinished cells, as long as the cluster takes them, and a job that collects them once all have ended.
    #[arg(long)]
    slurm: bool,
    /// Run the unfinished cells here, N processes at once (one GPU each where there are several), and collect them. Each has its share of the cores,
    /// or the threads of --threads where these are fewer.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=256))]
    local: Option<u16>,
    /// With --local: time after which no cell begins and those at work are ended, seconds. Cells with a checkpoint go on from it and others begin
    /// anew when the same command is given again; exit code 1 says that some are left.
    #[arg(long, requires = "local", conflicts_with = "slurm", value_name = "SECONDS", value_parser = clap::value_parser!(u64).range(1..))]
    stop_after_s: Option<u64>,
    /// With --slurm: largest number of cells that run at once.
    #[arg(long, requires = "slurm", conflicts_with = "local", value_parser = clap::value_parser!(u32).range(1..))]
    at_once: Option<u32>,
    /// With --slurm: an option of sbatch for the arrays, as in --sbatch=--partition=gpu; may be given several times.
    #[arg(long, requires = "slurm", conflicts_with = "local", value_name = "OPTION", allow_hyphen_values = true)]
    sbatch: Vec<String>,
    #[command(flatten)]
    verify: Verify,
    /// Device that reconstructs: auto, cpu, gpu, or gpu:N for the N-th adapter.
    #[arg(long, default_value_t)]
    device: DeviceChoice,
}

/// `corf bench collect`.
#[derive(Args)]
pub struct Collect {
    /// Folder of `corf bench plan`, or an archive of `corf bench publish`.
    folder: PathBuf,
    /// Of an archive: the data set that it was made with.
    #[arg(long, value_name = "FOLDER")]
    dataset: Option<PathBuf>,
    /// Of an archive: the new folder in which records are put and tables and report are written again; exit 1 where these differ from the archive's.
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
    #[command(flatten)]
    verify: Verify,
}

impl PlanCommand {
    /// Runs the command.
    ///
    /// # Errors
    /// Bad plans, unreadable datasets, an occupied folder.
    pub fn run(self, as_json: bool) -> Result<Verdict> {
        let mut plan = Plan::load(&self.plan)?;
        keep_apart("--out", &self.out, &[Reads::Folder(&plan.dataset)])?;
        let networks = self.lpips.read(&Backend::Cpu)?;
        let input = self.verify.open_any(&plan.dataset)?.with_networks(&networks)?;
        plan.make_absolute()?;
        cells::check_rows(&plan, &input.dataset)?;
        let _held = claim_output(&self.out, self.resume)?;
        let planned = Planned::write(&plan, &input, self.lpips.absolute()?, &self.out)?;
        let unfinished = planned.unfinished()?;
        let (to_run, (expected_s, without_seconds)) =
            (unfinished.len(), plan.expected_s(unfinished.iter().map(|cell| cell.row.as_str())));
        let lines: Vec<String> = planned
            .list
            .cells
            .iter()
            .map(|cell| format!("{}  {}, seed {}, {}", cell.id, cell.row, cell.seed, cell.split.name()))
            .collect();
        let time = match (to_run, without_seconds) {
            (0, _) => String::new(),
            (to_run, unknown) if to_run == unknown => {
                "; how long they take is not known: no row of the plan says `seconds`".to_owned()
            }
            (_, unknown) => {
                let machine = plan.machine.as_deref().unwrap_or("a machine that the plan does not name");
                let others = if unknown == 0 {
                    String::new()
                } else {
                    format!(" and what {} without `seconds` take", counted(unknown, "cell"))
                };
                format!("; {} one after another on {machine}{others}", duration(expected_s))
            }
        };
        let text = format!("{}\n{}, {to_run} to run{time}", lines.join("\n"), counted(lines.len(), "cell"));
        let forecast = Forecast { list: &planned.list, to_run, expected_s, without_seconds };
        show(as_json, &forecast, &text)?;
        Ok(Verdict::Done)
    }
}

impl CellCommand {
    /// Runs the command.
    ///
    /// # Errors
    /// Those of [`Planned::run`].
    pub fn run(self, as_json: bool) -> Result<Verdict> {
        let planned = Planned::read(&self.folder)?;
        let backend = self.device.resolve()?;
        let input = planned.open(self.verify, &backend)?;
        let (record, was_there) = planned.run(&self.id, &input, &backend)?;
        let name = format!("{}, seed {}", record.row, record.seed);
        let text = match &record.outcome {
            Outcome::Done(_) if was_there => format!("{name}: already there"),
            Outcome::Done(numbers) => match numbers.seconds {
                Some(seconds) => format!("{name}: done in {seconds:.1} s"),
                None => format!("{name}: done"),
            },
            Outcome::Failed { error } => format!("{name}: FAILED: {error}"),
        };
        show(as_json, &record, &text)?;
        Ok(Verdict::of(&[record]))
    }
}

impl Submit {
    /// Runs the command.
    ///
    /// # Errors
    /// A folder without a list of cells, a scheduler that refuses, an interrupt.
    pub fn run(self, as_json: bool) -> Result<Verdict> {
        let planned = Planned::read(&self.folder)?;
        if let Some(at_once) = self.local {
            let stop_after = self.stop_after_s.map(Duration::from_secs);
            let failed = local::run(&planned, at_once.into(), self.device, !self.verify.wanted(), stop_after)?;
            let left = planned.unfinished()?.len();
            if stop_after.is_some() && left > 0 {
                let text = format!("{} of {} left: the same command goes on", left, counted(planned.list.cells.len(), "cell"));
                show(as_json, &json!({ "cells": planned.list.cells.len(), "left": left }), &text)?;
                return Ok(Verdict::CheckFailed);
            }
            let collected = Collect::of(self.folder, self.verify).run(as_json)?;
            return Ok(if failed > 0 { Verdict::CheckFailed } else { collected });
        }
        let options = slurm::SubmitOptions {
            at_once: self.at_once.map(|n| n as usize),
            device: self.device,
            no_verify: !self.verify.wanted(),
            sbatch: &self.sbatch,
        };
        match slurm::submit(&planned, &options)? {
            None => {
                note!("every cell is finished; nothing was submitted");
                Collect::of(self.folder, self.verify).run(as_json)
            }
            Some(jobs) => {
                let text = format!(
                    "{} {} of {} cells, and job {} that collects them into {}",
                    if jobs.arrays.len() == 1 { "job array" } else { "job arrays" },
                    jobs.arrays.join(", "),
                    jobs.cells,
                    jobs.collect,
                    self.folder.display()
                );
                let (arrays, collect) = (&jobs.arrays, &jobs.collect);
                show(as_json, &json!({ "array": arrays[0], "arrays": arrays, "collect": collect, "cells": jobs.cells }), &text)?;
                Ok(Verdict::Done)
            }
        }
    }
}

impl Collect {
    fn of(folder: PathBuf, verify: Verify) -> Self {
        Self { folder, dataset: None, out: None, verify }
    }

    /// Writes the results of an archive again.
    fn rebuild(&self, as_json: bool) -> Result<Verdict> {
        let (Some(dataset), Some(out)) = (&self.dataset, &self.out) else {
            let help = "give --dataset FOLDER, the data set that it was made with, and --out FOLDER, where to put it";
            return Err(
                Error::invalid(self.folder.display().to_string(), "an archive holds no data set and is no folder", help).into()
            );
        };
        keep_apart("--out", out, &[Reads::File(&self.folder), Reads::Folder(dataset)])?;
        let dataset = self.verify.open(dataset)?.dataset;
        let fresh = claim_fresh(out)?;
        let rebuilt = archive::rebuild(&self.folder, &dataset, fresh.path())?;
        fresh.finish()?;
        let same = rebuilt.differing.is_empty();
        let text = if same {
            format!(
                "{} in {}, tables and report byte for byte those of the archive",
                counted(rebuilt.records.len(), "record"),
                out.display()
            )
        } else {
            format!("{} differ from the archive, which {} wrote", rebuilt.differing.join(", "), rebuilt.written_by)
        };
        show(
            as_json,
            &json!({ "records": rebuilt.records.len(), "differing": rebuilt.differing, "written_by": rebuilt.written_by }),
            &text,
        )?;
        Ok(if same { Verdict::of(&rebuilt.records) } else { Verdict::CheckFailed })
    }

    /// Runs the command.
    ///
    /// # Errors
    /// A folder without a list of cells, or with a damaged record; an archive that is damaged.
    pub fn run(self, as_json: bool) -> Result<Verdict> {
        if self.folder.is_file() {
            return self.rebuild(as_json);
        }
        if self.dataset.is_some() || self.out.is_some() {
            let help = "leave --dataset and --out out: a folder of `corf bench plan` has both, or give an archive";
            return Err(
                Error::invalid(self.folder.display().to_string(), "it is no archive of `corf bench publish`", help).into()
            );
        }
        let planned = Planned::read(&self.folder)?;
        let input = planned.open(self.verify, &Backend::Cpu)?;
        let _held = claim_shared(&self.folder)?;
        let mut written: Option<suite::Written> = None;
        for (part, records) in planned.collect(&input)? {
            let of_part = suite::write_results(&part.plan, &input.dataset, records, &part.out)?;
            match &mut written {
                Some(whole) => whole.segment = of_part.records,
                None => written = Some(of_part),
            }
        }
        let Some(written) = written else { return Ok(Verdict::Done) };
        let text = format!("{}\n{}", written.text(), written.place());
        let all: Vec<Record> = [written.records, written.segment].concat();
        show(as_json, &all, &text)?;
        Ok(Verdict::of(&all))
    }
}
