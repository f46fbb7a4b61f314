//! Rows of our records that stand for a row of the paper.

use super::published::{Figure, PaperMethod};
use crate::device::Backend;
use crate::methods;
use crate::metrics::stats::Summary;
use crate::table::Row;
use serde_json::Value;

/// Settings that make a row another method than the paper's, whatever its name: another target of the radio, depth that no network could
/// give, and no depth prior.
const OTHER_METHODS: &[(&str, &[&str])] =
    &[("/reconstruction/rf_target", &["db"]), ("/rf_target", &["db"]), ("/reconstruction/depth/prior", &["exact", "none"])];

/// A row of ours beside one of the paper's.
pub struct Matched<'r, 'a> {
    /// The row.
    pub row: &'r Row<'a>,
    /// Its settings that are not the method's own, apart from the budget: paths of keys.
    pub unusual: Vec<String>,
    /// Whether its budget is smaller than the paper's.
    pub shorter: bool,
    /// Labels of rows that would do as well, but are farther from the method's own settings, behind it, or have failed.
    pub others: Vec<String>,
}

/// The row of a method with a budget, `None` without one. Of several the one with the fewest settings that are not the method's own is taken,
/// and of equals the first; one that has failed in all its cells stands behind all others.
pub fn find<'r, 'a>(rows: &'r [Row<'a>], family: PaperMethod, method: &str, budget: &[u64]) -> Option<Matched<'r, 'a>> {
    // What this version does not know (a method that was taken out) has no settings of its own to compare with.
    let own = methods::create(method, &toml::Table::new(), &Backend::Cpu).ok().map(|m| m.config());
    let mut found: Vec<(Vec<String>, &Row<'a>)> = rows
        .iter()
        .filter(|r| r.method == method && has_budget(r.config, family, budget) && !is_other_method(r.config))
        .map(|r| (own.as_ref().map_or(Vec::new(), |own| differences(own, r.config, family)), r))
        .collect();
    found.sort_by_key(|(unusual, row)| (row.done.is_empty(), unusual.len()));
    let mut found = found.into_iter();
    let other = |(_, row): (Vec<String>, &Row<'a>)| match row.done.is_empty() {
        true => format!("{} (failed)", row.label),
        false => row.label.clone().into_owned(),
    };
    let (unusual, row) = found.next()?;
    Some(Matched { row, unusual, shorter: false, others: found.map(other).collect() })
}

/// The row of a method with the largest budget below one that was not run.
pub fn find_shorter<'r, 'a>(rows: &'r [Row<'a>], family: PaperMethod, method: &str, budget: &[u64]) -> Option<Matched<'r, 'a>> {
    let of = |row: &Row<'_>| -> Option<Vec<u64>> { family.budget().iter().map(|names| value(row.config, names)).collect() };
    let below = |mine: &Vec<u64>| mine.iter().zip(budget).all(|(mine, papers)| mine <= papers);
    let budgets = rows.iter().filter(|r| r.method == method).filter_map(of).filter(below);
    let found = find(rows, family, method, &budgets.max()?)?;
    Some(Matched { shorter: true, ..found })
}

/// The value of a setting by any of its names.
fn value(config: &Value, names: &[&str]) -> Option<u64> {
    names.iter().find_map(|pointer| config.pointer(pointer)?.as_u64())
}

fn has_budget(config: &Value, family: PaperMethod, budget: &[u64]) -> bool {
    family.budget().iter().zip(budget).all(|(names, wanted)| value(config, names) == Some(*wanted))
}

fn is_other_method(config: &Value) -> bool {
    let is =
        |pointer: &str, values: &[&str]| config.pointer(pointer).and_then(Value::as_str).is_some_and(|v| values.contains(&v));
    OTHER_METHODS.iter().any(|(pointer, values)| is(pointer, values))
}

/// Paths of the keys that both have with different values; keys that only one has are those of another version.
fn differences(own: &Value, config: &Value, family: PaperMethod) -> Vec<String> {
    fn walk(own: &Value, config: &Value, path: &str, out: &mut Vec<String>) {
        match (own, config) {
            (Value::Object(own), Value::Object(config)) => {
                let both = own.iter().filter_map(|(key, value)| Some((key, value, config.get(key)?)));
                both.for_each(|(key, a, b)| walk(a, b, &format!("{path}/{key}"), out));
            }
            _ if own != config => out.push(path.to_owned()),
            _ => {}
        }
    }
    let mut out = Vec::new();
    walk(own, config, "", &mut out);
    out.retain(|path| !family.budget().iter().any(|names| names.contains(&path.as_str())));
    out
}

/// A cell of ours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Ours {
    /// No record.
    NotRun,
    /// Records of failed cells alone.
    Failed,
    /// Records without this figure.
    NotComputed,
    /// A mean over seeds.
    Value(Summary),
}

/// Our cell of a figure.
pub fn cell(matched: Option<&Matched<'_, '_>>, figure: Figure) -> Ours {
    let Some(Matched { row, .. }) = matched else { return Ours::NotRun };
    if row.done.is_empty() {
        return Ours::Failed;
    }
    let summary = match figure {
        Figure::Time => row.seconds(),
        // One key for all seeds: figures of two definitions have no common mean.
        _ => figure.keys().iter().find_map(|key| row.summary(|n| n.value_of(key))),
    };
    summary.map_or(Ours::NotComputed, Ours::Value)
}
