//! The predicted best beam along the way.

use super::Way;
use super::canvas::{self, BAD, Cell, FAIR, GOOD, HEAD};
use crate::charts::{Colour, INK, Svg, WHITE};
use crate::metrics::beams::BeamMetrics;
use anyhow::Result;

/// Height of the chart of losses.
const CHART: f64 = 230.0;

/// Outcome of a choice, with the loss in its cell.
fn cell(beams: &BeamMetrics) -> Cell {
    let (colour, ink): (Colour, Colour) = match (beams.beam_top1 > 0.5, beams.beam_top3 > 0.5) {
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
    let line = "The beam of the 8×8 codebook that is strongest in the prediction, against the one that is best as observed. In cells: what it loses, dB.";
    canvas::figure("Predicted best beam at held-out keyframes", line, |svg| {
        let cells: Vec<Vec<Cell>> = way.tracks.iter().map(|t| t.stops.iter().map(|stop| cell(&stop.0)).collect()).collect();
        canvas::names(svg, way, HEAD + canvas::ROW);
        let end = canvas::strips(svg, way, HEAD, &cells, None)?;
        let entries = [
            (GOOD, "the best beam (top-1)"),
            (FAIR, "the best is among its first three (top-3)"),
            (BAD, "the best is not among them"),
        ];
        let end = canvas::key(svg, end + 4.0, &entries);
        canvas::heading(svg, end + 8.0, "beam loss, dB");
        let top = end + 8.0 + canvas::ROW;
        losses(way, svg, top)?;
        Ok(top + CHART)
    })
}

fn losses(way: &Way, svg: &mut Svg, top: f64) -> Result<()> {
    let most = way.tracks.iter().flat_map(|t| &t.stops).map(|stop| stop.0.codebook_loss_db).fold(1.0, f64::max);
    let y = -0.03 * most..1.08 * most;
    let mut plot = canvas::chart(svg, (top, CHART), way.axis.range.clone(), y, way.axis.name)?;
    // The first row lies over the others.
    for track in way.tracks.iter().rev() {
        let losses = track.stops.iter().map(|stop| stop.0.codebook_loss_db);
        canvas::line(&mut plot, way, losses, canvas::colour(track), canvas::width(track));
    }
    Ok(())
}
