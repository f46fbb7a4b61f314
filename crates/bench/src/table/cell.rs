//! A cell of a table before any notation: its number, and what has to be said of it.

use super::Mark;
use crate::metrics::stats::Summary;

/// Mark of a mean of two seeds, which are too few for an interval.
pub const TOO_FEW_MARK: &str = "‡";
/// What the mark means.
pub const TOO_FEW_NOTE: &str = "‡ Mean of two seeds: too few for a confidence interval.";
/// The same in LaTeX, behind the mark.
pub const TOO_FEW_LATEX: &str = "Mean of two seeds: too few for a confidence interval.";
/// Mark of what the maker of predictions states and nobody here has measured.
pub const STATED_MARK: &str = "†";
/// What that mark means, in LaTeX, behind it.
pub const STATED_LATEX: &str = "As stated by the maker of the predictions, not measured here.";

/// What stands in a cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// Nothing: no seed has a number, or not all of them.
    None,
    /// A mean over seeds.
    Mean(Summary),
    /// A number of things.
    Count(usize),
}

/// A cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TableCell {
    /// What stands in it.
    pub value: Value,
    /// Digits after the point.
    pub digits: usize,
    /// Whether it is as the maker of predictions states it, and was not measured here.
    pub stated: bool,
    /// Whether it is a difference whose confidence interval excludes zero, to be set in bold.
    pub bold: bool,
    /// Its place within its column; only metrics and measured times have any.
    pub mark: Mark,
}

impl TableCell {
    pub(super) fn mean(summary: Option<Summary>, digits: usize) -> Self {
        let value = summary.map_or(Value::None, Value::Mean);
        Self { value, digits, stated: false, bold: false, mark: Mark::None }
    }

    pub(super) fn count(count: usize) -> Self {
        Self { value: Value::Count(count), ..Self::mean(None, 0) }
    }

    /// Whether it is a mean of two seeds, which has no interval.
    pub fn is_of_two(&self) -> bool {
        matches!(self.value, Value::Mean(summary) if summary.is_of_two())
    }

    /// The cell as plain text, a dash where nothing stands in it.
    pub fn text(&self) -> String {
        match self.value {
            Value::None => "–".to_owned(),
            Value::Mean(summary) => {
                let stated = if self.stated { format!(" {STATED_MARK}") } else { String::new() };
                text(Some(summary), self.digits, "±") + &stated
            }
            Value::Count(count) => count.to_string(),
        }
    }
}

/// A mean with its interval, where it has one, as text; of two seeds with [`TOO_FEW_MARK`], a dash without a mean.
pub fn text(summary: Option<Summary>, digits: usize, plus_minus: &str) -> String {
    match summary {
        None => "–".to_owned(),
        Some(Summary { mean, half_width_95: Some(h), .. }) => format!("{mean:.digits$} {plus_minus} {h:.digits$}"),
        Some(summary) if summary.is_of_two() => format!("{:.digits$} {TOO_FEW_MARK}", summary.mean),
        Some(Summary { mean, .. }) => format!("{mean:.digits$}"),
    }
}
