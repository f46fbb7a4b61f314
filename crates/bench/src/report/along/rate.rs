//! The rate of the chosen beam along the way, beside that of the best one.

use super::Way;
use super::canvas::{self, HEAD, Sample};
use crate::charts::{DIM, INK, Stroke, Svg};
use crate::metrics::rate::{TARGET_RATE_BPS_HZ, budget};
use anyhow::Result;

/// Least height of the chart.
const CHART: f64 = 380.0;
/// The line of free space.
const FREE_SPACE: Stroke = Stroke { colour: DIM, width: 2.0, dash: Some(6.0) };
/// The line of the target.
const TARGET: Stroke = Stroke { colour: INK, width: 1.0, dash: Some(2.0) };

/// The figure.
///
/// # Errors
/// Rates that no axis holds.
pub(super) fn svg(way: &Way) -> Result<String> {
    let free: Option<Vec<f64>> = way.truth.iter().map(|link| link.free_space_rate_bps_hz).collect();
    let sample = |track| Sample::Line(Stroke::of(canvas::colour(track), 4.0));
    let mut names = vec![("best beam, as observed", Sample::Line(Stroke::of(INK, 4.0)))];
    names.extend(way.tracks.iter().map(|t| (t.label.as_str(), sample(t))));
    names.extend(free.is_some().then_some(("free space, same distance", Sample::Line(FREE_SPACE))));
    names.push(("target", Sample::Line(TARGET)));
    names.extend(way.out_of_service().next().map(|_| ("best beam in outage", Sample::Shade)));
    let chart_height = CHART.max(canvas::ROW * names.len() as f64 + canvas::AXIS);
    let line = format!("Rates as observed: log2(1 + SNR) with {}. Target {TARGET_RATE_BPS_HZ} bit/s/Hz.", budget());
    canvas::figure("Rate of the chosen beam at held-out keyframes", &line, |svg| {
        canvas::heading(svg, HEAD, "rate, bit/s/Hz");
        let top = HEAD + canvas::ROW;
        for (i, (text, sample)) in names.iter().enumerate() {
            canvas::name(svg, top + canvas::ROW * (i as f64 + 0.5), text, *sample);
        }
        rates(way, svg, (top, chart_height), free.as_deref())?;
        Ok(top + chart_height)
    })
}

fn rates(way: &Way, svg: &mut Svg, part: (f64, f64), free: Option<&[f64]>) -> Result<()> {
    let links = way.tracks.iter().flat_map(|t| &t.stops).map(|stop| stop.1.chosen_rate_bps_hz);
    let most = links.chain(way.truth.iter().map(|l| l.best_rate_bps_hz)).chain(free.iter().flat_map(|f| f.iter().copied()));
    let most = most.fold(TARGET_RATE_BPS_HZ, f64::max);
    let y = 0.0..1.06 * most;
    let mut plot = canvas::chart(svg, part, way.axis.range.clone(), y.clone(), way.axis.name)?;
    canvas::shade(&mut plot, way, &y);
    if let Some(free) = free {
        plot.line(way.axis.stops.iter().copied().zip(free.iter().copied()), FREE_SPACE);
    }
    plot.line([way.axis.range.start, way.axis.range.end].map(|x| (x, TARGET_RATE_BPS_HZ)), TARGET);
    canvas::line(&mut plot, way, way.truth.iter().map(|l| l.best_rate_bps_hz), INK, 6.0);
    for track in way.tracks.iter().rev() {
        let rates = track.stops.iter().map(|stop| stop.1.chosen_rate_bps_hz);
        canvas::line(&mut plot, way, rates, canvas::colour(track), canvas::width(track));
    }
    Ok(())
}
