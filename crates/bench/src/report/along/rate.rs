//! The rate of the chosen beam along the way, beside that of the best one.

use super::Way;
use super::canvas::{self, DIM, HEAD, INK, Sample, wrong};
use crate::metrics::rate::{TARGET_RATE_BPS_HZ, budget};
use anyhow::Result;
use plotters::prelude::*;

/// Least height of the chart.
const CHART: i32 = 380;
/// Strokes of the line of free space, pixels.
const FREE_SPACE: i32 = 6;
/// Strokes of the line of the target, pixels.
const TARGET: i32 = 2;

/// The figure.
///
/// # Errors
/// Rates that no axis holds.
pub(super) fn svg(way: &Way) -> Result<String> {
    let free: Option<Vec<f64>> = way.truth.iter().map(|link| link.free_space_rate_bps_hz).collect();
    let mut names = vec![("best beam, as observed", Sample::Line(INK))];
    names.extend(way.tracks.iter().map(|t| (t.label.as_str(), Sample::Line(canvas::colour(t)))));
    names.extend(free.is_some().then_some(("free space over the same distance", Sample::Dashed(FREE_SPACE, DIM))));
    names.push(("target", Sample::Dashed(TARGET, INK)));
    names.extend(way.out_of_service().next().map(|_| ("best beam in outage", Sample::Shade)));
    let chart_height = CHART.max(canvas::ROW * names.len() as i32 + canvas::AXIS);
    let line = format!("Rates as observed: log2(1 + SNR) with {}. Target {TARGET_RATE_BPS_HZ} bit/s/Hz.", budget());
    canvas::figure(HEAD + canvas::ROW + chart_height + 14, "Rate of the chosen beam at held-out keyframes", &line, |root| {
        canvas::heading(root, HEAD, "rate, bit/s/Hz")?;
        let top = HEAD + canvas::ROW;
        for (i, (text, sample)) in names.iter().enumerate() {
            let y = top + canvas::ROW * i as i32 + canvas::ROW / 2;
            canvas::name(root, y, text, *sample)?;
        }
        rates(way, &canvas::part(root, top, chart_height), free.as_deref())
    })
}

fn rates(way: &Way, area: &canvas::Area<'_>, free: Option<&[f64]>) -> Result<()> {
    let links = way.tracks.iter().flat_map(|t| &t.stops).map(|stop| stop.1.chosen_rate_bps_hz);
    let most = links.chain(way.truth.iter().map(|l| l.best_rate_bps_hz)).chain(free.iter().flat_map(|f| f.iter().copied()));
    let most = most.fold(TARGET_RATE_BPS_HZ, f64::max);
    let y = 0.0..1.06 * most;
    let mut chart = canvas::chart(area, way.axis.range.clone(), y.clone(), Some(way.axis.name), true)?;
    canvas::shade(&mut chart, way, &y)?;
    if let Some(free) = free {
        let points = way.axis.stops.iter().copied().zip(free.iter().copied());
        chart.draw_series(DashedLineSeries::new(points, FREE_SPACE, FREE_SPACE, DIM.stroke_width(2))).map_err(wrong)?;
    }
    let ends = [way.axis.range.start, way.axis.range.end].map(|x| (x, TARGET_RATE_BPS_HZ));
    chart.draw_series(DashedLineSeries::new(ends, TARGET, TARGET, INK.stroke_width(1))).map_err(wrong)?;
    canvas::line(&mut chart, way, way.truth.iter().map(|l| l.best_rate_bps_hz), INK, 6)?;
    for track in way.tracks.iter().rev() {
        let width = if track.row == 0 { 3 } else { 2 };
        canvas::line(&mut chart, way, track.stops.iter().map(|stop| stop.1.chosen_rate_bps_hz), canvas::colour(track), width)?;
    }
    Ok(())
}
