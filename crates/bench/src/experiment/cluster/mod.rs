//! Cells of a comparison as units of work of their own: listed, named by a hash of all they depend on, run one by one on any machine that
//! sees the folder, and collected into tables.
//!
//! ```text
//! OUT/cells.json         the list: id, row, seed and protocol of every cell
//! OUT/work/ID/           lock and checkpoint of a cell while it runs
//! OUT/logs/              what cells said while they ran
//! OUT/slurm/             job scripts and the lists of ids they run
//! ```
//! Everything else is as [`crate::comparison::suite`] lays it out.

pub mod local;
pub mod slurm;

use crate::comparison::suite;
use crate::device::Backend;
use crate::experiment::cells::{self, Part};
use crate::experiment::plan::{Cell, Plan};
use crate::files::json::{read_json, write_numbers};
use crate::metrics::input::{Input, Verify};
use crate::metrics::lpips::LpipsOption;
use crate::record::comparability::{self, Joined};
use crate::record::provenance::Provenance;
use crate::record::{Outcome, Record};
use crate::split::{Protocol, Split};
use anyhow::{Context, Result, bail};
use corf_scene::io::sha256_hex;
use corf_scene::lock::FolderLock;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Version of `cells.json`.
const SCHEMA: &str = "corf-cells/2";
/// File of the list of cells.
const LIST: &str = "cells.json";
/// Hexadecimal digits of a cell's id, of its SHA-256.
const ID_DIGITS: usize = 16;

/// All cells of a planned comparison.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct CellList {
    /// Version of the layout, `corf-cells/2`.
    schema: String,
    /// Hash of the dataset.
    dataset_hash: String,
    /// Which LPIPS is computed.
    lpips: LpipsOption,
    /// Cells in the order in which they are run: every row with the first seed, then with the second; those of the contiguous segment last.
    pub cells: Vec<ListedCell>,
}

/// A cell of a list.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ListedCell {
    /// Hash of all that the cell's numbers depend on: dataset, protocol, method with its resolved configuration, seed, and program.
    pub id: String,
    /// Label of the row.
    pub row: String,
    /// Seed.
    pub seed: u64,
    /// Evaluation protocol.
    pub split: Protocol,
}

/// A planned comparison in its folder.
pub struct Planned {
    /// Folder of the comparison.
    pub out: PathBuf,
    /// Parts of the plan, one a protocol.
    parts: Vec<Part>,
    /// The list of its cells.
    pub list: CellList,
}

/// Names cells: all that their numbers depend on and that is the same for every one of them.
struct Namer<'a> {
    input: &'a Input,
    shared: serde_json::Value,
}

impl<'a> Namer<'a> {
    fn new(input: &'a Input) -> Result<Self> {
        let program = Provenance::here();
        let shared = serde_json::json!({
            "schema": SCHEMA,
            "dataset": input.dataset.hash(),
            "lpips": input.networks.sha256(),
            "version": program.version,
            "commit": program.commit,
            "lockfile": program.lockfile_sha256,
            // Of sources that differ from their commit only the program itself tells which they are.
            "program": program.dirty.then(own_hash).transpose()?,
        });
        Ok(Self { input, shared })
    }

    /// Id of a cell, with its method's resolved configuration.
    fn id_of(&self, cell: Cell<'_>) -> Result<String> {
        let dataset = &self.input.dataset;
        let (method, config) = cells::settings_of(cell, &Split::of(dataset, cell.split)?, dataset)?;
        let own = serde_json::json!({
            "split": cell.split,
            "row": cell.row.label,
            "method": method,
            "config": config,
            "seed": cell.seed,
        });
        Ok(sha256_hex(serde_json::json!([self.shared, own]).to_string().as_bytes())[..ID_DIGITS].to_owned())
    }
}

/// SHA-256 of this executable.
fn own_hash() -> Result<String> {
    let path = std::env::current_exe().context("the path of this program is not known")?;
    Ok(sha256_hex(&std::fs::read(&path).with_context(|| format!("cannot read {}", path.display()))?))
}

impl CellList {
    /// The list of a plan's cells on a dataset, as this program would run them.
    fn of(parts: &[Part], input: &Input, lpips: LpipsOption) -> Result<Self> {
        let namer = Namer::new(input)?;
        let mut cells = Vec::new();
        for Part { plan, .. } in parts {
            for (_, cell) in plan.interleaved() {
                let id = namer.id_of(cell)?;
                cells.push(ListedCell { id, row: cell.row.label.clone(), seed: cell.seed, split: cell.split });
            }
        }
        Ok(Self { schema: SCHEMA.to_owned(), dataset_hash: input.dataset.hash().to_owned(), lpips, cells })
    }
}

impl Planned {
    /// Writes a plan and the list of its cells into a folder. Records that are there stay; those of cells that are in the list no more are
    /// not read again.
    ///
    /// # Errors
    /// A row that cannot run, or a folder that cannot be written.
    pub fn write(plan: &Plan, input: &Input, lpips: LpipsOption, out: &Path) -> Result<Self> {
        let parts = suite::parts(plan, out);
        let list = CellList::of(&parts, input, lpips)?;
        parts.iter().try_for_each(Part::write_plan)?;
        write_numbers(&out.join(LIST), &list)?;
        Ok(Self { out: out.to_owned(), parts, list })
    }

    /// Reads a folder that [`Self::write`] wrote.
    ///
    /// # Errors
    /// A folder without a list of cells, or with a damaged one.
    pub fn read(out: &Path) -> Result<Self> {
        let path = out.join(LIST);
        if !path.exists() {
            bail!(
                "{} has no list of cells\n  help: write one with `corf bench plan PLAN.toml --out {}`",
                out.display(),
                out.display()
            );
        }
        let list: CellList = read_json(&path)?;
        if list.schema != SCHEMA {
            bail!(
                "{} is of the layout {}, not {SCHEMA}\n  help: write it again with `corf bench plan`",
                path.display(),
                list.schema
            );
        }
        let plan = suite::load_plan(out)?;
        Ok(Self { out: out.to_owned(), parts: suite::parts(&plan, out), list })
    }

    /// Name of the comparison.
    pub fn name(&self) -> &str {
        &self.parts[0].plan.name
    }

    /// Opens the dataset, with the networks of LPIPS that cells are evaluated with, on a device.
    ///
    /// # Errors
    /// A dataset or weights that cannot be read.
    pub fn open(&self, verify: Verify, backend: &Backend) -> Result<Input> {
        verify.open_any(self.dataset())?.with_networks(&self.list.lpips.networks(backend)?)
    }

    /// Path of the dataset.
    fn dataset(&self) -> &Path {
        &self.parts[0].plan.dataset
    }

    /// A cell and the part of the plan it belongs to.
    fn find(&self, listed: &ListedCell) -> Option<(&Part, Cell<'_>)> {
        let part = self.parts.iter().find(|part| part.plan.protocol.folds().contains(&listed.split))?;
        let cell = part
            .plan
            .cells()
            .find(|cell| (cell.row.label.as_str(), cell.seed, cell.split) == (listed.row.as_str(), listed.seed, listed.split))?;
        Some((part, cell))
    }

    /// The record of a cell, if it is there, finished or failed.
    ///
    /// # Errors
    /// A damaged record.
    fn record(&self, listed: &ListedCell) -> Result<Option<Record>> {
        let Some((part, cell)) = self.find(listed) else { return Ok(None) };
        let path = part.record_path(cell);
        if !path.exists() {
            return Ok(None);
        }
        let record = cells::read_record(&path, cell)?;
        Ok((record.cell.as_ref() == Some(&listed.id)).then_some(record))
    }

    /// The record of a cell, if it is there and finished.
    ///
    /// # Errors
    /// A damaged record.
    fn finished(&self, listed: &ListedCell) -> Result<Option<Record>> {
        Ok(self.record(listed)?.filter(|record| matches!(record.outcome, Outcome::Done(_))))
    }

    /// The cells without a finished record.
    ///
    /// # Errors
    /// A damaged record.
    pub fn unfinished(&self) -> Result<Vec<&ListedCell>> {
        let mut unfinished = Vec::new();
        for cell in &self.list.cells {
            if self.finished(cell)?.is_none() {
                unfinished.push(cell);
            }
        }
        Ok(unfinished)
    }

    /// Runs the cell of an id unless its record is there; the answer says whether it was.
    ///
    /// # Errors
    /// An id that is not in the list, or that is another with this program, dataset or plan; another process that runs the cell; an
    /// interrupt, after which the same command goes on.
    pub fn run(&self, id: &str, input: &Input, backend: &Backend) -> Result<(Record, bool)> {
        let again = format!("write the list again with `corf bench plan PLAN.toml --out {} --resume`", self.out.display());
        let Some(listed) = self.list.cells.iter().find(|cell| cell.id == id) else {
            bail!("{} has no cell {id}\n  help: {} lists them; {again}", self.out.display(), self.out.join(LIST).display());
        };
        let (part, cell) = self.find(listed).with_context(|| format!("cell {id} is not in the plan\n  help: {again}"))?;
        let now = Namer::new(input)?.id_of(cell)?;
        if now != id {
            bail!(
                "cell {id} would be {now} today: the dataset, the plan or this program is another than when the list was written\n  \
                 help: {again}"
            );
        }
        let work = self.out.join("work").join(id);
        let _held = FolderLock::make(&work).with_context(|| format!("cell {id}"))?;
        if let Some(record) = self.finished(listed)? {
            return Ok((record, true));
        }
        let mut record = part.run_cell(cell, input, backend, Some(&work))?;
        record.cell = Some(id.to_owned());
        record.write(&part.record_path(cell))?;
        Ok((record, false))
    }

    /// Records of all cells, in the plan's order, by part; a cell without one is a failed cell that says so.
    ///
    /// # Errors
    /// A damaged record, records that may not stand in one table, or a row that cannot run.
    pub fn collect(&self, input: &Input) -> Result<Vec<(&Part, Vec<Record>)>> {
        let of_part = |part: &Part| -> Result<Vec<Record>> {
            let cells: Vec<_> =
                self.list.cells.iter().filter(|listed| part.plan.protocol.folds().contains(&listed.split)).collect();
            let records: Vec<Record> = cells.iter().map(|listed| self.record_or_failure(listed, input)).collect::<Result<_>>()?;
            let place = |at: usize| format!("cell {}", cells[at].id);
            comparability::check(&records, &place, &Joined::default())?;
            Ok(records)
        };
        self.parts.iter().map(|part| Ok((part, of_part(part)?))).collect()
    }

    fn record_or_failure(&self, listed: &ListedCell, input: &Input) -> Result<Record> {
        if let Some(record) = self.record(listed)? {
            return Ok(record);
        }
        let (part, cell) = self.find(listed).with_context(|| format!("cell {} is not in the plan", listed.id))?;
        let error = format!("no record of cell {}: it has not run, or was ended while it did", listed.id);
        part.failed(cell, input, error)
    }
}
