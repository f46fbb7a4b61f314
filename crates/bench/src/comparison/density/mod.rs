//! A comparison on thinner and thinner training keyframes, the held-out ones staying the same: where does a learned field overtake copying?
//!
//! ```text
//! OUT/spacing-N/         the comparison with one of N neighbouring keyframes, as `corf bench run` leaves it
//! OUT/density.json       steps, values and places, all numbers
//! OUT/density.csv        a value a line
//! OUT/density.md         the places, and a table a metric
//! OUT/density.svg        metrics over the distance to the nearest training pose
//! ```

mod chart;
mod overtaking;
mod tables;

use crate::comparison::suite;
use crate::device::Backend;
use crate::experiment::cells::check_rows;
use crate::experiment::plan::{Plan, RowKind};
use crate::files::json::write_numbers;
use crate::methods::abilities;
use crate::metrics::input::Input;
use crate::metrics::stats::{quantile, summarize};
use crate::metrics::{COLUMNS, Column};
use crate::record::{Outcome, Record, folds};
use crate::split::{Protocol, Split};
use anyhow::{Context, Result, ensure};
use corf_scene::dataset::Dataset;
use corf_scene::io::write_atomic;
use serde::Serialize;
use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

pub use overtaking::{Overtaking, OvertakingPlace};

/// Version of `density.json`.
const SCHEMA: &str = "corf-density/2";

/// What is compared: a plan, how it is thinned, and by which metrics.
pub struct Density {
    plan: Plan,
    spacings: Vec<NonZeroUsize>,
    metrics: Vec<&'static Column>,
}

/// `density.json`.
#[derive(Debug, Serialize)]
pub struct Results {
    schema: &'static str,
    name: String,
    dataset: String,
    dataset_hash: String,
    protocol: Protocol,
    /// Keys of the metrics.
    metrics: Vec<&'static str>,
    /// From dense to sparse.
    pub steps: Vec<DensityStep>,
    /// Of every metric, every learned row against copying and against every lookup.
    pub overtaking: Vec<Overtaking>,
}

/// One thinning.
#[derive(Debug, Serialize)]
pub struct DensityStep {
    /// Of so many neighbouring keyframes one trained.
    pub spacing: usize,
    /// Training keyframes; over the folds their mean.
    pub train_keyframes: f64,
    /// Median, over held-out keyframes, of the distance to the nearest training pose, metres.
    pub nearest_training_m: f64,
    /// Its 10th and 90th percentile, metres.
    pub nearest_training_p10_p90_m: [f64; 2],
    /// All rows in the plan's order.
    pub rows: Vec<StepRow>,
}

/// A row of a step.
#[derive(Debug, Serialize)]
pub struct StepRow {
    /// Label.
    pub row: String,
    /// Method id.
    pub method: String,
    /// Whether it looks keyframes up instead of learning from them.
    pub looks_up: bool,
    /// One a seed.
    pub seeds: Vec<StepSeed>,
}

/// A seed of a row of a step.
#[derive(Debug, Serialize)]
pub struct StepSeed {
    /// The seed.
    pub seed: u64,
    /// Values of the metrics by key; none where the cell failed.
    pub values: BTreeMap<&'static str, f64>,
}

impl StepRow {
    /// A metric of a seed.
    fn value(&self, metric: &str, seed: u64) -> Option<f64> {
        self.seeds.iter().find(|s| s.seed == seed)?.values.get(metric).copied()
    }

    /// A metric of all finished seeds.
    fn values(&self, metric: &str) -> Vec<f64> {
        self.seeds.iter().filter_map(|s| s.values.get(metric).copied()).collect()
    }
}

impl Density {
    /// A plan with one of so many neighbouring keyframes, for each of `spacings`; without metrics those of what the data set has.
    ///
    /// # Errors
    /// No lookup or no learned row, predictions, a plan that is thinned already, a metric that is unknown or says nothing about which way is better.
    pub fn new(plan: Plan, spacings: &[NonZeroUsize], metrics: &[String], dataset: &Dataset) -> Result<Self> {
        let mut spacings = spacings.to_vec();
        spacings.sort();
        spacings.dedup();
        ensure!(
            plan.protocol.spacing.get() == 1,
            "the plan's protocol is thinned already ({})\n  help: leave spacing out of it; --spacing says how it is thinned",
            plan.protocol
        );
        ensure!(
            !plan.segment,
            "segment = true: the segment is one more comparison\n  help: give a plan with protocol = \"segment\""
        );
        let looks_up = |row: &&crate::experiment::plan::PlanRow| abilities(&row.method).looks_up;
        if let Some(row) = plan.rows.iter().find(|row| row.kind == RowKind::Predictions) {
            anyhow::bail!("row \"{}\" is of predictions, which cannot be trained again\n  help: leave it out", row.label);
        }
        ensure!(
            plan.rows.iter().any(|row| looks_up(&row)) && !plan.rows.iter().all(|row| looks_up(&row)),
            "a field is compared with copying\n  help: give the plan a row of nearest or inverse-distance, and one of another method"
        );
        let has = dataset.modalities();
        let usual = [("psnr_rf_scalar", has.radio), ("psnr_opt", has.light)];
        let keys: Vec<&str> = match metrics {
            [] => usual.iter().filter(|(_, there)| *there).map(|(key, _)| *key).collect(),
            given => given.iter().map(String::as_str).collect(),
        };
        let metric = |key: &&str| {
            let column = COLUMNS.iter().find(|column| column.key == *key && column.higher_is_better().is_some());
            column.with_context(|| format!("--metric {key}: it is no metric\n  help: `corf bench table --help` lists the keys"))
        };
        let metrics = keys.iter().map(metric).collect::<Result<_>>()?;
        let density = Self { plan, spacings, metrics };
        density.steps(Path::new("")).iter().try_for_each(|(_, plan, _)| check_rows(plan, dataset))?;
        Ok(density)
    }

    /// The thinned plans and their folders.
    fn steps(&self, out: &Path) -> Vec<(usize, Plan, PathBuf)> {
        let step = |spacing: &NonZeroUsize| {
            let (name, protocol) = (format!("{}, one of {spacing}", self.plan.name), self.plan.protocol.thinned(*spacing));
            (spacing.get(), Plan { name, protocol, ..self.plan.clone() }, out.join(format!("spacing-{spacing}")))
        };
        self.spacings.iter().map(step).collect()
    }

    /// Runs all cells that have no record yet, and writes the files. The answer is the results, the text for a terminal, and all records.
    ///
    /// # Errors
    /// Those of [`suite::run`].
    pub fn run(&self, input: &Input, out: &Path, backend: &Backend) -> Result<(Results, String, Vec<Record>)> {
        let (mut steps, mut all) = (Vec::new(), Vec::new());
        for (spacing, plan, folder) in self.steps(out) {
            let records = suite::run(&plan, input, &folder, backend)?.records;
            steps.push(self.step(spacing, plan.protocol, &records, &input.dataset)?);
            all.extend(records);
        }
        let dataset = &input.dataset;
        let results = Results {
            schema: SCHEMA,
            name: self.plan.name.clone(),
            dataset: dataset.header().name.clone(),
            dataset_hash: dataset.hash().to_owned(),
            protocol: self.plan.protocol,
            metrics: self.metrics.iter().map(|column| column.key).collect(),
            overtaking: overtaking::all(&steps, &self.metrics),
            steps,
        };
        let text = tables::text(&results, &self.metrics);
        write_atomic(out.join("density.svg"), chart::svg(&results, &self.metrics)?.as_bytes())?;
        write_atomic(out.join("density.csv"), tables::csv(&results).as_bytes())?;
        write_atomic(out.join("density.md"), text.as_bytes())?;
        write_numbers(&out.join("density.json"), &results)?;
        Ok((results, text, all))
    }

    fn step(&self, spacing: usize, protocol: Protocol, records: &[Record], dataset: &Dataset) -> Result<DensityStep> {
        let splits: Vec<Split> = protocol.folds().into_iter().map(|fold| Split::of(dataset, fold)).collect::<Result<_>>()?;
        let mut distances: Vec<f64> = splits.iter().flat_map(|split| split.nearest_training_m(dataset)).collect();
        distances.sort_by(f64::total_cmp);
        let mut rows: Vec<StepRow> = Vec::new();
        for record in folds::together(records).iter() {
            let value = |column: &&'static Column| match &record.outcome {
                Outcome::Done(numbers) => Some((column.key, numbers.value(column)?)),
                Outcome::Failed { .. } => None,
            };
            let seed = StepSeed { seed: record.seed, values: self.metrics.iter().filter_map(value).collect() };
            match rows.iter_mut().find(|row| row.row == record.row) {
                Some(row) => row.seeds.push(seed),
                None => rows.push(StepRow {
                    row: record.row.clone(),
                    method: record.method.clone(),
                    looks_up: abilities(&record.method).looks_up,
                    seeds: vec![seed],
                }),
            }
        }
        Ok(DensityStep {
            spacing,
            train_keyframes: summarize(&splits.iter().map(|s| s.train.len() as f64).collect::<Vec<_>>()).map_or(0.0, |s| s.mean),
            nearest_training_m: quantile(&distances, 0.5),
            nearest_training_p10_p90_m: [0.1, 0.9].map(|q| quantile(&distances, q)),
            rows,
        })
    }
}
