//! Charts as inline SVG.

use crate::charts::{AxesFrame, PALETTE, Plot, Scale, Stroke, Svg, extent, without_size};
use crate::files::escape;
use crate::record::{HeldOutQuality, Numbers, Outcome, Record};

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
    let (low, high) = extent(values);
    let pad = (0.05 * (high - low)).max(1e-3);
    (low - pad, high + pad)
}

fn chart(title: &str, x: &str, y: &str, lines: &[Line], from_zero: bool) -> String {
    let points = || lines.iter().flat_map(|l| l.points.iter().copied());
    if points().next().is_none() {
        return String::new();
    }
    let (x_range, mut y_range) = (bounds(points().map(|p| p.0)), bounds(points().map(|p| p.1)));
    if from_zero {
        y_range.0 = 0.0;
    }
    let scales = Scale::linear(x_range.0.max(0.0).min(x_range.1 - 1e-3), x_range.1)
        .and_then(|x| Ok((x, Scale::linear(y_range.0, y_range.1)?)));
    // What no axis holds is said.
    let (x_scale, y_scale) = match scales {
        Ok(scales) => scales,
        Err(e) => return format!("<p class=\"note\">{}: {e}.</p>", escape::html(title)),
    };
    let mut svg = Svg::new(640, 380);
    let mut plot = Plot::new(&mut svg, AxesFrame { left: 80.0, top: 40.0, right: 628.0, bottom: 332.0 }, x_scale, y_scale);
    plot.title(title);
    plot.y_axis(y, true);
    plot.x_axis(x, true);
    for line in lines {
        let width = if line.row == 0 { 3.0 } else { 2.0 };
        plot.line(line.points.iter().copied(), Stroke::of(PALETTE[line.row % PALETTE.len()], width));
    }
    without_size(&svg.finish())
}

/// The rows with their colours.
fn legend(cells: &[(&str, &Numbers)]) -> String {
    let entry = |(row, (label, _)): (usize, &(&str, &Numbers))| {
        let [r, g, b] = PALETTE[row % PALETTE.len()];
        format!("<span><i style=\"background:rgb({r},{g},{b})\"></i>{}</span>", escape::html(label))
    };
    format!("<p class=\"legend\">{}</p>", cells.iter().enumerate().map(entry).collect::<String>())
}

/// PSNR of every held-out keyframe, both modalities.
pub(super) fn per_frame(records: &[Record]) -> String {
    let cells = first_cells(records);
    let lines = |of: fn(&crate::metrics::FrameMetrics) -> Option<f64>| -> Vec<Line> {
        let points = |n: &Numbers| n.frames.iter().filter_map(|f| Some(((f.index + 1) as f64, of(f)?))).collect::<Vec<_>>();
        cells.iter().enumerate().map(|(row, (_, n))| Line { row, points: points(n) }).filter(|l| !l.points.is_empty()).collect()
    };
    let radio = chart("PSNR of the spectrum (dB)", "keyframe", "dB", &lines(|f| Some(f.spectrum?.psnr_rf_scalar)), false);
    let light = chart("PSNR of the image", "keyframe", "dB", &lines(|f| Some(f.light?.psnr_opt)), false);
    format!("<div class=\"charts\">{radio}{light}</div>{}", legend(&cells))
}

/// Gaussians and progress over time.
pub(super) fn growth(records: &[Record]) -> String {
    let cells = first_cells(records);
    let lines = |of: fn(&crate::record::CurvePoint) -> Option<f64>| -> Vec<Line> {
        let points = |n: &Numbers| n.curve.iter().filter_map(|p| Some((p.seconds, of(p)?))).collect::<Vec<_>>();
        cells.iter().enumerate().map(|(row, (_, n))| Line { row, points: points(n) }).filter(|l| !l.points.is_empty()).collect()
    };
    let count = chart("Gaussians", "time, s", "count", &lines(|p| p.gaussians.map(|g| g as f64)), true);
    let with_gaussians: Vec<Line> = lines(|p| p.gaussians.map(|_| 100.0 * p.progress));
    let progress = chart("Work done", "time, s", "%", &with_gaussians, true);
    format!("<div class=\"charts\">{count}{progress}</div>{}", legend(&cells))
}

/// Held-out quality over time, of rows that were evaluated while they worked; nothing where none was.
pub(super) fn quality(records: &[Record]) -> String {
    let cells = first_cells(records);
    let lines = |of: fn(&HeldOutQuality) -> Option<f64>| -> Vec<Line> {
        let points = |n: &Numbers| n.curve.iter().filter_map(|p| Some((p.seconds, of(&p.held_out?)?))).collect::<Vec<_>>();
        cells.iter().enumerate().map(|(row, (_, n))| Line { row, points: points(n) }).filter(|l| !l.points.is_empty()).collect()
    };
    let radio = chart("Held-out PSNR of the spectrum (dB)", "time, s", "dB", &lines(|q| q.psnr_rf_scalar), false);
    let light = chart("Held-out PSNR of the image", "time, s", "dB", &lines(|q| q.psnr_opt), false);
    if radio.is_empty() && light.is_empty() {
        return String::new();
    }
    format!(
        "<div class=\"charts\">{radio}{light}</div>{}<p class=\"note\">Means over the held-out keyframes, of each row's first seed, while the field grows; \
         the evaluations are none of the seconds, and nothing of them is known to the method.</p>",
        legend(&cells)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_that_no_axis_holds_are_told_and_not_drawn() {
        let chart_of = |points: Vec<(f64, f64)>| chart("PSNR <b>", "x", "y", &[Line { row: 9, points }], false);
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
