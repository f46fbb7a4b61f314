//! The figure of quality over time: PSNR rf over reconstruction time, our points beside the paper's. The paper draws more budgets than its
//! tables give times of; those that they do are drawn.

use super::published::{Family, Figure};
use super::{Beside, Line, Ours};
use crate::charts::log_axis::Decades;
use anyhow::{Result, anyhow};
use plotters::prelude::*;

const SIZE: (u32, u32) = (900, 540);
const INK: RGBColor = RGBColor(27, 35, 48);

/// Families with their names and colours.
const SERIES: [(&[Family], &str, RGBColor); 5] = [
    (&[Family::Nerf2], "NeRF²", RGBColor(103, 65, 217)),
    (&[Family::WrfGsPlus], "WRF-GS+", RGBColor(43, 138, 62)),
    (&[Family::Rf3dgs], "RF-3DGS", RGBColor(232, 89, 12)),
    (&[Family::CorfGs], "CORF-GS", RGBColor(10, 90, 208)),
    (&[Family::Uniform, Family::Frozen, Family::RfTuned], "ablations of CORF-GS", RGBColor(90, 100, 115)),
];

/// A point: seconds, PSNR in dB, half width of its interval.
type Point = (f64, f64, Option<f64>);

fn ours(line: &Line<'_, '_>) -> Option<Point> {
    match (line.cell(Figure::Time), line.cell(Figure::PsnrRf)) {
        (Ours::Value(seconds), Ours::Value(psnr)) if seconds.mean > 0.0 => Some((seconds.mean, psnr.mean, psnr.half_width_95)),
        _ => None,
    }
}

fn papers(line: &Line<'_, '_>, figures: &[Figure]) -> Option<Point> {
    let value = |figure: Figure| Some(line.paper.values[figures.iter().position(|f| *f == figure)?]);
    Some((value(Figure::Time)?, value(Figure::PsnrRf)?, None))
}

/// The points of a series over all tables, each once: ours and the paper's.
fn points(tables: &[Beside<'_, '_>], families: &[Family]) -> (Vec<Point>, Vec<Point>) {
    let (mut mine, mut theirs): (Vec<Point>, Vec<Point>) = (Vec::new(), Vec::new());
    let push = |list: &mut Vec<Point>, point: Option<Point>| list.extend(point.filter(|p| !list.contains(p)));
    for table in tables {
        for line in table.lines.iter().filter(|l| families.contains(&l.paper.family)) {
            push(&mut mine, ours(line));
            push(&mut theirs, papers(line, table.table.figures));
        }
    }
    (mine, theirs)
}

/// The figure as SVG.
///
/// # Errors
/// Records with times or figures that no axis holds.
pub(super) fn svg(tables: &[Beside<'_, '_>]) -> Result<String> {
    let series: Vec<_> = SERIES.iter().map(|(families, name, colour)| (points(tables, families), *name, *colour)).collect();
    let all = || series.iter().flat_map(|((mine, theirs), ..)| mine.iter().chain(theirs));
    let bounds = |of: fn(&Point) -> f64| all().map(of).fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
    let (seconds, psnr) = (bounds(|p| p.0), bounds(|p| p.1));
    let wrong = |e: &dyn std::fmt::Display| anyhow!("cannot draw the figure of quality over time: {e}");
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        root.fill(&WHITE).map_err(|e| wrong(&e))?;
        let mut chart = ChartBuilder::on(&root)
            .caption("Novel spectra: quality over reconstruction time", ("sans-serif", 18))
            .margin(12)
            .x_label_area_size(42)
            .y_label_area_size(54)
            .right_y_label_area_size(0)
            .build_cartesian_2d(Decades(seconds.0 / 1.6, seconds.1 * 1.6), psnr.0 - 1.0..psnr.1 + 1.0)
            .map_err(|e| wrong(&e))?;
        chart
            .configure_mesh()
            .x_desc("reconstruction time, s (logarithmic)")
            .y_desc("PSNR rf, dB")
            .y_label_formatter(&|v: &f64| format!("{v:.0}"))
            .light_line_style(WHITE)
            .bold_line_style(RGBColor(223, 228, 234))
            .draw()
            .map_err(|e| wrong(&e))?;
        for ((mine, theirs), name, colour) in &series {
            let colour = *colour;
            let rings = theirs.iter().map(|p| Circle::new((p.0, p.1), 5, colour.stroke_width(2)));
            chart.draw_series(rings).map_err(|e| wrong(&e))?;
            let bars = mine.iter().filter_map(|p| Some((p, p.2?)));
            let bars = bars.map(|(p, h)| PathElement::new([(p.0, p.1 - h), (p.0, p.1 + h)], colour.stroke_width(2)));
            chart.draw_series(bars).map_err(|e| wrong(&e))?;
            let dots = mine.iter().map(|p| Circle::new((p.0, p.1), 5, colour.filled()));
            let label = if mine.is_empty() { format!("{name} (ours not run)") } else { (*name).to_owned() };
            chart
                .draw_series(dots)
                .map_err(|e| wrong(&e))?
                .label(label)
                .legend(move |(x, y)| Circle::new((x + 9, y), 5, colour.filled()));
        }
        for (text, filled) in [("ours, with 95 % interval", true), ("the paper's (RTX 4090, other data)", false)] {
            let style = if filled { INK.filled() } else { INK.stroke_width(2) };
            chart
                .draw_series(std::iter::empty::<Circle<(f64, f64), i32>>())
                .map_err(|e| wrong(&e))?
                .label(text)
                .legend(move |(x, y)| Circle::new((x + 9, y), 5, style));
        }
        let mut legend = chart.configure_series_labels();
        legend.position(SeriesLabelPosition::LowerLeft).margin(12);
        legend.background_style(WHITE.mix(0.85)).border_style(RGBColor(223, 228, 234)).label_font(("sans-serif", 13));
        legend.draw().map_err(|e| wrong(&e))?;
        root.present().map_err(|e| wrong(&e))?;
    }
    Ok(svg)
}
