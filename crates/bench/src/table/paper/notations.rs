//! The notations of the tables: Markdown, LaTeX, CSV.

use super::rows::Ours;
use super::{Beside, Figure, PaperLine};
use crate::files::escape;
use crate::metrics::stats::Summary;
use crate::record::Record;
use crate::table::{Columns, Row, TOO_FEW_LATEX, TOO_FEW_MARK, TOO_FEW_NOTE, latex_footnote, note, text};
use std::fmt::Write;

/// Text of what can be compared, for these records.
pub fn head(records: &[Record]) -> String {
    fn all(records: &[Record], of: impl Fn(&Record) -> String) -> String {
        let mut found: Vec<String> = Vec::new();
        records.iter().map(of).for_each(|value| {
            if !found.contains(&value) {
                found.push(value);
            }
        });
        if found.is_empty() { "none".to_owned() } else { found.join("; ") }
    }
    let datasets = all(records, |r| format!("{} (hash {:.12})", r.dataset, r.dataset_hash));
    let protocols = all(records, |r| r.split.of_all_folds().held_out());
    format!(
        "The data differ, so only the shape can be compared: which row is ahead, and by how much. The paper's lobby (a replica of a hall at NIST, \
         images by Blender, spectra by Sionna RT, 147 keyframes, every eighth held out) cannot be had; ours: {datasets}, {protocols}. The paper's \
         figures are means of ten runs without intervals, its times those of an RTX 4090; ours were measured on: {}. LPIPS is that of VGG on inputs \
         in [0, 1] where the records have it. Δ is PSNR rf minus that of CORF-GS with 75 iterations a keyframe, ours paired by seed.",
        all(records, |r| r.device.clone())
    )
}

/// Our cell as text.
fn ours(cell: Ours, figure: Figure, plus_minus: &str) -> String {
    match cell {
        Ours::NotRun => "not run".to_owned(),
        Ours::Failed => "failed".to_owned(),
        Ours::NotComputed => "–".to_owned(),
        Ours::Value(summary) => text(Some(summary), figure.digits(), plus_minus),
    }
}

/// A difference with its sign.
fn signed(difference: Option<Summary>, plus_minus: &str) -> String {
    let sign = if difference.is_some_and(|d| d.mean >= 0.0) { "+" } else { "" };
    match difference {
        None => "–".to_owned(),
        some => format!("{sign}{}", text(some, 2, plus_minus)),
    }
}

fn paper_signed(difference: Option<f64>) -> String {
    difference.map_or("–".to_owned(), |d| format!("{d:+.2}"))
}

/// Notes on the rows that were taken: seeds and caveats, settings that are not the method's own, and rows that were not taken.
fn notes(tables: &[Beside<'_, '_>]) -> Vec<String> {
    let (mut taken, mut out): (Vec<&Row<'_>>, Vec<String>) = (Vec::new(), Vec::new());
    for line in tables.iter().flat_map(|t| &t.lines) {
        let Some(matched) = &line.ours else { continue };
        if taken.iter().any(|row| row.label == matched.row.label) {
            continue;
        }
        taken.push(matched.row);
        if !matched.unusual.is_empty() {
            let keys: Vec<String> = matched.unusual.iter().map(|path| path.trim_start_matches('/').replace('/', ".")).collect();
            out.push(format!(
                "\"{}\" has settings that are not those of {} in this version: {}.",
                matched.row.label,
                line.method,
                keys.join(", ")
            ));
        }
        if matched.shorter {
            out.push(format!("\"{}\" has a smaller budget than the paper's row {}.", matched.row.label, line.paper.name));
        }
        if !matched.others.is_empty() {
            let others = matched.others.join("; ");
            out.push(format!("Rows of {} with this budget that stand behind \"{}\": {others}.", line.method, matched.row.label));
        }
    }
    if !taken.is_empty() {
        let mut first = note(&taken, &Columns::none());
        if tables.iter().any(|table| table.lines.iter().any(|line| of_two(line, table.table.figures))) {
            first += &format!(" {TOO_FEW_NOTE}");
        }
        out.insert(0, first);
    }
    out
}

/// Whether anything in a line is a mean of two seeds.
fn of_two(line: &PaperLine<'_, '_>, figures: &[Figure]) -> bool {
    let cell = |figure: &Figure| matches!(line.cell(*figure), Ours::Value(summary) if summary.is_of_two());
    line.difference.is_some_and(|d| d.is_of_two()) || figures.iter().any(cell)
}

fn title(table: &Beside<'_, '_>) -> String {
    format!("Table {}: {}", table.table.number, table.table.title)
}

/// A table in Markdown.
fn markdown_table(table: &Beside<'_, '_>) -> String {
    let figures = table.table.figures;
    let mut out = "| the paper's row | our row |".to_owned();
    figures.iter().for_each(|f| out.push_str(&format!(" {0}, ours | {0}, paper |", f.heading())));
    let _ = write!(out, " Δ PSNR rf, ours | Δ PSNR rf, paper |\n|---|---|{}\n", "---:|".repeat(2 * figures.len() + 2));
    for line in &table.lines {
        let label = line.label().map_or("–".to_owned(), escape::markdown);
        let _ = write!(out, "| {} | {label} |", escape::markdown(&line.name));
        for (figure, paper) in figures.iter().zip(line.paper.values) {
            let _ = write!(out, " {} | {paper:.*} |", ours(line.cell(*figure), *figure, "±"), figure.digits());
        }
        let _ = writeln!(out, " {} | {} |", signed(line.difference, "±"), paper_signed(line.paper_difference(table.table)));
    }
    out
}

fn markdown_notes(tables: &[Beside<'_, '_>]) -> String {
    let notes: Vec<String> = notes(tables).iter().map(|note| escape::markdown(note)).collect();
    if notes.is_empty() { String::new() } else { format!("\n{}\n", notes.join(" ")) }
}

/// One of the tables in Markdown, with the notes on its rows.
pub fn markdown_of(table: &Beside<'_, '_>) -> String {
    format!("{}{}", markdown_table(table), markdown_notes(std::slice::from_ref(table)))
}

/// All four tables in Markdown.
pub fn markdown(tables: &[Beside<'_, '_>], head: &str) -> String {
    let mut out = format!("# The paper's tables from our records\n\n{}\n", escape::markdown(head));
    for table in tables {
        let _ = write!(out, "\n## {} (`{}`)\n\n{}", title(table), table.table.label, markdown_table(table));
    }
    out.push_str("\n## PSNR rf over time\n\n![PSNR rf over reconstruction time, ours and the paper's](paper.svg)\n");
    out + &markdown_notes(tables)
}

/// All four tables in LaTeX, with the package booktabs.
pub fn latex(tables: &[Beside<'_, '_>], head: &str) -> String {
    // A comment ends with its line.
    let comment = |text: &str| format!("% {}\n", text.replace(char::is_control, " "));
    let mut out = comment(head);
    for table in tables {
        let figures = table.table.figures;
        let _ = write!(
            out,
            "\n{}\\begin{{tabular}}{{l{}cc}}\n  \\toprule\n  Method",
            comment(&title(table)),
            "cc".repeat(figures.len())
        );
        figures.iter().for_each(|f| out.push_str(&format!(" & \\multicolumn{{2}}{{c}}{{{}}}", f.latex())));
        out.push_str(" & \\multicolumn{2}{c}{$\\Delta$PSNR$_\\mathrm{rf}$} \\\\\n ");
        out.push_str(&" & ours & paper".repeat(figures.len() + 1));
        out.push_str(" \\\\\n  \\midrule\n");
        for line in &table.lines {
            let _ = write!(out, "  {}", escape::latex(&line.name).replace('²', "$^2$"));
            for (figure, paper) in figures.iter().zip(line.paper.values) {
                let cell = line.cell(*figure);
                let written = ours(cell, *figure, r"\pm").replace('–', "--").replace(&format!(" {TOO_FEW_MARK}"), r"^\ddagger");
                let written = if matches!(cell, Ours::Value(_)) { format!("${written}$") } else { written };
                let _ = write!(out, " & {written} & ${paper:.*}$", figure.digits());
            }
            let difference = |text: String| if text == "–" { "--".to_owned() } else { format!("${text}$") };
            let _ = writeln!(
                out,
                " & {} & {} \\\\",
                difference(signed(line.difference, r"\pm").replace(&format!(" {TOO_FEW_MARK}"), r"^\ddagger")),
                difference(paper_signed(line.paper_difference(table.table)))
            );
        }
        out.push_str("  \\bottomrule\n");
        if table.lines.iter().any(|line| of_two(line, figures)) {
            out.push_str(&latex_footnote(2 * figures.len() + 3, r"\ddagger", TOO_FEW_LATEX));
        }
        out.push_str("\\end{tabular}\n");
    }
    notes(tables).iter().for_each(|note| out.push_str(&comment(note)));
    out
}

/// One line a figure of a row of a table.
pub fn csv(tables: &[Beside<'_, '_>]) -> String {
    let mut out = String::from("table,row,method,our_row,figure,state,ours,ours_half_width_95,ours_seeds,paper\n");
    for table in tables {
        for line in &table.lines {
            let (name, label) = (escape::csv(&line.name), escape::csv(line.label().unwrap_or("")));
            for (figure, paper) in table.table.figures.iter().zip(line.paper.values) {
                let _ = write!(out, "{},{name},{},{label},{},", table.table.number, line.method, figure.name());
                out += &csv_cell(line, *figure);
                let _ = writeln!(out, ",{paper}");
            }
        }
    }
    out
}

fn csv_cell(line: &PaperLine<'_, '_>, figure: Figure) -> String {
    match line.cell(figure) {
        Ours::NotRun => "not run,,,".to_owned(),
        Ours::Failed => "failed,,,".to_owned(),
        Ours::NotComputed => "not computed,,,".to_owned(),
        Ours::Value(Summary { n, mean, half_width_95 }) => {
            format!("done,{mean:.6},{},{n}", half_width_95.map_or(String::new(), |h| format!("{h:.6}")))
        }
    }
}
