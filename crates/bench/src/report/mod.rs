//! `report.html`: one self-contained file beside `table.md`.

pub mod along;
mod charts;
mod colours;
mod pictures;
mod plan_view;

use crate::experiment::plan::{Plan, slug};
use crate::files::escape::html as escape;
use crate::metrics::Column;
use crate::metrics::lpips::NO_WEIGHTS;
use crate::record::provenance::Provenance;
use crate::record::{Outcome, Record};
use crate::run::{KeptModel, MODELS};
use crate::split::Split;
use crate::table::{self, Mark};
use anyhow::Result;
use corf_scene::dataset::Dataset;
use corf_scene::io::write_atomic;
use corf_scene::words::counted;
use std::fmt::Write;
use std::path::Path;

const STYLE: &str = include_str!("style.css");
const SCRIPT: &str = include_str!("script.js");

/// Everything a report is made of.
pub struct Report<'a> {
    /// The comparison.
    pub plan: &'a Plan,
    /// Its dataset.
    pub dataset: &'a Dataset,
    /// Training and held-out split.
    pub split: &'a Split,
    /// Transmitter position in the world, metres.
    pub transmitter_m: Option<[f64; 3]>,
    /// All cells.
    pub records: &'a [Record],
    /// Folder of the kept predictions, one sub-folder a row.
    pub predictions: &'a Path,
    /// Figures along the way, where there are some.
    pub figures: Option<along::Figures>,
    /// Models that the comparison keeps.
    pub models: &'a [KeptModel],
}

/// Writes the report atomically.
///
/// # Errors
/// Unreadable keyframes, or a folder that cannot be written.
pub fn write(report: &Report<'_>, path: &Path) -> Result<()> {
    Ok(write_atomic(path, html(report)?.as_bytes())?)
}

fn html(report: &Report<'_>) -> Result<String> {
    let rows = table::rows(report.records);
    let mut out = String::new();
    let title = escape(&report.plan.name);
    // Well-formed as XML too, so that any parser can read it; the policy keeps it from asking anything of a network.
    write!(
        out,
        "<!DOCTYPE html><html lang=\"en\"><head><meta charset=\"utf-8\"/><meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"/>\
         <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src \
         'unsafe-inline'\"/><title>corf: {title}</title><style>{STYLE}</style></head><body><main><h1>{title}</h1>"
    )?;
    write!(out, "<p class=\"lede\">{}</p>", escape(&report.plan.analysis))?;
    out += &viewers(report);
    write!(out, "<h2>Comparison</h2>{}", html_table(&rows, &table::columns(&report.plan.columns)?))?;
    write!(out, "<h2>Where it was</h2>{}", plan_view::figure(report)?)?;
    let observations = pictures::Observations::read(report)?;
    write!(out, "<h2>All methods on one held-out keyframe</h2>{}", pictures::gallery(report, &observations)?)?;
    write!(out, "<h2>Frame by frame</h2>{}", charts::per_frame(report.records))?;
    if let Some(figures) = &report.figures {
        write!(out, "<h2>Along the way</h2>{}", figures.html())?;
    }
    let quality = charts::quality(report.records);
    if !quality.is_empty() {
        write!(out, "<h2>Quality over time</h2>{quality}")?;
    }
    write!(out, "<h2>Time and Gaussians</h2>{}", charts::growth(report.records))?;
    write!(out, "<h2>What was there, what was predicted</h2>{}", pictures::section(report, &observations)?)?;
    write!(out, "<h2>All metrics</h2>{}", all_metrics(report.records))?;
    writeln!(out, "<h2>Provenance</h2>{}</main><script>{SCRIPT}</script></body></html>", provenance(report))?;
    Ok(out)
}

/// Links to the viewer's pages of kept models, as far as they are there.
fn viewers(report: &Report<'_>) -> String {
    let link = |model: &KeptModel| {
        let (name, page) = (model.folder.file_name()?.to_str()?, model.page.file_name()?.to_str()?);
        let megabytes = std::fs::metadata(&model.page).ok().filter(|_| model.has_page())?.len() as f64 / 1e6;
        let row = report.plan.rows.iter().find(|row| slug(&row.label) == name).map_or(name, |row| &row.label);
        Some(format!(
            "<p class=\"lede viewer\"><a href=\"{}\">Look around in the field of {}</a>, in light and in radio ({megabytes:.1} MB, beside this page)</p>",
            escape(page),
            escape(row)
        ))
    };
    report.models.iter().filter_map(link).collect()
}

/// A box that scrolls by itself where its table is wider than the page; a keyboard can enter it.
fn scroll(name: &str, table: &str) -> String {
    format!("<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{name}\"><table>{table}</table></div>")
}

/// The short table.
fn html_table(rows: &[table::Row<'_>], columns: &table::Columns) -> String {
    let short = table::short(rows, columns);
    let mut out = String::from("<thead><tr>");
    short.headings.iter().for_each(|h| out.push_str(&format!("<th scope=\"col\">{}</th>", escape(h))));
    out.push_str("</tr></thead><tbody>");
    for line in &short.lines {
        let failed = if line.failed { " (failed cells)" } else { "" };
        let _ = write!(out, "<tr><th scope=\"row\">{}{failed}</th>", escape(line.label));
        for cell in &line.cells {
            let text = escape(&cell.text());
            let text = if cell.bold { format!("<b>{text}</b>") } else { text };
            let class = match cell.mark {
                Mark::Best => " class=\"best\" title=\"the best of its column\"",
                Mark::Near => " class=\"near\" title=\"its interval overlaps that of the best\"",
                Mark::None => "",
            };
            let _ = write!(out, "<td{class}>{text}</td>");
        }
        out.push_str("</tr>");
    }
    out.push_str("</tbody>");
    let marks = if short.lines.iter().flat_map(|l| &l.cells).any(|cell| cell.mark == Mark::Best) {
        "<p class=\"note\"><span class=\"best\">Framed</span>: the best of its column. <span class=\"near\">Underlined</span>: its confidence \
         interval overlaps that of the best. <b>Bold</b>: a difference to the first row whose interval excludes zero.</p>"
    } else {
        ""
    };
    format!("{}{marks}<p class=\"note\">{}</p>", scroll("comparison", &out), escape(&short.note))
}

fn all_metrics(records: &[Record]) -> String {
    let columns = table::present(records);
    let mut out = String::from("<thead><tr><th scope=\"col\">cell</th>");
    columns.iter().for_each(|c| out.push_str(&format!("<th scope=\"col\">{}</th>", escape(c.heading))));
    out.push_str("</tr></thead><tbody>");
    for record in records {
        let _ = write!(out, "<tr><th scope=\"row\">{}, seed {}</th>", escape(&record.row), record.seed);
        match &record.outcome {
            Outcome::Done(n) => {
                let value = |c: &Column| n.value(c).map_or("–".to_owned(), |v| format!("{v:.*}", c.digits));
                columns.iter().for_each(|c| out.push_str(&format!("<td>{}</td>", value(c))));
            }
            Outcome::Failed { error } => {
                let _ = write!(out, "<td colspan=\"{}\">failed: {}</td>", columns.len(), escape(error));
            }
        }
        out.push_str("</tr>");
    }
    let table = scroll("all metrics", &(out + "</tbody>"));
    if columns.iter().any(|c| c.backbone().is_some()) {
        return table;
    }
    format!("{table}<p class=\"note\">LPIPS not computed: {}.</p>", escape(NO_WEIGHTS))
}

fn provenance(report: &Report<'_>) -> String {
    let header = report.dataset.header();
    let mut lines = vec![(
        "dataset",
        format!("{} · {} · hash {}", header.name, counted(report.dataset.len(), "keyframe"), report.dataset.hash()),
    )];
    // What the cells were made with, not what writes this page; more than one line means they are not all from one build.
    let mut made_with: Vec<&Provenance> = Vec::new();
    for record in report.records {
        if !made_with.contains(&&record.provenance) {
            made_with.push(&record.provenance);
        }
    }
    for p in made_with {
        let changed = if p.dirty { " (changed)" } else { "" };
        lines.push((
            "source",
            format!("corf {} · commit {}{changed} · Cargo.lock sha256 {}", p.version, p.commit, p.lockfile_sha256),
        ));
        lines.push(("machine", format!("{} · {}", p.processor, counted(p.threads, "thread"))));
    }
    if let Some(record) = report.records.first() {
        let weights = record.lpips_weights.iter();
        lines.extend(weights.map(|(backbone, sha256)| ("LPIPS weights", format!("{backbone} · sha256 {sha256}"))));
        lines.push(("clock", record.clock.clone()));
    }
    if !report.models.is_empty() {
        lines.push((
            "model",
            format!("in {MODELS}/, beside this page: a run folder for `corf view`, `corf render` and `corf evaluate`"),
        ));
    }
    let peak = report.records.iter().filter_map(|r| match &r.outcome {
        Outcome::Done(n) => n.peak_memory_bytes,
        Outcome::Failed { .. } => None,
    });
    if let Some(bytes) = peak.max() {
        lines.push(("peak memory", format!("{:.0} MB, the whole process, largest cell", bytes as f64 / 1e6)));
    }
    let on_device = report.records.iter().filter_map(|r| match &r.outcome {
        Outcome::Done(n) => n.peak_device_memory_bytes,
        Outcome::Failed { .. } => None,
    });
    if let Some(bytes) = on_device.max() {
        lines.push(("peak device memory", format!("{:.0} MB, buffers on the GPU, largest cell", bytes as f64 / 1e6)));
    }
    let mut out = String::from("<table class=\"facts\">");
    lines.iter().for_each(|(k, v)| out.push_str(&format!("<tr><th scope=\"row\">{k}</th><td>{}</td></tr>", escape(v))));
    out + "</table>"
}

/// Folder of a row's kept predictions.
pub fn row_folder(predictions: &Path, label: &str) -> std::path::PathBuf {
    predictions.join(slug(label))
}
