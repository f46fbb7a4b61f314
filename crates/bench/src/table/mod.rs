//! Records to tables: Markdown, CSV and LaTeX. Rows keep the plan's order; failed cells stay in.

mod notations;
#[cfg(test)]
mod tests;

pub use notations::{csv, latex, markdown, plain, present};

use crate::metrics::lpips::NO_WEIGHTS;
use crate::metrics::{COLUMNS, Column, RADIO};
use crate::record::{Numbers, Outcome, PREDICTIONS, Record};
use crate::split::Protocol;
use crate::stats::{Summary, summarize};
use anyhow::{Result, bail};
use std::fmt::Write;

/// Columns of metrics, in their order.
pub type Columns = [&'static Column];

/// The columns of the short table (terminal, README): the paper's, then the physical ones that differ most.
const SHORT: &[&str] =
    &["psnr_opt", "ssim_opt", "psnr_rf_jet", "ssim_rf_jet", "psnr_rf_scalar", "rmse_db_30", "psp_similarity", "peak_error_deg"];

/// Mark of what the maker of predictions states and nobody here has measured.
const STATED_MARK: &str = " †";

/// The metric that ablation differences are taken of.
const DIFFERENCE_KEY: &str = "psnr_rf_jet";

/// One row: all seeds of one method with one configuration.
pub struct Row<'a> {
    /// The row's label.
    pub label: &'a str,
    /// Finished cells, by seed.
    pub done: Vec<(u64, &'a Numbers)>,
    /// Failed cells: seed and error.
    pub failed: Vec<(u64, &'a str)>,
    /// Whether any cell read ground-truth depth.
    pub uses_ground_truth_depth: bool,
    /// Evaluation protocol.
    pub protocol: Protocol,
    /// Whether any cell's dataset was not checked against its recorded hashes.
    pub unverified: bool,
    /// Whether it is predictions made elsewhere, whose time and Gaussians are as their maker states them.
    pub stated: bool,
}

/// Records grouped into rows, in order of appearance.
pub fn rows(records: &[Record]) -> Vec<Row<'_>> {
    let mut rows: Vec<Row<'_>> = Vec::new();
    for record in records {
        let row = match rows.iter_mut().position(|r| r.label == record.row) {
            Some(at) => &mut rows[at],
            None => {
                rows.push(Row {
                    label: &record.row,
                    done: Vec::new(),
                    failed: Vec::new(),
                    uses_ground_truth_depth: false,
                    protocol: record.split,
                    unverified: false,
                    stated: false,
                });
                rows.last_mut().expect("just pushed")
            }
        };
        row.stated |= record.method == PREDICTIONS;
        row.unverified |= !record.dataset_verified;
        row.uses_ground_truth_depth |= record.uses_ground_truth_depth;
        match &record.outcome {
            Outcome::Done(numbers) => row.done.push((record.seed, numbers)),
            Outcome::Failed { error } => row.failed.push((record.seed, error)),
        }
    }
    rows
}

impl Row<'_> {
    fn summary(&self, of: impl Fn(&Numbers) -> Option<f64>) -> Option<Summary> {
        summarize(&self.done.iter().filter_map(|(_, n)| of(n)).collect::<Vec<_>>())
    }

    /// A metric over all seeds; `None` where one of them lacks it, for its mean would be of another set of seeds than the rest of the row.
    fn metric(&self, column: &Column) -> Option<Summary> {
        let values: Option<Vec<f64>> = self.done.iter().map(|(_, n)| n.value(column)).collect();
        summarize(&values?)
    }

    fn gaussians(&self) -> Option<Summary> {
        self.summary(|n| n.gaussians.map(|g| g as f64))
    }

    fn seconds(&self) -> Option<Summary> {
        self.summary(|n| n.seconds)
    }

    /// A cell of time or Gaussians, marked where it is only stated.
    fn marked(&self, cell: String, mark: &str) -> String {
        if self.stated && cell != "–" { cell + mark } else { cell }
    }

    /// This row minus `reference` in PSNR_rf, paired by seed.
    fn difference(&self, reference: &Row<'_>) -> Option<Summary> {
        let value = |n: &Numbers| n.means.get(DIFFERENCE_KEY).copied();
        let pairs: Vec<f64> = self
            .done
            .iter()
            .filter_map(|(seed, mine)| {
                let (_, theirs) = reference.done.iter().find(|(s, _)| s == seed)?;
                Some(value(mine)? - value(theirs)?)
            })
            .collect();
        summarize(&pairs)
    }
}

fn text(summary: Option<Summary>, digits: usize, plus_minus: &str) -> String {
    match summary {
        None => "–".to_owned(),
        Some(Summary { mean, half_width_95: Some(h), .. }) => format!("{mean:.digits$} {plus_minus} {h:.digits$}"),
        Some(Summary { mean, .. }) => format!("{mean:.digits$}"),
    }
}

fn column(key: &str) -> Option<&'static Column> {
    COLUMNS.iter().find(|c| c.key == key)
}

/// The columns of the short table.
pub fn short_columns() -> Vec<&'static Column> {
    SHORT.iter().filter_map(|key| column(key)).collect()
}

/// The columns that these words name, each once: keys of metrics, `short` (the columns of a table that asks for none), `radio` (those that
/// tell how a spectrum serves a radio), `lpips` (those of VGG-16), `all`. No word is `short`.
///
/// # Errors
/// A word that is none of them.
pub fn columns<S: AsRef<str>>(words: &[S]) -> Result<Vec<&'static Column>> {
    if words.is_empty() {
        return Ok(short_columns());
    }
    let mut out: Vec<&'static Column> = Vec::new();
    for word in words {
        let named: Vec<&'static Column> = match word.as_ref().trim() {
            "short" => short_columns(),
            "radio" => RADIO.iter().filter_map(|key| column(key)).collect(),
            "all" => COLUMNS.iter().collect(),
            "lpips" => COLUMNS.iter().filter(|c| c.backbone() == Some("vgg")).collect(),
            key => match column(key) {
                Some(one) => vec![one],
                None => {
                    let keys: Vec<&str> = COLUMNS.iter().map(|c| c.key).collect();
                    bail!("no metric is called {key}\n  help: give short, radio, lpips, all, or keys of {}", keys.join(", "))
                }
            },
        };
        for one in named {
            if out.iter().all(|c| c.key != one.key) {
                out.push(one);
            }
        }
    }
    Ok(out)
}

fn note(rows: &[Row<'_>], columns: &Columns) -> String {
    let seeds = rows.iter().map(|r| r.done.len() + r.failed.len()).max().unwrap_or(0);
    let mut note = match seeds {
        0 | 1 => "One seed: no confidence intervals.".to_owned(),
        n => format!("Mean ± 95 % confidence interval (Student's t) over {n} seeds."),
    };
    match rows.first().map(|r| r.protocol) {
        Some(Protocol::Validation) => {
            note.push_str(" Validation keyframes; test keyframes were neither trained with nor looked at.")
        }
        Some(Protocol::Segment) => note.push_str(" A contiguous segment of the trajectory was held out."),
        Some(Protocol::Test) | None => {}
    }
    let depth: Vec<&str> = rows.iter().filter(|r| r.uses_ground_truth_depth).map(|r| r.label).collect();
    if !depth.is_empty() {
        let _ = write!(
            note,
            " The ray tracer's depth (through the simulated monocular prior, or as it is) used by: {}.",
            depth.join(", ")
        );
    }
    let unverified: Vec<&str> = rows.iter().filter(|r| r.unverified).map(|r| r.label).collect();
    if !unverified.is_empty() {
        let _ = write!(note, " Dataset files not checked against their recorded SHA-256: {}.", unverified.join(", "));
    }
    let stated: Vec<&str> = rows.iter().filter(|r| r.stated).map(|r| r.label).collect();
    if !stated.is_empty() {
        let _ = write!(
            note,
            " Predictions of other programs, scored here: {} († time and Gaussians are as their makers state them, as is what they were made \
             from).",
            stated.join(", ")
        );
    }
    let lacks = |row: &&Row<'_>| {
        let lpips = || columns.iter().filter(|c| c.backbone().is_some());
        lpips().any(|c| row.done.iter().any(|(_, numbers)| numbers.value(c).is_none()))
    };
    let without: Vec<&str> = rows.iter().filter(lacks).map(|r| r.label).collect();
    if !without.is_empty() {
        let _ = write!(note, " LPIPS not computed, for {NO_WEIGHTS}: {}.", without.join(", "));
    }
    for row in rows {
        for (seed, error) in &row.failed {
            let _ = write!(note, " FAILED: {}, seed {seed}: {error}.", row.label);
        }
    }
    for column in columns.iter().filter(|c| !SHORT.contains(&c.key)) {
        let _ = write!(note, " {}: {}.", column.heading, column.definition());
    }
    note
}

/// A table without a notation: what each has to escape and to mark.
pub struct Short<'a> {
    /// Headings of all columns.
    pub headings: Vec<&'static str>,
    /// One a row.
    pub lines: Vec<Line<'a>>,
    /// Note on the number of seeds, the protocol and the caveats of the numbers.
    pub note: String,
}

/// One line of a table.
pub struct Line<'a> {
    /// The row's label, as it was given.
    pub label: &'a str,
    /// Whether a cell of it failed.
    pub failed: bool,
    /// Numbers, as text.
    pub cells: Vec<String>,
    /// Index of the cell with a difference whose confidence interval excludes zero, to be set in bold.
    pub bold: Option<usize>,
}

/// The table of these rows with these columns of metrics; differences are to the first row.
pub fn short<'a>(rows: &'a [Row<'a>], columns: &Columns) -> Short<'a> {
    let mut headings = vec!["method"];
    headings.extend(columns.iter().map(|c| c.heading));
    headings.extend(["Δ PSNR rf to first row", "Gaussians", "time, s"]);
    let line = |row: &'a Row<'a>| {
        let mut cells: Vec<String> = columns.iter().map(|c| text(row.metric(c), c.digits, "±")).collect();
        let difference = if row.label == rows[0].label { None } else { row.difference(&rows[0]) };
        let bold = difference.is_some_and(|d| d.excludes_zero()).then_some(cells.len());
        cells.push(text(difference, 2, "±"));
        cells.push(row.marked(text(row.gaussians(), 0, "±"), STATED_MARK));
        cells.push(row.marked(text(row.seconds(), 1, "±"), STATED_MARK));
        Line { label: row.label, failed: !row.failed.is_empty(), cells, bold }
    };
    Short { headings, lines: rows.iter().map(line).collect(), note: note(rows, columns) }
}
