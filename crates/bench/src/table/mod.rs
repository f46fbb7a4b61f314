//! Records to tables: Markdown, CSV and LaTeX. Rows keep the plan's order; failed cells stay in.

mod devices;
mod marks;
mod notations;
mod note;
pub mod paper;
#[cfg(test)]
mod tests;

pub use marks::Mark;
pub use notations::{csv, latex, markdown, plain, present};
pub use note::note;

use crate::metrics::stats::{Summary, summarize};
use crate::metrics::{COLUMNS, Column, RADIO};
use crate::record::{Numbers, Outcome, PREDICTIONS, Record};
use crate::split::Protocol;
use anyhow::{Result, bail};
pub use devices::Place;
use std::borrow::Cow;

/// Columns of metrics, in their order.
pub type Columns = [&'static Column];

/// The columns of the short table (terminal, README): the paper's, then the physical ones that differ most.
const SHORT: &[&str] =
    &["psnr_opt", "ssim_opt", "psnr_rf_jet", "ssim_rf_jet", "psnr_rf_scalar", "rmse_db_30", "psp_similarity", "peak_error_deg"];

/// Mark of what the maker of predictions states and nobody here has measured.
const STATED_MARK: &str = " †";

/// The metric that ablation differences are taken of.
const DIFFERENCE_KEY: &str = "psnr_rf_jet";

/// One row: all seeds of one method with one configuration on one device.
pub struct Row<'a> {
    /// The row's label; where its cells ran on several devices, with the row's own behind it.
    pub label: Cow<'a, str>,
    /// Label of its cells' records.
    pub cells_of: &'a str,
    /// Where its finished cells ran; `None` where all failed.
    pub place: Option<Place>,
    /// Method id.
    pub method: &'a str,
    /// Resolved configuration of the method.
    pub config: &'a serde_json::Value,
    /// Finished cells, by seed.
    pub done: Vec<(u64, &'a Numbers)>,
    /// Failed cells: seed and error.
    pub failed: Vec<(u64, &'a str)>,
    /// Whether any cell read the ray tracer's depth.
    pub traced_depth: bool,
    /// Whether any cell read depth that came with an imported capture.
    pub imported_depth: bool,
    /// Whether any cell knew the true scene.
    pub true_scene: bool,
    /// Evaluation protocol.
    pub protocol: Protocol,
    /// Version of what the metrics mean.
    pub metrics: &'a str,
    /// Whether any cell's dataset was not checked against its recorded hashes.
    pub unverified: bool,
    /// Whether it is predictions made elsewhere, whose time and Gaussians are as their maker states them.
    pub stated: bool,
}

/// Records grouped into rows, in order of appearance. Cells of one label that ran on different devices are rows of their own; a
/// failed cell has no numbers that could be mixed with others, and stands in the first of them.
pub fn rows(records: &[Record]) -> Vec<Row<'_>> {
    let mut rows: Vec<Row<'_>> = Vec::new();
    for record in records {
        let place = matches!(record.outcome, Outcome::Done(_)).then(|| Place::of(record));
        let fits = |row: &Row<'_>| row.cells_of == record.row && (row.place == place || row.place.is_none() || place.is_none());
        let row = match rows.iter().position(fits) {
            Some(at) => &mut rows[at],
            None => {
                rows.push(Row {
                    label: Cow::Borrowed(&record.row),
                    cells_of: &record.row,
                    place: None,
                    method: &record.method,
                    config: &record.config,
                    done: Vec::new(),
                    failed: Vec::new(),
                    traced_depth: false,
                    imported_depth: false,
                    true_scene: false,
                    protocol: record.split,
                    metrics: &record.protocol,
                    unverified: false,
                    stated: false,
                });
                rows.last_mut().expect("just pushed")
            }
        };
        row.place = row.place.take().or(place);
        row.stated |= record.method == PREDICTIONS;
        row.unverified |= !record.dataset_verified;
        row.traced_depth |= record.uses_ground_truth_depth && !record.depth_imported;
        row.imported_depth |= record.depth_imported;
        row.true_scene |= record.uses_scene;
        match &record.outcome {
            Outcome::Done(numbers) => row.done.push((record.seed, numbers)),
            Outcome::Failed { error } => row.failed.push((record.seed, error)),
        }
    }
    devices::tell_apart(&mut rows);
    rows
}

impl Row<'_> {
    /// Mean and interval of a number over the finished cells that have it; `None` where none has.
    pub fn summary(&self, of: impl Fn(&Numbers) -> Option<f64>) -> Option<Summary> {
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

    /// Reconstruction time, seconds.
    pub fn seconds(&self) -> Option<Summary> {
        self.summary(|n| n.seconds)
    }

    /// A cell of time or Gaussians, marked where it is only stated.
    fn marked(&self, cell: String, mark: &str) -> String {
        if self.stated && cell != "–" { cell + mark } else { cell }
    }

    /// This row minus `reference` in PSNR_rf, paired by seed.
    pub fn difference(&self, reference: &Row<'_>) -> Option<Summary> {
        let value = |n: &Numbers| n.value_of(DIFFERENCE_KEY);
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

/// A mean with its interval, where it has one, as text; a dash without a mean.
pub fn text(summary: Option<Summary>, digits: usize, plus_minus: &str) -> String {
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
    /// Marks of the cells; only metrics and measured times have any.
    pub marks: Vec<Mark>,
}

/// The table of these rows with these columns of metrics; differences are to the first row.
pub fn short<'a>(rows: &'a [Row<'a>], columns: &Columns) -> Short<'a> {
    let mut headings = vec!["method"];
    headings.extend(columns.iter().map(|c| c.heading));
    headings.extend(["Δ PSNR rf to first row", "Gaussians", "time, s"]);
    let mut marked: Vec<Vec<Mark>> = columns
        .iter()
        .map(|c| match c.higher_is_better() {
            Some(higher) => marks::marks(&rows.iter().map(|r| r.metric(c)).collect::<Vec<_>>(), higher),
            None => vec![Mark::None; rows.len()],
        })
        .collect();
    // Differences follow a metric, a number of Gaussians is neither good nor bad, and what is only stated is no rival.
    marked.extend([vec![Mark::None; rows.len()], vec![Mark::None; rows.len()]]);
    let measured = |r: &Row<'_>| if r.stated { None } else { r.seconds() };
    marked.push(marks::marks(&rows.iter().map(measured).collect::<Vec<_>>(), false));
    let line = |(at, row): (usize, &'a Row<'a>)| {
        let mut cells: Vec<String> = columns.iter().map(|c| text(row.metric(c), c.digits, "±")).collect();
        let difference = if at == 0 { None } else { row.difference(&rows[0]) };
        let bold = difference.is_some_and(|d| d.excludes_zero()).then_some(cells.len());
        cells.push(text(difference, 2, "±"));
        cells.push(row.marked(text(row.gaussians(), 0, "±"), STATED_MARK));
        cells.push(row.marked(text(row.seconds(), 1, "±"), STATED_MARK));
        Line { label: &row.label, failed: !row.failed.is_empty(), cells, bold, marks: marked.iter().map(|m| m[at]).collect() }
    };
    let all: Vec<&Row<'_>> = rows.iter().collect();
    Short { headings, lines: rows.iter().enumerate().map(line).collect(), note: note(&all, columns) }
}
