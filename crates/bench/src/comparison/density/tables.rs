//! The results as Markdown and CSV.

use super::{DensityStep, Results, StepRow};
use crate::files::escape;
use crate::metrics::Column;
use crate::metrics::stats::summarize;
use crate::table;
use std::fmt::Write;

/// The places in words, then a table a metric.
pub(super) fn text(results: &Results, metrics: &[&Column]) -> String {
    let mut out = format!("# {}\n\n", escape::markdown(&results.name));
    let _ = write!(
        out,
        "{}, {} (hash {:.12}). Distances are medians over the held-out keyframes, which stay the same, to the nearest training pose; a row overtakes \
         where it is ahead from there to the sparsest step, interpolated between two steps. Copying is the better of the lookups at each step.\n\n",
        results.protocol.held_out(),
        escape::markdown(&results.dataset),
        results.dataset_hash
    );
    for found in &results.overtaking {
        let metric = metrics.iter().find(|c| c.key == found.metric).map_or(found.metric, |c| c.heading);
        let _ = writeln!(
            out,
            "- {metric}: {} {} (against {}).",
            escape::markdown(&found.row),
            found.said,
            escape::markdown(&found.over)
        );
    }
    for metric in metrics {
        let _ = write!(out, "\n{}\n\n| one of | training keyframes | distance, m |", metric.heading);
        let first = results.steps.first();
        let rows: Vec<&StepRow> = first.iter().flat_map(|step| &step.rows).collect();
        for row in &rows {
            let _ = write!(out, " {} |", escape::markdown(&row.row));
        }
        let _ = write!(out, "\n|---:|---:|---:|{}", "---:|".repeat(rows.len()));
        for step in &results.steps {
            let _ = write!(out, "\n{}", line(step, metric));
        }
        out.push('\n');
    }
    out
}

fn line(step: &DensityStep, metric: &Column) -> String {
    let mut out = format!("| {} | {:.0} | {:.3} |", step.spacing, step.train_keyframes, step.nearest_training_m);
    for row in &step.rows {
        let failed = row.seeds.iter().filter(|s| !s.values.contains_key(metric.key)).count();
        let note = if failed > 0 { format!(" ({failed} failed)") } else { String::new() };
        let _ = write!(out, " {}{note} |", table::text(summarize(&row.values(metric.key)), metric.digits, "±"));
    }
    out
}

/// A value a line; one of a failed cell is empty.
pub(super) fn csv(results: &Results) -> String {
    let mut out = String::from("metric,spacing,train_keyframes,nearest_training_m,row,method,looks_up,seed,value\n");
    for metric in &results.metrics {
        for step in &results.steps {
            for row in &step.rows {
                for seed in &row.seeds {
                    let value = seed.values.get(metric).map_or(String::new(), |v| format!("{v:.6}"));
                    let _ = writeln!(
                        out,
                        "{metric},{},{},{:.6},{},{},{},{},{value}",
                        step.spacing,
                        step.train_keyframes,
                        step.nearest_training_m,
                        escape::csv(&row.row),
                        row.method,
                        row.looks_up,
                        seed.seed
                    );
                }
            }
        }
    }
    out
}
