//! The paper's four tables and its figure of quality over time, from our records, each figure beside the one that the paper prints.

mod chart;
mod notations;
mod published;
mod rows;
#[cfg(test)]
mod tests;

pub use notations::{csv, latex, markdown, markdown_of};
pub use published::{Figure, PaperMethod, PaperRow, PaperTable, TABLES};
pub use rows::Ours;

use crate::metrics::stats::Summary;
use crate::record::Record;
use crate::table::{self, Row};
use anyhow::Result;
use corf_scene::io::write_atomic;
use published::{USUAL, USUAL_PSNR_RADIO};
use rows::{Matched, cell, find, find_shorter};
use std::path::{Path, PathBuf};

/// Files that [`write()`] makes: Markdown, LaTeX, CSV and the figure.
pub const FILES: [&str; 4] = ["paper.md", "paper.tex", "paper.csv", "paper.svg"];

/// A line of a table: the paper's row, and what stands for it here.
pub struct PaperLine<'r, 'a> {
    /// The paper's row.
    pub paper: &'static PaperRow,
    /// Name of the line.
    pub name: String,
    /// Method id of ours.
    pub method: &'static str,
    /// Our row.
    ours: Option<Matched<'r, 'a>>,
    /// Our PSNR rf minus that of CORF-GS with 75 iterations a keyframe, paired by seed.
    pub difference: Option<Summary>,
}

impl PaperLine<'_, '_> {
    /// The label of our row.
    pub fn label(&self) -> Option<&str> {
        Some(&self.ours.as_ref()?.row.label)
    }

    /// Our cell of a figure.
    pub fn cell(&self, figure: Figure) -> Ours {
        cell(self.ours.as_ref(), figure)
    }

    /// The paper's PSNR rf minus that of its CORF-GS with 75 iterations; `None` for that row itself.
    pub fn paper_difference(&self, table: &PaperTable) -> Option<f64> {
        let at = table.figures.iter().position(|f| *f == Figure::PsnrRadio)?;
        let usual = (self.paper.family, self.paper.budget) == USUAL;
        (!usual).then(|| self.paper.values[at] - USUAL_PSNR_RADIO)
    }
}

/// A table of the paper with what we have beside it.
pub struct Beside<'r, 'a> {
    /// The paper's table.
    pub table: &'static PaperTable,
    /// All rows of the paper; below some of them a variant that we have records of.
    pub lines: Vec<PaperLine<'r, 'a>>,
}

/// The four tables; every row of the paper is there, whether there are records of it or not.
pub fn tables<'r, 'a>(rows: &'r [Row<'a>]) -> Vec<Beside<'r, 'a>> {
    let usual = find(rows, USUAL.0, USUAL.0.methods().0, USUAL.1);
    let line = |table: &PaperTable, paper: &'static PaperRow, method: &'static str, variant: Option<&str>| {
        let ours = find(rows, paper.family, method, paper.budget);
        // Where methods are compared, what did not fit is shown at the largest budget that did; where budgets are, it is not.
        let ours = ours.or_else(|| find_shorter(rows, paper.family, method, paper.budget).filter(|_| table.compares_methods));
        let reference = usual.as_ref().map(|u| u.row);
        let difference = ours.as_ref().zip(reference).and_then(|(m, reference)| {
            let itself = m.row.label == reference.label;
            if itself { None } else { m.row.difference(reference) }
        });
        let name = variant.map_or(paper.name.to_owned(), |v| format!("{}, {v}", paper.name));
        PaperLine { paper, name, method, ours, difference }
    };
    let lines = |table: &'static PaperTable| {
        let of = |paper: &'static PaperRow| {
            let (method, variant) = paper.family.methods();
            let variant = variant.map(|(id, how)| line(table, paper, id, Some(how))).filter(|l| l.ours.is_some());
            std::iter::once(line(table, paper, method, None)).chain(variant)
        };
        table.rows.iter().flat_map(of).collect()
    };
    TABLES.iter().map(|table| Beside { table, lines: lines(table) }).collect()
}

/// Writes the tables and the figure into a folder.
///
/// # Errors
/// A folder that cannot be written.
pub fn write(records: &[Record], out: &Path) -> Result<Vec<PathBuf>> {
    let rows = table::rows(records);
    let tables = tables(&rows);
    let head = notations::head(records);
    let contents = [markdown(&tables, &head), latex(&tables, &head), csv(&tables), chart::svg(&tables)?];
    let mut paths = Vec::new();
    for (name, content) in FILES.iter().zip(contents) {
        let path = out.join(name);
        write_atomic(&path, content.as_bytes())?;
        paths.push(path);
    }
    Ok(paths)
}
