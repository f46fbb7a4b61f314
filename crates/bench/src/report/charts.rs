//! Charts as inline SVG.

use crate::files::escape;
use crate::record::{Numbers, Outcome, Record};
use anyhow::{Result, anyhow};
use plotters::prelude::*;

/// Colours of the rows, in the plan's order.
pub(super) const PALETTE: [RGBColor; 14] = [
    RGBColor(10, 90, 208),
    RGBColor(232, 89, 12),
    RGBColor(43, 138, 62),
    RGBColor(194, 37, 92),
    RGBColor(103, 65, 217),
    RGBColor(90, 100, 115),
    RGBColor(12, 133, 153),
    RGBColor(150, 110, 20),
    RGBColor(224, 49, 170),
    RGBColor(116, 184, 22),
    RGBColor(77, 171, 247),
    RGBColor(134, 46, 20),
    RGBColor(250, 176, 5),
    RGBColor(20, 20, 20),
];

/// Axes longer than this have no ticks to be read.
const LARGEST_SPAN: f64 = 1e15;

/// A row's line: its place among the rows, which gives its colour, and its points.
struct Line {
    row: usize,
    points: Vec<(f64, f64)>,
}

/// The first finished cell of every row.
pub(super) fn first_cells(records: &[Record]) -> Vec<(&str, &Numbers)> {
    let mut cells: Vec<(&str, &Numbers)> = Vec::new();
    for record in records {
        if let Outcome::Done(numbers) = &record.outcome
            && !cells.iter().any(|c| c.0 == record.row)
        {
            cells.push((&record.row, numbers));
        }
    }
    cells
}

fn bounds(values: impl Iterator<Item = f64>) -> (f64, f64) {
    let (low, high) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    let pad = (0.05 * (high - low)).max(1e-3);
    (low - pad, high + pad)
}

/// A tick's number: no more digits than it has, and those of its rounding left out.
fn tick(value: &f64) -> String {
    let text = format!("{value:.9}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

fn chart(title: &str, x: &str, y: &str, lines: &[Line], from_zero: bool) -> Result<String> {
    let points = || lines.iter().flat_map(|l| l.points.iter().copied());
    if points().next().is_none() {
        return Ok(String::new());
    }
    let (x_range, mut y_range) = (bounds(points().map(|p| p.0)), bounds(points().map(|p| p.1)));
    if from_zero {
        y_range.0 = 0.0;
    }
    // An axis needs room for its ticks: what cannot be drawn is said, for drawing would not end well.
    let spans = [x_range, y_range].map(|(low, high)| (low, high, high - low));
    if spans
        .iter()
        .any(|(low, high, span)| !(span.is_finite() && *span > 1e-9 * low.abs().max(high.abs()) && *span < LARGEST_SPAN))
    {
        return Ok(format!(
            "<p class=\"note\">{}: values from {:.3e} to {:.3e} cannot be drawn.</p>",
            escape::html(title),
            y_range.0,
            y_range.1
        ));
    }
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (640, 380)).into_drawing_area();
        let wrong = |e: &dyn std::fmt::Display| anyhow!("cannot draw the chart \"{title}\": {e}");
        root.fill(&WHITE).map_err(|e| wrong(&e))?;
        let mut chart = ChartBuilder::on(&root)
            .caption(title, ("sans-serif", 17))
            .margin(10)
            .x_label_area_size(38)
            .y_label_area_size(58)
            .build_cartesian_2d(x_range.0.max(0.0).min(x_range.1 - 1e-3)..x_range.1, y_range.0..y_range.1)
            .map_err(|e| wrong(&e))?;
        chart
            .configure_mesh()
            .x_desc(x)
            .y_desc(y)
            .x_label_formatter(&tick)
            .y_label_formatter(&tick)
            .light_line_style(RGBColor(240, 242, 245))
            .bold_line_style(RGBColor(223, 228, 234))
            .draw()
            .map_err(|e| wrong(&e))?;
        for line in lines {
            let style = PALETTE[line.row % PALETTE.len()].stroke_width(if line.row == 0 { 3 } else { 2 });
            chart.draw_series(LineSeries::new(line.points.iter().copied(), style)).map_err(|e| wrong(&e))?;
        }
        root.present().map_err(|e| wrong(&e))?;
    }
    // A fixed size would not shrink with the page.
    Ok(svg.replacen("width=\"640\" height=\"380\"", "", 1))
}

/// The rows with their colours.
fn legend(cells: &[(&str, &Numbers)]) -> String {
    let entry = |(row, (label, _)): (usize, &(&str, &Numbers))| {
        let RGBColor(r, g, b) = PALETTE[row % PALETTE.len()];
        format!("<span><i style=\"background:rgb({r},{g},{b})\"></i>{}</span>", escape::html(label))
    };
    format!("<p class=\"legend\">{}</p>", cells.iter().enumerate().map(entry).collect::<String>())
}

/// PSNR of every held-out keyframe, both modalities.
pub(super) fn per_frame(records: &[Record]) -> Result<String> {
    let cells = first_cells(records);
    let lines = |of: fn(&crate::metrics::FrameMetrics) -> Option<f64>| -> Vec<Line> {
        let points = |n: &Numbers| n.frames.iter().filter_map(|f| Some(((f.index + 1) as f64, of(f)?))).collect::<Vec<_>>();
        cells.iter().enumerate().map(|(row, (_, n))| Line { row, points: points(n) }).filter(|l| !l.points.is_empty()).collect()
    };
    let rf = chart("PSNR of the Jet spectrum", "keyframe", "dB", &lines(|f| Some(f.spectrum?.psnr_rf_jet)), false)?;
    let optical = chart("PSNR of the image", "keyframe", "dB", &lines(|f| Some(f.light?.psnr_opt)), false)?;
    Ok(format!("<div class=\"charts\">{rf}{optical}</div>{}", legend(&cells)))
}

/// Gaussians and progress over time.
pub(super) fn growth(records: &[Record]) -> Result<String> {
    let cells = first_cells(records);
    let lines = |of: fn(&crate::record::CurvePoint) -> Option<f64>| -> Vec<Line> {
        let points = |n: &Numbers| n.curve.iter().filter_map(|p| Some((p.seconds, of(p)?))).collect::<Vec<_>>();
        cells.iter().enumerate().map(|(row, (_, n))| Line { row, points: points(n) }).filter(|l| !l.points.is_empty()).collect()
    };
    let count = chart("Gaussians", "time, s", "count", &lines(|p| p.gaussians.map(|g| g as f64)), true)?;
    let with_gaussians: Vec<Line> = lines(|p| p.gaussians.map(|_| 100.0 * p.progress));
    let progress = chart("Work done", "time, s", "%", &with_gaussians, true)?;
    Ok(format!("<div class=\"charts\">{count}{progress}</div>{}", legend(&cells)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_that_no_axis_holds_are_told_and_not_drawn() {
        let chart_of = |points: Vec<(f64, f64)>| chart("PSNR <b>", "x", "y", &[Line { row: 9, points }], false).unwrap();
        for points in [
            vec![(0.0, 1.7e308), (1.0, 2.0)],
            vec![(0.0, -1.7e308), (1.0, 1.7e308)],
            vec![(0.0, 1e300), (1.0, 1e300)],
            vec![(0.0, f64::NAN), (1.0, f64::INFINITY)],
            vec![(f64::NAN, f64::NAN)],
            vec![(1.7e308, 0.0), (0.0, 1.0)],
        ] {
            assert!(chart_of(points.clone()).contains("cannot be drawn"), "{points:?}");
        }
        for points in [vec![(0.0, 20.0), (1.0, 21.0)], vec![(1.0, 5.0)], vec![(-3.0, 1e9), (-2.0, 1e12)], vec![(0.0, 0.0)]] {
            let svg = chart_of(points.clone());
            assert!(svg.contains("<svg") && !svg.contains("<b>"), "{points:?}");
        }
    }
}
