//! The plot of an axis: its times and its memory, both logarithmic.

use super::table::{Measure, quantities, values};
use super::{Axis, ScalePoint};
use crate::charts::{AxesFrame, Corner, LegendMark, PALETTE, Plot, Scale, Stroke, Svg, extent};
use anyhow::Result;

const WIDTH: u32 = 980;
const HEIGHT: u32 = 420;

/// The plot as SVG.
///
/// # Errors
/// Values that no axis holds.
pub fn svg(axis: Axis, points: &[&ScalePoint]) -> Result<String> {
    let points: Vec<ScalePoint> = points.iter().map(|p| (*p).clone()).collect();
    let mut svg = Svg::new(WIDTH, HEIGHT);
    let is_memory = |q: &&Measure| q.key.ends_with("_mb");
    let drawn = || quantities(axis).iter().filter(|q| q.grows && q.key != "gaussians");
    let half = f64::from(WIDTH) / 2.0;
    draw(&mut svg, 0.0, "time", axis, &points, &drawn().filter(|q| !is_memory(q)).collect::<Vec<_>>())?;
    draw(&mut svg, half, "memory", axis, &points, &drawn().filter(is_memory).collect::<Vec<_>>())?;
    Ok(svg.finish())
}

/// An axis over some positive values with a margin; of none, a decade.
fn scale(values: impl Iterator<Item = f64>) -> Result<Scale> {
    let (low, high) = extent(values);
    if high > 0.0 { Scale::logarithmic(low / 1.6, high * 1.6) } else { Scale::logarithmic(1.0, 10.0) }
}

fn draw(svg: &mut Svg, left: f64, what: &str, axis: Axis, points: &[ScalePoint], shown: &[&Measure]) -> Result<()> {
    let series: Vec<(&Measure, Vec<(f64, f64)>)> =
        shown.iter().map(|q| (*q, values(points, axis, q.key).collect())).filter(|(_, v): &(_, Vec<_>)| !v.is_empty()).collect();
    let all = || series.iter().flat_map(|(_, values)| values);
    let frame = AxesFrame { left: left + 82.0, top: 40.0, right: left + 478.0, bottom: f64::from(HEIGHT) - 48.0 };
    let mut plot = Plot::new(svg, frame, scale(all().map(|v| v.0))?, scale(all().map(|v| v.1))?);
    plot.title(&format!("{} over {}", what, axis.name()));
    plot.y_axis(what, true);
    plot.x_axis(axis.name(), true);
    let mut legend = Vec::new();
    for ((quantity, values), colour) in series.iter().zip(PALETTE.into_iter().cycle()) {
        let stroke = Stroke::of(colour, 2.0);
        plot.line(values.iter().copied(), stroke);
        plot.points(values.iter().copied(), 4.0, colour, true);
        legend.push((LegendMark::Line(stroke), quantity.heading));
    }
    plot.legend(Corner::TopLeft, &legend);
    Ok(())
}
