//! Records to tables: Markdown, CSV and LaTeX. Rows keep the plan's order; failed cells stay in.

use crate::escape;
use crate::metrics::lpips::NO_WEIGHTS;
use crate::metrics::{COLUMNS, Column};
use crate::record::{Numbers, Outcome, Record};
use crate::split::Protocol;
use crate::stats::{Summary, summarize};
use anyhow::{Context, Result};
use std::fmt::Write;

/// The columns of the short table (terminal, README): the paper's, then the physical ones that differ most.
const SHORT: &[&str] =
    &["psnr_opt", "ssim_opt", "psnr_rf_jet", "ssim_rf_jet", "psnr_rf_scalar", "rmse_db_30", "psp_similarity", "peak_error_deg"];

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
                });
                rows.last_mut().expect("just pushed")
            }
        };
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

    /// A metric over all seeds; `None` where one of them lacks it.
    fn metric(&self, column: &Column) -> Option<Summary> {
        let values: Option<Vec<f64>> = self.done.iter().map(|(_, n)| n.means.get(column.key).copied()).collect();
        summarize(&values?)
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

/// Whether a finished cell has a metric.
fn has(numbers: &Numbers, column: &Column) -> bool {
    numbers.means.contains_key(column.key)
}

/// The columns of the short table: [`SHORT`], and where LPIPS was computed those of the first backbone.
fn short_columns(rows: &[Row<'_>]) -> Vec<&'static Column> {
    let computed = |c: &&Column| rows.iter().any(|row| row.done.iter().any(|(_, numbers)| has(numbers, c)));
    let first = COLUMNS.iter().filter(computed).find_map(Column::backbone);
    let lpips = COLUMNS.iter().filter(|c| first.is_some() && c.backbone() == first);
    SHORT.iter().filter_map(|key| column(key)).chain(lpips).collect()
}

/// The columns of everything that was computed: all but those of LPIPS that no record has.
pub fn computed_columns(records: &[Record]) -> Vec<&'static Column> {
    let computed = |c: &Column| records.iter().any(|r| matches!(&r.outcome, Outcome::Done(numbers) if has(numbers, c)));
    COLUMNS.iter().filter(|c| c.backbone().is_none() || computed(c)).collect()
}

fn note(rows: &[Row<'_>], columns: &[&Column]) -> String {
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
    let lacks = |row: &&Row<'_>| {
        let lpips = || columns.iter().filter(|c| c.backbone().is_some());
        lpips().any(|c| row.done.iter().any(|(_, numbers)| !has(numbers, c)))
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
    note
}

/// The short table without a notation: what each has to escape and to mark.
pub struct Short<'a> {
    /// Headings of all columns.
    pub headings: Vec<&'static str>,
    /// One a row.
    pub lines: Vec<Line<'a>>,
    /// Note on the number of seeds, the protocol and the caveats of the numbers.
    pub note: String,
}

/// One line of the short table.
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

/// The short table of these rows; differences are to the first.
pub fn short<'a>(rows: &'a [Row<'a>]) -> Short<'a> {
    with_columns(rows, &short_columns(rows))
}

/// The short table with the given columns of metrics.
fn with_columns<'a>(rows: &'a [Row<'a>], columns: &[&Column]) -> Short<'a> {
    let mut headings = vec!["method"];
    headings.extend(columns.iter().map(|c| c.heading));
    headings.extend(["Δ PSNR rf to first row", "Gaussians", "time, s"]);
    let line = |row: &'a Row<'a>| {
        let mut cells: Vec<String> = columns.iter().map(|c| text(row.metric(c), c.digits, "±")).collect();
        let difference = if row.label == rows[0].label { None } else { row.difference(&rows[0]) };
        let bold = difference.is_some_and(|d| d.excludes_zero()).then_some(cells.len());
        cells.push(text(difference, 2, "±"));
        cells.push(text(row.summary(|n| n.gaussians.map(|g| g as f64)), 0, "±"));
        cells.push(text(row.summary(|n| Some(n.seconds)), 1, "±"));
        Line { label: row.label, failed: !row.failed.is_empty(), cells, bold }
    };
    Short { headings, lines: rows.iter().map(line).collect(), note: note(rows, columns) }
}

/// The short table in Markdown, with a note of what it rests on. A difference to the first row is bold where its interval excludes zero.
pub fn markdown(rows: &[Row<'_>]) -> String {
    in_markdown(&short(rows))
}

/// The short table in Markdown, with the columns of these keys.
///
/// # Errors
/// A key that is no metric's.
pub fn markdown_of(rows: &[Row<'_>], keys: &[&str]) -> Result<String> {
    let named = |key: &&str| column(key).with_context(|| format!("no metric is called {key}"));
    Ok(in_markdown(&with_columns(rows, &keys.iter().map(named).collect::<Result<Vec<_>>>()?)))
}

fn in_markdown(short: &Short<'_>) -> String {
    let mut out = format!("| {} |\n|---|{}\n", short.headings.join(" | "), "---:|".repeat(short.headings.len() - 1));
    for line in &short.lines {
        let _ = write!(out, "| {}{} |", escape::markdown(line.label), if line.failed { " (failed cells)" } else { "" });
        for (i, cell) in line.cells.iter().enumerate() {
            let mark = if line.bold == Some(i) { "**" } else { "" };
            let _ = write!(out, " {mark}{cell}{mark} |");
        }
        out.push('\n');
    }
    let _ = write!(out, "\n{}\n", escape::markdown(&short.note));
    out
}

/// One line a cell, every metric, nothing aggregated.
pub fn csv(records: &[Record]) -> String {
    let mut out = String::from("row,method,dataset,dataset_hash,seed,status,seconds,gaussians,peak_memory_bytes");
    let columns = computed_columns(records);
    columns.iter().for_each(|c| out.push_str(&format!(",{}", c.key)));
    out.push_str(",peak_error_median_deg,peak_error_p90_deg,uses_ground_truth_depth,error\n");
    let optional = |v: Option<u64>| v.map(|v| v.to_string()).unwrap_or_default();
    // Ids and hashes are plain words unless a record was tampered with.
    let word = |s: &str| {
        if s.chars().all(|c| c.is_ascii_alphanumeric() || "-_".contains(c)) && !s.starts_with('-') {
            s.to_owned()
        } else {
            escape::csv(s)
        }
    };
    for r in records {
        let (row, dataset) = (escape::csv(&r.row), escape::csv(&r.dataset));
        let _ = write!(out, "{row},{},{dataset},{},{}", word(&r.method), word(&r.dataset_hash), r.seed);
        match &r.outcome {
            Outcome::Done(n) => {
                let gaussians = optional(n.gaussians.map(|g| g as u64));
                let _ = write!(out, ",done,{:.3},{gaussians},{}", n.seconds, optional(n.peak_memory_bytes));
                let value = |c: &Column| n.means.get(c.key).map_or(String::new(), |v| format!("{v:.6}"));
                columns.iter().for_each(|c| out.push_str(&format!(",{}", value(c))));
                let [median, p90] = n.peak_error_median_p90_deg;
                let _ = writeln!(out, ",{median:.6},{p90:.6},{},", r.uses_ground_truth_depth);
            }
            Outcome::Failed { error } => {
                let commas = ",".repeat(columns.len());
                let _ = writeln!(out, ",failed,,,{commas},,,{},{}", r.uses_ground_truth_depth, escape::csv(error));
            }
        }
    }
    out
}

/// The short table as a LaTeX tabular.
pub fn latex(rows: &[Row<'_>]) -> String {
    let columns = short_columns(rows);
    let mut out = format!("\\begin{{tabular}}{{l|{}}}\n  \\toprule\n  Method", "c".repeat(columns.len() + 2));
    columns.iter().for_each(|c| out.push_str(&format!(" & {}", c.latex)));
    out.push_str(" & Gaussians & Time (s) \\\\\n  \\midrule\n");
    for row in rows {
        let _ = write!(out, "  {}", escape::latex(row.label));
        columns.iter().for_each(|c| out.push_str(&format!(" & ${}$", text(row.metric(c), c.digits, r"\pm").replace('–', "-"))));
        let gaussians = row.summary(|n| n.gaussians.map(|g| g as f64));
        let seconds = row.summary(|n| Some(n.seconds));
        let cell = |s| text(s, 0, r"\pm").replace('–', "-");
        let _ = writeln!(out, " & ${}$ & ${}$ \\\\", cell(gaussians), text(seconds, 1, r"\pm").replace('–', "-"));
    }
    // A comment ends with its line.
    let _ = write!(out, "  \\bottomrule\n\\end{{tabular}}\n% {}\n", note(rows, &columns).replace(char::is_control, " "));
    out
}

/// The short table for a terminal: aligned columns, no markup.
pub fn plain(rows: &[Row<'_>]) -> String {
    let columns = short_columns(rows);
    let mut lines = vec![vec!["method".to_owned()]];
    lines[0].extend(columns.iter().map(|c| c.heading.to_owned()));
    lines[0].extend(["Gaussians".to_owned(), "time, s".to_owned()]);
    for row in rows {
        let mut line = vec![format!("{}{}", row.label, if row.failed.is_empty() { "" } else { " (FAILED)" })];
        line.extend(columns.iter().map(|c| text(row.metric(c), c.digits, "±")));
        line.push(text(row.summary(|n| n.gaussians.map(|g| g as f64)), 0, "±"));
        line.push(text(row.summary(|n| Some(n.seconds)), 1, "±"));
        lines.push(line);
    }
    let width = |column: usize| lines.iter().map(|l| l[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..lines[0].len()).map(width).collect();
    let mut out = String::new();
    for line in &lines {
        for (column, cell) in line.iter().enumerate() {
            let pad = " ".repeat(widths[column] - cell.chars().count());
            out.push_str(&if column == 0 { format!("{cell}{pad}") } else { format!("  {pad}{cell}") });
        }
        out.push('\n');
    }
    out + &note(rows, &columns) + "\n"
}

#[cfg(test)]
#[path = "table_tests.rs"]
mod tests;
