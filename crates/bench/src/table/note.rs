//! The note under a table: seeds, protocol, caveats of the numbers, failed cells, definitions of unusual columns.

use super::{Column, Columns, KNOWN, Row, devices};
use crate::methods::corf_gs::GeometryConfig;
use crate::metrics::lpips::NO_WEIGHTS;
use crate::record::PROTOCOL;
use std::fmt::Write;

/// Most rows that a caveat names as its exceptions.
const MOST_EXCEPTIONS: usize = 3;

/// The rows that `has` holds for, as the object of "used by": all of them, all but a few, or each by its label. Labels contain commas, so
/// they stand between semicolons, and one that contains a semicolon stands in quotation marks.
fn named(rows: &[&Row<'_>], has: impl Fn(&Row<'_>) -> bool) -> Option<String> {
    let (with, without): (Vec<&Row<'_>>, Vec<&Row<'_>>) = rows.iter().copied().partition(|r| has(r));
    match (with.len(), without.len()) {
        (0, _) => None,
        (2.., 0) => Some("all rows".to_owned()),
        (some, few) if few > 0 && few <= MOST_EXCEPTIONS && few < some => Some(format!("all rows but {}", list(&without))),
        _ => Some(list(&with)),
    }
}

fn list(rows: &[&Row<'_>]) -> String {
    rows.iter().map(|r| name(&r.label)).collect::<Vec<_>>().join("; ")
}

fn name(label: &str) -> String {
    if label.contains(';') { format!("\"{label}\"") } else { label.to_owned() }
}

/// Which rows have fewer seeds than the others, by their number.
fn fewer_seeds(rows: &[&Row<'_>], most: usize) -> String {
    let mut said = String::new();
    for n in (0..most).rev() {
        let with: Vec<&Row<'_>> = rows.iter().copied().filter(|r| r.done.len() == n).collect();
        if !with.is_empty() {
            let _ = write!(said, ", {n} of {}", list(&with));
        }
    }
    said
}

/// A sentence for each data set other than that of most rows, with the rows that have cells of it: records of several stand together where `joined.toml`
/// says why.
fn other_datasets(rows: &[&Row<'_>]) -> Vec<String> {
    let mut datasets: Vec<(&str, &str)> = Vec::new();
    for dataset in rows.iter().flat_map(|row| &row.datasets) {
        if !datasets.contains(dataset) {
            datasets.push(*dataset);
        }
    }
    let of = |dataset: &(&str, &str)| rows.iter().filter(|row| row.datasets.contains(dataset)).count();
    // The first of those that most rows are of.
    let Some(most) = datasets.iter().copied().reduce(|most, other| if of(&other) > of(&most) { other } else { most }) else {
        return Vec::new();
    };
    datasets.retain(|other| other.1 != most.1);
    let sentence = |other: (&str, &str)| {
        let of_other = named(rows, |row| row.datasets.contains(&other))?;
        Some(format!("Of data set {} (hash {:.12}), not {} (hash {:.12}): {of_other}.", other.0, other.1, most.0, most.1))
    };
    datasets.into_iter().filter_map(sentence).collect()
}

/// The note under a table of these rows with these columns.
pub fn note(rows: &[&Row<'_>], columns: &Columns) -> String {
    let seeds = rows.iter().map(|r| r.done.len()).max().unwrap_or(0);
    let mut note = match seeds {
        0 | 1 => "One seed: no confidence intervals.".to_owned(),
        2 => format!("Mean over 2 seeds{}.", fewer_seeds(rows, 2)),
        n => format!("Mean ± 95 % confidence interval (Student's t) over {n} seeds{}.", fewer_seeds(rows, n)),
    };
    let protocol = rows.first().map(|r| r.protocol.note()).filter(|note| !note.is_empty());
    protocol.iter().for_each(|said| note += &format!(" {said}"));
    if let Some(blocks) = rows.first().and_then(|r| r.protocol.blocks()) {
        let keyframes = rows.iter().flat_map(|r| &r.done).map(|(_, numbers)| numbers.frames.len()).max().unwrap_or(0);
        let folds = if blocks.fold.is_none() { blocks.parts } else { 1 };
        let _ = write!(note, " n = {keyframes} held-out keyframes in {folds} fold{}.", if folds == 1 { "" } else { "s" });
    }
    for (device, of_device) in devices::groups(rows) {
        let _ = write!(note, " Ran on {device}: {}.", list(&of_device));
    }
    if let Some(protocol) = rows.iter().find(|r| r.metrics != PROTOCOL).map(|r| r.metrics) {
        let _ = write!(note, " Metrics are those of {protocol}; this version's are {PROTOCOL}.");
    }
    if let Some(depth) = named(rows, |r| r.traced_depth) {
        let _ = write!(note, " The ray tracer's depth (through the simulated monocular prior, or as it is) used by: {depth}.");
    }
    if let Some(depth) = named(rows, |r| r.imported_depth) {
        let _ = write!(
            note,
            " Depth that came with the imported capture, as true as whatever measured it (through the simulated monocular prior, or as it is) used by: \
             {depth}."
        );
    }
    if let Some(kept) = named(rows, |r| GeometryConfig::of_config(r.config).is_some()) {
        let _ = write!(
            note,
            " Light and geometry of a finished run kept, radio alone learnt (time is of radio, and images are that run's): {kept}."
        );
    }
    if let Some(oracles) = named(rows, |r| r.true_scene) {
        let _ = write!(note, " The true scene (mirror images of the transmitter) used by: {oracles}.");
    }
    other_datasets(rows).iter().for_each(|said| note += &format!(" {said}"));
    if let Some(unverified) = named(rows, |r| r.unverified) {
        let _ = write!(note, " Dataset files not checked against their recorded SHA-256: {unverified}.");
    }
    let stated: Vec<&Row<'_>> = rows.iter().copied().filter(|r| r.stated).collect();
    if !stated.is_empty() {
        let stated = list(&stated);
        let _ = write!(
            note,
            " Predictions of other programs, scored here: {stated} († time and Gaussians are as their makers state them, as is what they were \
             made from)."
        );
    }
    let levels =
        rows.iter().flat_map(|r| &r.done).flat_map(|(_, n)| &n.frames).any(|f| f.spectrum.is_some_and(|s| s.radio.is_none()));
    if levels {
        note += " Spectra are grey levels of a unit that is not known, at an array that stands still: PSNR and SSIM rf (dB) are of the levels as they \
                 stand, those of Jet of their colours, and what needs powers or a camera is not computed.";
    }
    let masked_out = rows.iter().flat_map(|r| &r.done).map(|(_, numbers)| numbers.masked_out()).max().unwrap_or(0);
    if masked_out > 0 {
        let _ = write!(
            note,
            " Held-out images left out of the metrics of images, for a mask covers all of their pixels: {masked_out}."
        );
    }
    let lpips: Vec<&Column> = columns.metrics.iter().copied().filter(|c| c.backbone().is_some()).collect();
    let lacks = |row: &Row<'_>, c: &Column| row.done.iter().any(|(_, numbers)| numbers.value(c).is_none());
    let without = |row: &Row<'_>| !lpips.is_empty() && lpips.iter().all(|c| lacks(row, c));
    if let Some(without) = named(rows, without) {
        let _ = write!(note, " LPIPS not computed, for {NO_WEIGHTS}: {without}.");
    }
    if let Some(partly) = named(rows, |row| !without(row) && lpips.iter().any(|c| lacks(row, c))) {
        let _ = write!(note, " LPIPS computed of some images or with some networks alone: {partly}.");
    }
    for row in rows {
        for (seed, error) in &row.failed {
            let _ = write!(note, " FAILED: {}, seed {seed}: {error}.", name(&row.label));
        }
    }
    for column in columns.metrics.iter().filter(|c| !KNOWN.contains(&c.key)) {
        let _ = write!(note, " {}: {}.", column.heading, column.definition());
    }
    note
}
