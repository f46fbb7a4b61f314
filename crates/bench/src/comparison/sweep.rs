//! Constants chosen on validation keyframes: one method, changes of its configuration one at a time, several datasets.
//!
//! ```text
//! OUT/DATASET/     a comparison of `corf bench run` per dataset, under the validation protocol
//! OUT/sweep.md     what each change gains, dataset by dataset and over all
//! ```

use crate::comparison::suite;
use crate::device::Backend;
use crate::experiment::plan::{Plan, PlanRow, slug};
use crate::files::escape;
use crate::files::json::read_text;
use crate::methods::merge;
use crate::metrics::input::Verify;
use crate::metrics::stats::{Summary, summarize};
use crate::record::{Numbers, Outcome, Record};
use crate::split::Protocol;
use crate::table::{Place, TOO_FEW_MARK};
use anyhow::{Context, Result, bail};
use corf_scene::io::write_atomic;
use corf_scene::words::counted;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Label of the row that the others are compared with.
const BASE: &str = "base";

/// A sweep file.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Sweep {
    /// Name of the sweep.
    pub name: String,
    /// Dataset folders, relative to the sweep file; constants that hold on one alone are no constants.
    pub datasets: Vec<PathBuf>,
    /// Seeds; every row is run with each, and differences are paired by them.
    pub seeds: Vec<u64>,
    /// Method id.
    pub method: String,
    /// Overrides of the method's configuration in every row.
    #[serde(default)]
    #[schemars(with = "serde_json::Map<String, serde_json::Value>")]
    pub base: toml::Table,
    /// One key, one row a value.
    #[serde(default)]
    pub vary: Vec<Vary>,
    /// Several keys at once, one row.
    #[serde(default)]
    pub change: Vec<Change>,
}

/// `[[vary]]`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Vary {
    /// Key of the configuration; dots lead into tables.
    pub key: String,
    /// Its values.
    #[schemars(with = "Vec<serde_json::Value>")]
    pub values: Vec<toml::Value>,
}

/// `[[change]]`.
#[derive(Clone, Debug, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Change {
    /// Label of the row.
    pub label: String,
    /// Overrides on top of the base's.
    #[schemars(with = "serde_json::Map<String, serde_json::Value>")]
    pub config: toml::Table,
    /// Another method than the sweep's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub method: Option<String>,
}

impl Sweep {
    /// Reads and checks a sweep; datasets become relative to the working directory.
    ///
    /// # Errors
    /// A file that cannot be read or parsed, nothing to compare, datasets whose folders have one name, and whatever a plan of its rows answers.
    pub fn load(path: &Path) -> Result<Self> {
        let text = read_text(path).context("cannot read the sweep")?;
        let mut sweep: Self = toml::from_str(&text).with_context(|| format!("in sweep {}", path.display()))?;
        if let Some(folder) = path.parent() {
            sweep.datasets.iter_mut().for_each(|d| *d = folder.join(&*d));
        }
        if sweep.datasets.is_empty() || sweep.vary.is_empty() && sweep.change.is_empty() {
            bail!("{}: a sweep needs at least one dataset and one [[vary]] or [[change]]", path.display());
        }
        for (i, dataset) in sweep.datasets.iter().enumerate() {
            if sweep.datasets[..i].iter().any(|d| folder_of(d) == folder_of(dataset)) {
                bail!(
                    "{}: two dataset folders are named {}\n  help: results are kept by that name",
                    path.display(),
                    folder_of(dataset)
                );
            }
        }
        sweep.plan(&sweep.datasets[0]).with_context(|| format!("in sweep {}", path.display()))?;
        Ok(sweep)
    }

    /// The comparison of one dataset.
    fn plan(&self, dataset: &Path) -> Result<Plan> {
        let row = |label: String, method: Option<&String>, changes: toml::Table| {
            let mut config = self.base.clone();
            merge(&mut config, changes);
            PlanRow::of_method(label, method.unwrap_or(&self.method).clone(), config)
        };
        let mut rows = vec![row(BASE.to_owned(), None, toml::Table::new())];
        for vary in &self.vary {
            for value in &vary.values {
                let line = format!("{} = {value}", vary.key);
                let changes = line.parse().with_context(|| format!("{line} is no TOML"))?;
                rows.push(row(line, None, changes));
            }
        }
        rows.extend(self.change.iter().map(|c| row(c.label.clone(), c.method.as_ref(), c.config.clone())));
        let plan = Plan {
            machine: None,
            name: format!("{}: {}", self.name, folder_of(dataset)),
            analysis: String::new(),
            dataset: dataset.to_owned(),
            protocol: Protocol::VALIDATION,
            segment: false,
            columns: Vec::new(),
            evaluate_every: None,
            seeds: self.seeds.clone(),
            rows,
        };
        Plan::parse(&toml::to_string(&plan)?)
    }

    /// Runs every cell that has no record yet, and writes `sweep.md`. Returns its text and all records.
    ///
    /// # Errors
    /// A dataset that cannot be read, an interrupt, or a folder that cannot be written.
    pub fn run(&self, out: &Path, verify: Verify, backend: &Backend) -> Result<(String, Vec<Record>)> {
        let mut results = Vec::new();
        for dataset in &self.datasets {
            let mut plan = self.plan(dataset)?;
            plan.dataset = std::path::absolute(dataset)?;
            let input = verify.open_any(dataset)?;
            let written = suite::run(&plan, &input, &out.join(folder_of(dataset)), backend)?;
            results.push((folder_of(dataset), written.records));
        }
        let text = self.table(&results);
        write_atomic(out.join("sweep.md"), text.as_bytes())?;
        Ok((text, results.into_iter().flat_map(|r| r.1).collect()))
    }

    /// Markdown table of each row's gains over the base row.
    fn table(&self, results: &[(String, Vec<Record>)]) -> String {
        let mut out = format!(
            "# {}\n\n{}, {}, validation keyframes. Differences to the first row in dB of light / RF (PSNR in decibels), paired by seed; the last columns \
             are over all datasets, with 95 % intervals, and ratios of Gaussians and time.\n\n| change |",
            escape::markdown(&self.name),
            self.method,
            counted(self.seeds.len(), "seed")
        );
        results.iter().for_each(|(name, _)| out.push_str(&format!(" {} |", escape::markdown(name))));
        out.push_str(" Δ light | Δ RF | Gaussians | time |\n|---|");
        out.push_str(&"---:|".repeat(results.len() + 4));
        let mut labels: Vec<&str> = Vec::new();
        for record in results.iter().flat_map(|r| &r.1) {
            if !labels.contains(&record.row.as_str()) {
                labels.push(&record.row);
            }
        }
        let (mut other_devices, mut too_few) = (0, false);
        for label in labels {
            let _ = write!(out, "\n| {} |", escape::markdown(label));
            let (mut light, mut radio, mut gaussians, mut time) = (vec![], vec![], vec![], vec![]);
            for (_, records) in results {
                let pairs = pairs(records, label);
                let of = |key: &str| -> Vec<f64> {
                    let value = |n: &Numbers| n.value_of(key);
                    let gain = |own, base| Some(value(own)? - if label == BASE { 0.0 } else { value(base)? });
                    pairs.iter().filter_map(|((_, own), (_, base))| gain(own, base)).collect()
                };
                let (l, r) = (of("psnr_opt"), of("psnr_rf_scalar"));
                let nothing = if pairs.is_empty() { "failed" } else { "–" };
                let mean = |v: &[f64]| summarize(v).map_or(nothing.to_owned(), |s| signed(s.mean, label));
                let _ = write!(out, " {} / {} |", mean(&l), mean(&r));
                light.extend(l);
                radio.extend(r);
                gaussians.extend(pairs.iter().filter_map(|((_, a), (_, b))| Some(a.gaussians? as f64 / b.gaussians? as f64)));
                let (alike, apart): (Vec<_>, Vec<_>) = pairs.iter().partition(|(own, base)| own.0 == base.0);
                time.extend(alike.iter().filter_map(|((_, a), (_, b))| Some(a.seconds? / b.seconds?)));
                other_devices += apart.len();
            }
            let ratio = |v: &[f64]| summarize(v).map_or("–".to_owned(), |s| format!("× {:.2}", s.mean));
            let gain = |v: &[f64]| summarize(v).map_or("–".to_owned(), |s| interval(s, label));
            too_few |= label != BASE && [&light, &radio].iter().any(|v| v.len() == 2);
            let _ = write!(out, " {} | {} | {} | {} |", gain(&light), gain(&radio), ratio(&gaussians), ratio(&time));
        }
        out.push('\n');
        if too_few {
            let _ = write!(out, "\n{TOO_FEW_MARK} Mean of two pairs: too few for a confidence interval.\n");
        }
        if other_devices > 0 {
            let _ = write!(
                out,
                "\n{} ran on another device than the first row's of their seed; ratios of time are without \
                 them.\n",
                counted(other_devices, "cell")
            );
        }
        out
    }
}

fn signed(value: f64, label: &str) -> String {
    if label == BASE { format!("{value:.2}") } else { format!("{value:+.2}") }
}

fn interval(s: Summary, label: &str) -> String {
    // Over datasets the base's own figures have no mean that means anything.
    if label == BASE {
        return "–".to_owned();
    }
    let mark = if s.is_of_two() { format!(" {TOO_FEW_MARK}") } else { String::new() };
    let text = s.half_width_95.map_or(format!("{:+.2}{mark}", s.mean), |h| format!("{:+.2} ± {h:.2}", s.mean));
    if s.excludes_zero() { format!("**{text}**") } else { text }
}

/// A finished cell: where it ran, and its numbers.
type Done<'a> = (Place, &'a Numbers);

/// A row's cells beside the base's of the same seed.
fn pairs<'a>(records: &'a [Record], label: &str) -> Vec<(Done<'a>, Done<'a>)> {
    let done = |row: &str, seed: Option<u64>| {
        let row = row.to_owned();
        records.iter().filter(move |r| r.row == row && seed.is_none_or(|s| r.seed == s)).filter_map(|r| match &r.outcome {
            Outcome::Done(numbers) => Some((r.seed, (Place::of(r), numbers.as_ref()))),
            Outcome::Failed { .. } => None,
        })
    };
    done(label, None).filter_map(|(seed, own)| Some((own, done(BASE, Some(seed)).next()?.1))).collect()
}

/// The name under which a dataset's results are kept.
fn folder_of(dataset: &Path) -> String {
    dataset.file_name().map_or_else(|| slug(&dataset.display().to_string()), |n| n.to_string_lossy().into_owned())
}
