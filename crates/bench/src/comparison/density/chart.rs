//! Metrics over the distance to the nearest training pose, one under the other.

use super::Results;
use crate::charts::{Anchor, AxesFrame, Corner, DIM, INK, LegendMark, PALETTE, Plot, Scale, Stroke, Svg, extent};
use crate::metrics::Column;
use crate::metrics::stats::summarize;
use anyhow::{Context, Result};

const WIDTH: u32 = 760;
/// Height of a part with its title and axis, pixels.
const PART: f64 = 360.0;
/// Lengths of a lookup's strokes, pixels.
const DASH: f64 = 6.0;
/// Height of the legend's ends and of a line of it, pixels.
const LEGEND: [f64; 2] = [28.0, 18.0];
/// Least distance on the logarithmic axis, metres: of data sets with keyframes at one place.
const LEAST_M: f64 = 1e-4;

/// The figure as SVG: learned rows in whole lines, lookups dashed, intervals over seeds, and a vertical line where a row overtakes copying.
///
/// # Errors
/// Values that no axis holds.
pub(super) fn svg(results: &Results, metrics: &[&Column]) -> Result<String> {
    let mut svg = Svg::new(WIDTH, (PART * metrics.len() as f64) as u32 + 10);
    let distance = |m: f64| m.max(LEAST_M);
    let (low, high) = extent(results.steps.iter().map(|step| distance(step.nearest_training_m)));
    let x = Scale::logarithmic(low / 1.25, high * 1.25).context("cannot draw distances")?;
    for (at, metric) in metrics.iter().enumerate() {
        let ends =
            results.steps.iter().flat_map(|step| &step.rows).filter_map(|row| summarize(&row.values(metric.key))).flat_map(|s| {
                let half = s.half_width_95.unwrap_or(0.0);
                [s.mean - half, s.mean + half]
            });
        let ends: Vec<f64> = ends.collect();
        if ends.is_empty() {
            svg.text(
                (14.0, PART * at as f64 + 30.0),
                &format!("{}: no cell is finished", metric.heading),
                14.0,
                INK,
                Anchor::Start,
            );
            continue;
        }
        let (low, high) = extent(ends.into_iter());
        let pad = (0.1 * (high - low)).max(1e-3 * high.abs()).max(1e-3);
        let top = PART * at as f64;
        let frame = AxesFrame { left: 84.0, top: top + 40.0, right: f64::from(WIDTH) - 20.0, bottom: top + PART - 50.0 };
        let rows = results.steps.first().map_or(&[][..], |step| &step.rows);
        // The legend stands below all that is drawn, as far as half of the frame goes.
        let legend_height = LEGEND[0] + LEGEND[1] * (rows.len() + 1) as f64;
        let share = (legend_height / (frame.bottom - frame.top)).min(0.5);
        let (low, high) = (low - pad, high + pad);
        let low = high - (high - low) / (1.0 - share);
        let y = Scale::linear(low, high).with_context(|| format!("cannot draw {}", metric.key))?;
        let mut plot = Plot::new(&mut svg, frame, x, y);
        plot.title(metric.heading);
        plot.y_axis("", true);
        plot.x_axis("median distance to the nearest training pose, m", true);
        let mut legend = Vec::new();
        for ((number, row), colour) in rows.iter().enumerate().zip(PALETTE.into_iter().cycle()) {
            let stroke = Stroke { dash: row.looks_up.then_some(DASH), ..Stroke::of(colour, 2.0) };
            let points: Vec<_> = results
                .steps
                .iter()
                .filter_map(|step| {
                    Some((distance(step.nearest_training_m), summarize(&step.rows.get(number)?.values(metric.key))?))
                })
                .collect();
            plot.line(points.iter().map(|(m, s)| (*m, s.mean)), stroke);
            plot.points(points.iter().map(|(m, s)| (*m, s.mean)), 4.0, colour, !row.looks_up);
            for (m, summary) in &points {
                if let Some(half) = summary.half_width_95 {
                    plot.interval((*m, summary.mean), half, colour);
                }
            }
            let mine = results.overtaking.iter().find(|o| o.metric == metric.key && o.row == row.row);
            if let Some(place) = mine.and_then(|o| o.distance_m).map(distance) {
                plot.line([(place, low), (place, high)], Stroke { dash: Some(2.0), ..Stroke::of(colour, 1.0) });
            }
            legend.push((LegendMark::Line(stroke), row.row.as_str()));
        }
        legend.push((LegendMark::Line(Stroke { dash: Some(2.0), ..Stroke::of(DIM, 1.0) }), "a row overtakes copying"));
        plot.legend(Corner::BottomLeft, &legend);
    }
    Ok(svg.finish())
}
