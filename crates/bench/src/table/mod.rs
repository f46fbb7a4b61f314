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

/// Columns of a table: metrics, and behind them what else there is of a row.
#[derive(Clone, Debug)]
pub struct Columns {
    /// Metrics, in their order.
    pub metrics: Vec<&'static Column>,
    /// What stands behind them; `None` where nobody asked, and each notation has what it usually has.
    extras: Option<Vec<Extra>>,
}

/// A column that is no metric.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Extra {
    /// Difference to the first row, paired by seed.
    Difference,
    Gaussians,
    /// Time of the reconstruction.
    Seconds,
    Seeds,
}

impl Extra {
    /// All of them by the words that name them.
    const ALL: [(&'static str, Self); 4] =
        [("delta", Self::Difference), ("gaussians", Self::Gaussians), ("time", Self::Seconds), ("seeds", Self::Seeds)];

    fn of(word: &str) -> Option<Self> {
        Self::ALL.iter().find(|(name, _)| *name == word).map(|(_, extra)| *extra)
    }
}

impl Columns {
    /// No column of metrics.
    fn none() -> Self {
        Self { metrics: Vec::new(), extras: None }
    }

    /// What stands behind the metrics in a notation that usually has `usual` there.
    fn extras(&self, usual: &[Extra]) -> Vec<Extra> {
        self.extras.clone().unwrap_or_else(|| usual.to_vec())
    }

    /// The metric that differences are taken of: that of spectra which leads, where there is none the first.
    fn leading(&self) -> &'static Column {
        let of_spectra = self.metrics.iter().find(|c| c.key.starts_with("psnr_rf"));
        let known = || column(DIFFERENCE_KEY).expect("it is one of the columns");
        of_spectra.or_else(|| self.metrics.first()).copied().unwrap_or_else(known)
    }
}

/// The columns of the short table (terminal, README): the paper's, then the physical ones that differ most.
const SHORT: &[&str] =
    &["psnr_opt", "ssim_opt", "psnr_rf_jet", "ssim_rf_jet", "psnr_rf_scalar", "rmse_db_30", "psp_similarity", "peak_error_deg"];

/// What usually stands behind the metrics; text and LaTeX have no differences unless asked.
const USUAL: &[Extra] = &[Extra::Difference, Extra::Gaussians, Extra::Seconds];

/// Mark of what the maker of predictions states and nobody here has measured.
const STATED_MARK: &str = " †";

/// The metric that the paper's differences are taken of.
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

    /// Reconstruction time, seconds.
    pub fn seconds(&self) -> Option<Summary> {
        self.summary(|n| n.seconds)
    }

    /// A cell of time or Gaussians, marked where it is only stated.
    fn marked(&self, cell: String, mark: &str) -> String {
        if self.stated && cell != "–" { cell + mark } else { cell }
    }

    /// This row minus `reference` in the paper's PSNR_rf, paired by seed.
    pub fn difference(&self, reference: &Row<'_>) -> Option<Summary> {
        self.difference_of(column(DIFFERENCE_KEY)?, reference)
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
pub fn short_columns() -> Columns {
    Columns { metrics: of_short(), extras: None }
}

fn of_short() -> Vec<&'static Column> {
    SHORT.iter().filter_map(|key| column(key)).collect()
}

/// The columns that these words name, each once: keys of metrics, `short` (the columns of a table that asks for none), `radio` (those that
/// tell how a spectrum serves a radio), `lpips` (those of VGG-16), `all`; `delta` (the difference to the first row in the leading metric),
/// `gaussians`, `time` and `seeds`, which stand behind the metrics and are there as usual where none of them is named. A word with a minus before
/// it leaves its column out. Without a metric those of `short`.
///
/// # Errors
/// A word that is none of them.
pub fn columns<S: AsRef<str>>(words: &[S]) -> Result<Columns> {
    let words: Vec<&str> = words.iter().map(|word| word.as_ref().trim()).collect();
    let (left_out, wanted): (Vec<&str>, Vec<&str>) = words.iter().partition(|word| word.starts_with('-'));
    let mut extras: Vec<Extra> = wanted.iter().filter_map(|word| Extra::of(word)).collect();
    let metrics: Vec<&str> = wanted.into_iter().filter(|word| Extra::of(word).is_none()).collect();
    let mut metrics = if metrics.is_empty() { of_short() } else { metrics_of(&metrics)? };
    let mut chosen = !extras.is_empty();
    for word in left_out.iter().map(|word| &word[1..]) {
        match Extra::of(word) {
            Some(extra) => {
                if !chosen {
                    extras = USUAL.to_vec();
                }
                chosen = true;
                extras.retain(|other| *other != extra);
            }
            None => {
                let out = metrics_of(&[word])?;
                metrics.retain(|c| out.iter().all(|other| other.key != c.key));
            }
        }
    }
    Ok(Columns { metrics, extras: chosen.then_some(extras) })
}

/// The metrics that these words name, each once.
fn metrics_of(words: &[&str]) -> Result<Vec<&'static Column>> {
    let mut out: Vec<&'static Column> = Vec::new();
    for word in words {
        let named: Vec<&'static Column> = match *word {
            "short" => of_short(),
            "radio" => RADIO.iter().filter_map(|key| column(key)).collect(),
            "all" => COLUMNS.iter().collect(),
            "lpips" => COLUMNS.iter().filter(|c| c.backbone() == Some("vgg")).collect(),
            key => match column(key) {
                Some(one) => vec![one],
                None => {
                    let keys: Vec<&str> = COLUMNS.iter().map(|c| c.key).collect();
                    let others = ["short", "radio", "lpips", "all", "delta", "gaussians", "time", "seeds"];
                    let meant =
                        nearest(key, keys.iter().chain(&others)).map_or(String::new(), |near| format!("; did you mean {near}?"));
                    bail!("no column is called {key}{meant}\n  help: give {}, or keys of {}", others.join(", "), keys.join(", "))
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

/// The word that is most like a misspelt one, where any is.
fn nearest<'w>(word: &str, known: impl Iterator<Item = &'w &'static str>) -> Option<&'static str> {
    let alike = known.map(|candidate| (strsim::jaro_winkler(word, candidate), *candidate));
    alike.filter(|(likeness, _)| *likeness > 0.8).max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, candidate)| candidate)
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
    /// Numbers, as text.
    pub cells: Vec<String>,
    /// Index of the cell with a difference whose confidence interval excludes zero, to be set in bold.
    pub bold: Option<usize>,
    /// Marks of the cells; only metrics and measured times have any.
    pub marks: Vec<Mark>,
}

/// The table of these rows with these columns of metrics; differences are to the first row.
pub fn short<'a>(rows: &'a [Row<'a>], columns: &Columns) -> Short<'a> {
    let (extras, leading) = (columns.extras(USUAL), columns.leading());
    let mut headings = vec![Cow::Borrowed("method")];
    headings.extend(columns.metrics.iter().map(|c| Cow::Borrowed(c.heading)));
    headings.extend(extras.iter().map(|extra| match extra {
        Extra::Difference if leading.key == DIFFERENCE_KEY => Cow::Borrowed("Δ PSNR rf to first row"),
        Extra::Difference => Cow::Owned(format!("Δ {} to first row", leading.heading.trim_end_matches([' ', '↑', '↓']))),
        Extra::Gaussians => Cow::Borrowed("Gaussians"),
        Extra::Seconds => Cow::Borrowed("time, s"),
        Extra::Seeds => Cow::Borrowed("seeds"),
    }));
    let measured = |r: &Row<'_>| if r.stated { None } else { r.seconds() };
    let of_metrics = columns.metrics.iter().map(|c| match c.higher_is_better() {
        Some(higher) => marks::marks(&rows.iter().map(|r| r.metric(c)).collect::<Vec<_>>(), higher),
        None => vec![Mark::None; rows.len()],
    });
    // Differences follow a metric, a number of Gaussians is neither good nor bad, and what is only stated is no rival.
    let of_extras = extras.iter().map(|extra| match extra {
        Extra::Seconds => marks::marks(&rows.iter().map(measured).collect::<Vec<_>>(), false),
        _ => vec![Mark::None; rows.len()],
    });
    let marked: Vec<Vec<Mark>> = of_metrics.chain(of_extras).collect();
    let line = |(at, row): (usize, &'a Row<'a>)| {
        let mut cells: Vec<String> = columns.metrics.iter().map(|c| text(row.metric(c), c.digits, "±")).collect();
        let mut bold = None;
        for extra in &extras {
            let cell = match extra {
                Extra::Difference => {
                    let difference = if at == 0 { None } else { row.difference_of(leading, &rows[0]) };
                    bold = difference.is_some_and(|d| d.excludes_zero()).then_some(cells.len());
                    text(difference, 2, "±")
                }
                Extra::Gaussians => row.marked(text(row.gaussians(), 0, "±"), STATED_MARK),
                Extra::Seconds => row.marked(text(row.seconds(), 1, "±"), STATED_MARK),
                Extra::Seeds => row.done.len().to_string(),
            };
            cells.push(cell);
        }
        Line { label: &row.label, failed: !row.failed.is_empty(), cells, bold, marks: marked.iter().map(|m| m[at]).collect() }
    };
    let all: Vec<&Row<'_>> = rows.iter().collect();
    Short { headings, lines: rows.iter().enumerate().map(line).collect(), note: note(&all, columns) }
}
