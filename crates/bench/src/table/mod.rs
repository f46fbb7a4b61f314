//! Records to tables: Markdown, CSV and LaTeX. Rows keep the plan's order; failed cells stay in.

mod cell;
mod columns;
mod devices;
mod marks;
mod notations;
mod note;
pub mod paper;
#[cfg(test)]
mod tests;

pub use cell::{STATED_LATEX, TOO_FEW_LATEX, TOO_FEW_MARK, TOO_FEW_NOTE, TableCell, Value, text};
pub use columns::{Columns, columns, help_of_keys, short_columns};
pub use devices::Place;
pub use marks::Mark;
pub use notations::{csv, latex, latex_footnote, markdown, plain, present, siunitx};
pub use note::note;

use crate::metrics::Column;
use crate::metrics::stats::{Summary, summarize};
use crate::record::folds::{self, Together};
use crate::record::{Numbers, PREDICTIONS, Record};
use crate::split::Protocol;
use columns::{Extra, KNOWN, PAPER_KEY, USUAL, column};
use std::borrow::Cow;

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
    /// Finished cells, by seed; those of the folds of blocks together.
    pub done: Vec<(u64, Cow<'a, Numbers>)>,
    /// Failed cells: seed and error.
    pub failed: Vec<(u64, Cow<'a, str>)>,
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
    /// Data sets of its cells, name and hash, in order of appearance.
    pub datasets: Vec<(&'a str, &'a str)>,
    /// Whether any cell's dataset was not checked against its recorded hashes.
    pub unverified: bool,
    /// Whether it is predictions made elsewhere, whose time and Gaussians are as their maker states them.
    pub stated: bool,
}

/// Records grouped into rows, in order of appearance. Cells of one label that ran on different devices are rows of their own; a
/// failed cell has no numbers that could be mixed with others, and stands in the first of them.
pub fn rows(records: &[Record]) -> Vec<Row<'_>> {
    let mut rows: Vec<Row<'_>> = Vec::new();
    for cell in folds::cells(records) {
        let (record, outcome) = (cell.of[0], cell.outcome(records));
        let place = matches!(outcome, Together::Done(_)).then(|| Place::of(record));
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
                    protocol: cell.split(records),
                    metrics: &record.protocol,
                    datasets: Vec::new(),
                    unverified: false,
                    stated: false,
                });
                rows.last_mut().expect("just pushed")
            }
        };
        row.place = row.place.take().or(place);
        for record in &cell.of {
            row.stated |= record.method == PREDICTIONS;
            let dataset = (record.dataset.as_str(), record.dataset_hash.as_str());
            if !row.datasets.contains(&dataset) {
                row.datasets.push(dataset);
            }
            row.unverified |= !record.dataset_verified;
            row.traced_depth |= record.uses_ground_truth_depth && !record.depth_imported;
            row.imported_depth |= record.depth_imported;
            row.true_scene |= record.uses_scene;
        }
        match outcome {
            Together::Done(numbers) => row.done.push((record.seed, numbers)),
            Together::Failed(error) => row.failed.push((record.seed, error)),
        }
    }
    devices::distinguish(&mut rows);
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

    /// Peak of what buffers took on the GPU, MB.
    fn device_memory_mb(&self) -> Option<Summary> {
        self.summary(|n| n.peak_device_memory_bytes.map(|bytes| bytes as f64 / 1e6))
    }

    /// Reconstruction time, seconds.
    pub fn seconds(&self) -> Option<Summary> {
        self.summary(|n| n.seconds)
    }

    /// This row minus `reference` in the paper's PSNR_rf, paired by seed.
    pub fn difference(&self, reference: &Row<'_>) -> Option<Summary> {
        self.difference_of(column(PAPER_KEY)?, reference)
    }

    /// This row minus `reference` in a metric, paired by seed.
    fn difference_of(&self, column: &Column, reference: &Row<'_>) -> Option<Summary> {
        let value = |n: &Numbers| n.value(column);
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

/// A table without a notation: what each has to escape and to mark.
pub struct Short<'a> {
    /// Headings of all columns.
    pub headings: Vec<Cow<'static, str>>,
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
    /// One a column behind the labels.
    pub cells: Vec<TableCell>,
}

/// Digits of times behind the point, of seconds.
const SECONDS_DIGITS: usize = 1;

/// The table of these rows with these columns of metrics; differences are to the first row.
pub fn short<'a>(rows: &'a [Row<'a>], columns: &Columns) -> Short<'a> {
    short_with(rows, columns, USUAL)
}

/// The same, where a notation has `usual` behind the metrics unless other columns were asked for.
fn short_with<'a>(rows: &'a [Row<'a>], columns: &Columns, usual: &[Extra]) -> Short<'a> {
    let (extras, leading) = (columns.extras(usual), columns.leading());
    let mut headings = vec![Cow::Borrowed("method")];
    headings.extend(columns.metrics.iter().map(|c| Cow::Borrowed(c.heading)));
    headings.extend(extras.iter().map(|extra| extra.heading(leading)));
    let measured = |r: &Row<'_>| if r.stated { None } else { r.seconds() };
    let of_metrics = columns.metrics.iter().map(|c| match c.higher_is_better() {
        Some(higher) => marks::marks(&rows.iter().map(|r| r.metric(c)).collect::<Vec<_>>(), c.digits, higher),
        None => vec![Mark::None; rows.len()],
    });
    // Differences follow a metric, a number of Gaussians is neither good nor bad, and what is only stated is no rival.
    let of_extras = extras.iter().map(|extra| match extra {
        Extra::Seconds => marks::marks(&rows.iter().map(measured).collect::<Vec<_>>(), SECONDS_DIGITS, false),
        _ => vec![Mark::None; rows.len()],
    });
    let marked: Vec<Vec<Mark>> = of_metrics.chain(of_extras).collect();
    let line = |(at, row): (usize, &'a Row<'a>)| {
        let of_metrics = columns.metrics.iter().map(|c| TableCell::mean(row.metric(c), c.digits));
        let of_extras = extras.iter().map(|extra| match extra {
            Extra::Difference => {
                let difference = if at == 0 { None } else { row.difference_of(leading, &rows[0]) };
                TableCell { bold: difference.is_some_and(|d| d.excludes_zero()), ..TableCell::mean(difference, 2) }
            }
            Extra::Gaussians => TableCell { stated: row.stated, ..TableCell::mean(row.gaussians(), 0) },
            Extra::Seconds => TableCell { stated: row.stated, ..TableCell::mean(row.seconds(), SECONDS_DIGITS) },
            Extra::Seeds => TableCell::count(row.done.len()),
            Extra::DeviceMemory => TableCell::mean(row.device_memory_mb(), 0),
        });
        let cells = of_metrics.chain(of_extras).zip(&marked).map(|(cell, marks)| TableCell { mark: marks[at], ..cell });
        Line { label: &row.label, failed: !row.failed.is_empty(), cells: cells.collect() }
    };
    let lines: Vec<Line<'_>> = rows.iter().enumerate().map(line).collect();
    let all: Vec<&Row<'_>> = rows.iter().collect();
    let mut note = note(&all, columns);
    if lines.iter().flat_map(|line| &line.cells).any(TableCell::is_of_two) {
        note += &format!(" {TOO_FEW_NOTE}");
    }
    Short { headings, lines, note }
}
