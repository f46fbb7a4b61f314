//! The notations of a table: Markdown, CSV, LaTeX, and aligned text for a terminal.

use super::{Columns, Extra, Row, devices, note, short, text};
use crate::files::escape;
use crate::metrics::{COLUMNS, Column};
use crate::record::{Outcome, Record};
use std::fmt::Write;

/// The table in Markdown, with a note of what it rests on. A difference to the first row is bold where its interval excludes zero.
pub fn markdown(rows: &[Row<'_>], columns: &Columns) -> String {
    let short = short(rows, columns);
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

/// The columns that any of these records has a number for.
pub fn present(records: &[Record]) -> Vec<&'static Column> {
    let has = |c: &&Column| records.iter().any(|r| matches!(&r.outcome, Outcome::Done(n) if n.value(c).is_some()));
    COLUMNS.iter().filter(has).collect()
}

/// One line a cell, every metric that any cell has, nothing aggregated; `uses_scene` where there are oracles, `device` where cells
/// ran on several.
pub fn csv(records: &[Record]) -> String {
    let columns = present(records);
    let mut out = String::from("row,method,dataset,dataset_hash,seed,status,seconds,gaussians,peak_memory_bytes");
    columns.iter().for_each(|c| out.push_str(&format!(",{}", c.key)));
    let oracles = records.iter().any(|r| r.uses_scene);
    let devices = devices::differ(records);
    out.push_str(",uses_ground_truth_depth");
    out.push_str(if oracles { ",uses_scene" } else { "" });
    out.push_str(if devices { ",device,error\n" } else { ",error\n" });
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
        let mut facts = if oracles { format!(",{}", r.uses_scene) } else { String::new() };
        if devices {
            let _ = write!(facts, ",{}", escape::csv(&r.device));
        }
        let (row, dataset) = (escape::csv(&r.row), escape::csv(&r.dataset));
        let _ = write!(out, "{row},{},{dataset},{},{}", word(&r.method), word(&r.dataset_hash), r.seed);
        match &r.outcome {
            Outcome::Done(n) => {
                let seconds = n.seconds.map_or(String::new(), |s| format!("{s:.3}"));
                let gaussians = optional(n.gaussians.map(|g| g as u64));
                let _ = write!(out, ",done,{seconds},{gaussians},{}", optional(n.peak_memory_bytes));
                let value = |c: &Column| n.value(c).map_or(String::new(), |v| format!("{v:.6}"));
                columns.iter().for_each(|c| out.push_str(&format!(",{}", value(c))));
                let _ = writeln!(out, ",{}{facts},", r.uses_ground_truth_depth);
            }
            Outcome::Failed { error } => {
                let commas = ",".repeat(columns.len());
                let _ = writeln!(out, ",failed,,,{commas},{}{facts},{}", r.uses_ground_truth_depth, escape::csv(error));
            }
        }
    }
    out
}

/// What usually stands behind the metrics where there is little room: no differences.
const NARROW: &[Extra] = &[Extra::Gaussians, Extra::Seconds];

/// The table as a LaTeX tabular.
pub fn latex(rows: &[Row<'_>], columns: &Columns) -> String {
    let (extras, leading) = (columns.extras(NARROW), columns.leading());
    let mut out = format!("\\begin{{tabular}}{{l|{}}}\n  \\toprule\n  Method", "c".repeat(columns.metrics.len() + extras.len()));
    columns.metrics.iter().for_each(|c| out.push_str(&format!(" & {}", c.latex)));
    for extra in &extras {
        out.push_str(&match extra {
            Extra::Difference => format!(" & $\\Delta$ {}", leading.latex),
            Extra::Gaussians => " & Gaussians".to_owned(),
            Extra::Seconds => " & Time (s)".to_owned(),
            Extra::Seeds => " & Seeds".to_owned(),
        });
    }
    out.push_str(" \\\\\n  \\midrule\n");
    for row in rows {
        let _ = write!(out, "  {}", escape::latex(&row.label));
        let cell = |summary, digits| text(summary, digits, r"\pm").replace('–', "-");
        let stated = |cell: String| if row.stated && cell != "-" { format!("{cell}^\\dagger") } else { cell };
        columns.metrics.iter().for_each(|c| out.push_str(&format!(" & ${}$", cell(row.metric(c), c.digits))));
        for extra in &extras {
            let text = match extra {
                Extra::Difference => cell(
                    rows.first().filter(|first| !std::ptr::eq(*first, row)).and_then(|first| row.difference_of(leading, first)),
                    2,
                ),
                Extra::Gaussians => stated(cell(row.gaussians(), 0)),
                Extra::Seconds => stated(cell(row.seconds(), 1)),
                Extra::Seeds => row.done.len().to_string(),
            };
            let _ = write!(out, " & ${text}$");
        }
        out.push_str(" \\\\\n");
    }
    // A comment ends with its line.
    let all: Vec<&Row<'_>> = rows.iter().collect();
    let _ = write!(out, "  \\bottomrule\n\\end{{tabular}}\n% {}\n", note(&all, columns).replace(char::is_control, " "));
    out
}

/// The table for a terminal: aligned columns, no markup.
pub fn plain(rows: &[Row<'_>], columns: &Columns) -> String {
    let narrow = Columns { extras: Some(columns.extras(NARROW)), ..columns.clone() };
    let short = short(rows, &narrow);
    let mut lines: Vec<Vec<String>> = vec![short.headings.iter().map(|heading| heading.to_string()).collect()];
    for line in short.lines {
        let failed = if line.failed { " (FAILED)" } else { "" };
        lines.push(std::iter::once(format!("{}{failed}", line.label)).chain(line.cells).collect());
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
    out + &short.note + "\n"
}
