//! The notations of a table: Markdown, CSV, LaTeX (plain, and with columns of siunitx), and aligned text for a terminal.

use super::columns::Extra;
use super::{Columns, Mark, Row, STATED_LATEX, Short, TOO_FEW_LATEX, TableCell, Value, devices, short, short_with};
use crate::files::escape;
use crate::metrics::stats::Summary;
use crate::metrics::{COLUMNS, Column};
use crate::record::{Outcome, Record};
use std::fmt::Write;

/// The table in Markdown, with a note of what it rests on. A difference to the first row is bold where its interval excludes zero.
pub fn markdown(rows: &[Row<'_>], columns: &Columns) -> String {
    let short = short(rows, columns);
    let mut out = format!("| {} |\n|---|{}\n", short.headings.join(" | "), "---:|".repeat(short.headings.len() - 1));
    for line in &short.lines {
        let _ = write!(out, "| {}{} |", escape::markdown(line.label), if line.failed { " (failed cells)" } else { "" });
        for cell in &line.cells {
            let mark = if cell.bold { "**" } else { "" };
            let _ = write!(out, " {mark}{}{mark} |", cell.text());
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

/// One line a cell, every metric that any cell has, nothing aggregated; `peak_device_memory_bytes` where a GPU was at work, `uses_scene` where there are oracles, `split` where blocks were held out in
/// folds, `device` where cells ran on several.
pub fn csv(records: &[Record]) -> String {
    let columns = present(records);
    let mut out = String::from("row,method,dataset,dataset_hash,seed,status,seconds,gaussians,peak_memory_bytes");
    let on_gpu = records.iter().any(|r| matches!(&r.outcome, Outcome::Done(n) if n.peak_device_memory_bytes.is_some()));
    out.push_str(if on_gpu { ",peak_device_memory_bytes" } else { "" });
    columns.iter().for_each(|c| out.push_str(&format!(",{}", c.key)));
    let oracles = records.iter().any(|r| r.uses_scene);
    let devices = devices::differ(records);
    let folds = records.iter().any(|r| r.split.fold().is_some());
    out.push_str(",uses_ground_truth_depth");
    out.push_str(if oracles { ",uses_scene" } else { "" });
    out.push_str(if folds { ",split" } else { "" });
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
        if folds {
            let _ = write!(facts, ",{}", escape::csv(&r.split.name()));
        }
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
                if on_gpu {
                    let _ = write!(out, ",{}", optional(n.peak_device_memory_bytes));
                }
                let value = |c: &Column| n.value(c).map_or(String::new(), |v| format!("{v:.6}"));
                columns.iter().for_each(|c| out.push_str(&format!(",{}", value(c))));
                let _ = writeln!(out, ",{}{facts},", r.uses_ground_truth_depth);
            }
            Outcome::Failed { error } => {
                let commas = ",".repeat(columns.len() + usize::from(on_gpu));
                let _ = writeln!(out, ",failed,,,{commas},{}{facts},{}", r.uses_ground_truth_depth, escape::csv(error));
            }
        }
    }
    out
}

/// What usually stands behind the metrics where there is little room: no differences.
const NARROW: &[Extra] = &[Extra::Gaussians, Extra::Seconds];

/// Headings of all columns but the first, in LaTeX.
fn latex_headings(columns: &Columns) -> Vec<String> {
    let leading = columns.leading();
    let of_extra = |extra: Extra| match extra {
        Extra::Difference => format!("$\\Delta$ {}", leading.latex),
        Extra::Gaussians => "Gaussians".to_owned(),
        Extra::Seconds => "Time (s)".to_owned(),
        Extra::Seeds => "Seeds".to_owned(),
        Extra::DeviceMemory => "Memory (MB)".to_owned(),
    };
    let of_metrics = columns.metrics.iter().map(|c| c.latex.to_owned());
    of_metrics.chain(columns.extras(NARROW).into_iter().map(of_extra)).collect()
}

/// A cell's number as LaTeX and siunitx read it; `None` where nothing stands in it.
fn latex_number(cell: &TableCell) -> Option<String> {
    let digits = cell.digits;
    match cell.value {
        Value::None => None,
        Value::Count(count) => Some(count.to_string()),
        Value::Mean(Summary { mean, half_width_95: Some(half), .. }) => Some(format!("{mean:.digits$} \\pm {half:.digits$}")),
        Value::Mean(Summary { mean, .. }) => Some(format!("{mean:.digits$}")),
    }
}

/// Marks behind a cell's number, in LaTeX.
fn latex_marks(cell: &TableCell) -> String {
    let marks = [(cell.is_of_two(), r"\ddagger"), (cell.stated, r"\dagger")];
    let marks: String = marks.iter().filter(|(is_so, _)| *is_so).map(|(_, mark)| *mark).collect();
    if marks.is_empty() { marks } else { format!("^{{{marks}}}") }
}

/// A line below a table of so many columns that says what a mark in it means.
pub fn latex_footnote(columns: usize, mark: &str, meaning: &str) -> String {
    format!("  \\multicolumn{{{columns}}}{{l}}{{\\footnotesize $^{{{mark}}}$ {meaning}}} \\\\\n")
}

/// Whether a cell is set in bold: the best of its column, or a difference whose interval excludes zero.
fn is_bold(cell: &TableCell) -> bool {
    cell.bold || cell.mark == Mark::Best
}

/// A tabular: `spec` are its columns, a line of `headings`, and every cell as `write` has it.
fn tabular(short: &Short<'_>, spec: &str, headings: &[String], write: impl Fn(&TableCell) -> String) -> String {
    let mut out = format!("\\begin{{tabular}}{{{spec}}}\n  \\toprule\n  Method");
    headings.iter().for_each(|heading| out.push_str(&format!(" & {heading}")));
    out.push_str(" \\\\\n  \\midrule\n");
    for line in &short.lines {
        let _ = write!(out, "  {}", escape::latex(line.label));
        line.cells.iter().for_each(|cell| out.push_str(&format!(" & {}", write(cell))));
        out.push_str(" \\\\\n");
    }
    out.push_str("  \\bottomrule\n");
    let cells = || short.lines.iter().flat_map(|line| &line.cells);
    if cells().any(TableCell::is_of_two) {
        out.push_str(&latex_footnote(headings.len() + 1, r"\ddagger", TOO_FEW_LATEX));
    }
    if cells().any(|cell| cell.stated && cell.value != Value::None) {
        out.push_str(&latex_footnote(headings.len() + 1, r"\dagger", STATED_LATEX));
    }
    // A comment ends with its line.
    let note = short.note.replace(char::is_control, " ");
    let _ = write!(
        out,
        "\\end{{tabular}}\n% Bold: the best of its column, and differences to the first row whose interval excludes zero. {note}\n"
    );
    out
}

/// The table as a LaTeX tabular with the package booktabs alone.
pub fn latex(rows: &[Row<'_>], columns: &Columns) -> String {
    let short = short_with(rows, columns, NARROW);
    let headings = latex_headings(columns);
    let spec = format!("l{}", "r".repeat(headings.len()));
    tabular(&short, &spec, &headings, |cell| {
        let Some(number) = latex_number(cell) else { return "--".to_owned() };
        let number = if is_bold(cell) { format!("\\mathbf{{{number}}}") } else { number };
        format!("${number}{}$", latex_marks(cell))
    })
}

/// The table as a LaTeX tabular with the packages booktabs and siunitx (version 2 or 3): numbers stand under each other by their points.
pub fn siunitx(rows: &[Row<'_>], columns: &Columns) -> String {
    let short = short_with(rows, columns, NARROW);
    let headings: Vec<String> = latex_headings(columns).into_iter().map(|heading| format!("{{{heading}}}")).collect();
    let mut spec = String::from("l");
    for at in 0..headings.len() {
        let cells: Vec<&TableCell> = short.lines.iter().map(|line| &line.cells[at]).collect();
        let _ = write!(spec, "S[table-format={}]", table_format(&cells));
    }
    let table = tabular(&short, &spec, &headings, |cell| {
        // What is no number stands in braces.
        let Some(number) = latex_number(cell) else { return "{--}".to_owned() };
        let marks = latex_marks(cell);
        let marks = if marks.is_empty() { marks } else { format!(" {{${{}}{marks}$}}") };
        format!("{}{number}{marks}", if is_bold(cell) { "\\bfseries " } else { "" })
    });
    format!(
        "% \\usepackage{{booktabs,siunitx,etoolbox}}\n% \\robustify\\bfseries \\sisetup{{separate-uncertainty=true, detect-weight=true, mode=text, group-digits=false}}\n{table}"
    )
}

/// siunitx's description of a column's numbers: digits before and after the point, and those of the interval.
fn table_format(cells: &[&TableCell]) -> String {
    let (mut sign, mut whole, mut decimals, mut uncertain) = ("", 1, 0, 0);
    for cell in cells {
        let (mean, half) = match cell.value {
            Value::None => continue,
            Value::Count(count) => (count as f64, None),
            Value::Mean(summary) => (summary.mean, summary.half_width_95),
        };
        let digits = cell.digits;
        let before = |v: f64| format!("{:.digits$}", v.abs()).split('.').next().map_or(1, str::len);
        let written = |v: f64| format!("{v:.digits$}");
        sign = if written(mean).starts_with('-') { "-" } else { sign };
        (whole, decimals) = (whole.max(before(mean)), decimals.max(digits));
        if let Some(half) = half {
            // It is written in units of the last digit.
            let places = written(half).replace('.', "").trim_start_matches('0').len().max(1);
            uncertain = uncertain.max(places);
        }
    }
    let uncertainty = if uncertain > 0 { format!("({uncertain})") } else { String::new() };
    format!("{sign}{whole}.{decimals}{uncertainty}")
}

/// The table for a terminal: aligned columns, no markup. Where it is wider than `width` characters, its columns stand in several blocks under each
/// other, each behind the labels, and the note is broken.
pub fn plain(rows: &[Row<'_>], columns: &Columns, width: Option<usize>) -> String {
    let short = short_with(rows, columns, NARROW);
    let mut lines: Vec<Vec<String>> = vec![short.headings.iter().map(|heading| heading.to_string()).collect()];
    for line in short.lines {
        let failed = if line.failed { " (FAILED)" } else { "" };
        lines.push(std::iter::once(format!("{}{failed}", line.label)).chain(line.cells.iter().map(TableCell::text)).collect());
    }
    let widest = |column: usize| lines.iter().map(|l| l[column].chars().count()).max().unwrap_or(0);
    let widths: Vec<usize> = (0..lines[0].len()).map(widest).collect();
    let mut out = String::new();
    for block in blocks(&widths, width) {
        if !out.is_empty() {
            out.push('\n');
        }
        for line in &lines {
            let _ = write!(out, "{}{}", line[0], " ".repeat(widths[0] - line[0].chars().count()));
            for column in block.clone() {
                let _ = write!(out, "  {}{}", " ".repeat(widths[column] - line[column].chars().count()), line[column]);
            }
            out.push('\n');
        }
    }
    out + &broken(&short.note, width) + "\n"
}

/// Columns that stand beside each other behind the first; one at least in each block.
fn blocks(widths: &[usize], width: Option<usize>) -> Vec<std::ops::Range<usize>> {
    let mut out = vec![];
    let (mut from, mut used) = (1, widths[0]);
    for (column, own) in widths.iter().enumerate().skip(1) {
        if column > from && width.is_some_and(|width| used + 2 + own > width) {
            out.push(from..column);
            (from, used) = (column, widths[0]);
        }
        used += 2 + own;
    }
    out.push(from..widths.len());
    out
}

/// A text in lines of at most `width` characters; a longer word has a line for itself.
fn broken(text: &str, width: Option<usize>) -> String {
    let Some(width) = width else { return text.to_owned() };
    let mut lines: Vec<String> = Vec::new();
    for paragraph in text.lines() {
        let mut line = String::new();
        for word in paragraph.split_whitespace() {
            if !line.is_empty() && line.chars().count() + 1 + word.chars().count() > width {
                lines.push(std::mem::take(&mut line));
            }
            if !line.is_empty() {
                line.push(' ');
            }
            line.push_str(word);
        }
        lines.push(line);
    }
    lines.join("\n")
}
