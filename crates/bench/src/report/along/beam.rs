//! The predicted best beam along the way.

use super::Way;
use super::canvas::{self, BAD, Cell, FAIR, GOOD, HEAD, INK, Sample};
use crate::metrics::beams::BeamMetrics;
use anyhow::Result;
use plotters::style::{RGBColor, WHITE};

/// Height of the chart of losses.
const CHART: i32 = 230;

/// Outcome of a choice, with the loss in its cell.
fn cell(beams: &BeamMetrics) -> Cell {
    let (colour, ink): (RGBColor, RGBColor) = match (beams.beam_top1 > 0.5, beams.beam_top3 > 0.5) {
        (true, _) => (GOOD, INK),
        (false, true) => (FAIR, INK),
        (false, false) => (BAD, WHITE),
    };
    let loss = beams.codebook_loss_db;
    let digits = usize::from(loss < 9.95);
    let word = (beams.beam_top1 < 0.5).then(|| (format!("{loss:.digits$}"), ink));
    Cell { colour, word }
}

/// The figure.
///
/// # Errors
/// Losses that no axis holds.
pub(super) fn svg(way: &Way) -> Result<String> {
    let rows = way.tracks.len() as i32;
    let height = HEAD + canvas::ROW * (rows + 4) + CHART + 20;
    let line = "The beam of the 8×8 codebook that is strongest in the prediction, against the one that is best as observed. In cells: what it loses, dB.";
    canvas::figure(height, "Predicted best beam at held-out keyframes", line, |root| {
        let cells: Vec<Vec<Cell>> = way.tracks.iter().map(|t| t.stops.iter().map(|stop| cell(&stop.0)).collect()).collect();
        for (i, track) in way.tracks.iter().enumerate() {
            let y = HEAD + canvas::ROW * (i as i32 + 1) + canvas::ROW / 2;
            canvas::name(root, y, &track.label, Sample::Line(canvas::colour(track)))?;
        }
        let end = canvas::strips(root, way, HEAD, &cells, None)?;
        let entries = [
            (GOOD, "the best beam (top-1)"),
            (FAIR, "the best is among its first three (top-3)"),
            (BAD, "the best is not among them"),
        ];
        let end = canvas::key(root, end + 4, &entries)?;
        canvas::heading(root, end + 8, "beam loss, dB")?;
        losses(way, &canvas::part(root, end + 8 + canvas::ROW, CHART))
    })
}

fn losses(way: &Way, area: &canvas::Area<'_>) -> Result<()> {
    let most = way.tracks.iter().flat_map(|t| &t.stops).map(|stop| stop.0.codebook_loss_db).fold(1.0, f64::max);
    let y = -0.03 * most..1.08 * most;
    let mut chart = canvas::chart(area, way.axis.range.clone(), y, Some(way.axis.name), true)?;
    // The first row lies over the others.
    for track in way.tracks.iter().rev() {
        let width = if track.row == 0 { 3 } else { 2 };
        canvas::line(&mut chart, way, track.stops.iter().map(|stop| stop.0.codebook_loss_db), canvas::colour(track), width)?;
    }
    Ok(())
}
