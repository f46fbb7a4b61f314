//! The plot of an axis: its times and its memory, both logarithmic.

use super::table::{Quantity, quantities, values};
use super::{Axis, Point};
use crate::charts::log_axis::Decades;
use anyhow::{Result, anyhow};
use plotters::coord::Shift;
use plotters::prelude::*;

const SIZE: (u32, u32) = (980, 420);
const INK: RGBColor = RGBColor(27, 35, 48);
const COLOURS: [RGBColor; 5] =
    [RGBColor(10, 90, 208), RGBColor(232, 89, 12), RGBColor(43, 138, 62), RGBColor(103, 65, 217), RGBColor(90, 100, 115)];

type Panel<'a> = DrawingArea<SVGBackend<'a>, Shift>;

fn wrong(error: &dyn std::fmt::Display) -> anyhow::Error {
    anyhow!("cannot draw the plot: {error}")
}

/// The plot as SVG.
///
/// # Errors
/// Values that no axis holds.
pub fn svg(axis: Axis, points: &[&Point]) -> Result<String> {
    let points: Vec<Point> = points.iter().map(|p| (*p).clone()).collect();
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        root.fill(&WHITE).map_err(|e| wrong(&e))?;
        let panels = root.split_evenly((1, 2));
        let is_memory = |q: &&Quantity| q.key.ends_with("_mb");
        let drawn = || quantities(axis).iter().filter(|q| q.grows && q.key != "gaussians");
        draw(&panels[0], "time", axis, &points, &drawn().filter(|q| !is_memory(q)).collect::<Vec<_>>())?;
        draw(&panels[1], "memory", axis, &points, &drawn().filter(is_memory).collect::<Vec<_>>())?;
        root.present().map_err(|e| wrong(&e))?;
    }
    Ok(svg)
}

/// The bounds of some positive values with a margin; of none, a decade.
fn bounds(values: impl Iterator<Item = f64>) -> Decades {
    let (low, high) = values.fold((f64::INFINITY, 0.0_f64), |(low, high), v| (low.min(v), high.max(v)));
    if high > 0.0 { Decades(low / 1.6, high * 1.6) } else { Decades(1.0, 10.0) }
}

fn draw(panel: &Panel<'_>, what: &str, axis: Axis, points: &[Point], shown: &[&Quantity]) -> Result<()> {
    let series: Vec<(&Quantity, Vec<(f64, f64)>)> =
        shown.iter().map(|q| (*q, values(points, axis, q.key).collect())).filter(|(_, v): &(_, Vec<_>)| !v.is_empty()).collect();
    let all = || series.iter().flat_map(|(_, values)| values);
    let mut chart = ChartBuilder::on(panel)
        .caption(format!("{} over {}", what, axis.name()), ("sans-serif", 16))
        .margin(10)
        .x_label_area_size(38)
        .y_label_area_size(58)
        .build_cartesian_2d(bounds(all().map(|v| v.0)), bounds(all().map(|v| v.1)))
        .map_err(|e| wrong(&e))?;
    chart
        .configure_mesh()
        .x_desc(axis.name())
        .y_desc(what)
        .light_line_style(WHITE)
        .bold_line_style(RGBColor(223, 228, 234))
        .axis_style(INK)
        .draw()
        .map_err(|e| wrong(&e))?;
    for ((quantity, values), colour) in series.iter().zip(COLOURS.into_iter().cycle()) {
        chart
            .draw_series(LineSeries::new(values.iter().copied(), colour.stroke_width(2)))
            .map_err(|e| wrong(&e))?
            .label(quantity.heading)
            .legend(move |(x, y)| PathElement::new([(x, y), (x + 18, y)], colour.stroke_width(2)));
        chart.draw_series(values.iter().map(|v| Circle::new(*v, 4, colour.filled()))).map_err(|e| wrong(&e))?;
    }
    let mut legend = chart.configure_series_labels();
    legend.position(SeriesLabelPosition::UpperLeft).margin(10);
    legend.background_style(WHITE.mix(0.85)).border_style(RGBColor(223, 228, 234)).label_font(("sans-serif", 12));
    legend.draw().map_err(|e| wrong(&e))
}
