//! The figure of quality over time: PSNR rf over reconstruction time, our points beside the paper's. The paper draws more budgets than its
//! tables give times of; those that they do are drawn.

use super::published::{Figure, PaperMethod};
use super::{Beside, Ours, PaperLine};
use crate::charts::{AxesFrame, Colour, Corner, INK, LegendMark, Plot, Scale, Svg, extent};
use anyhow::Result;

/// Families with their names and colours.
const SERIES: [(&[PaperMethod], &str, Colour); 5] = [
    (&[PaperMethod::Nerf2], "NeRF²", [103, 65, 217]),
    (&[PaperMethod::WrfGsPlus], "WRF-GS+", [43, 138, 62]),
    (&[PaperMethod::Rf3dgs], "RF-3DGS", [232, 89, 12]),
    (&[PaperMethod::CorfGs], "CORF-GS", [10, 90, 208]),
    (&[PaperMethod::Uniform, PaperMethod::Frozen, PaperMethod::RadioTuned], "ablations of CORF-GS", [90, 100, 115]),
];

/// A point: seconds, PSNR in dB, half width of its interval.
type Point = (f64, f64, Option<f64>);

fn ours(line: &PaperLine<'_, '_>) -> Option<Point> {
    match (line.cell(Figure::Time), line.cell(Figure::PsnrRadio)) {
        (Ours::Value(seconds), Ours::Value(psnr)) if seconds.mean > 0.0 => Some((seconds.mean, psnr.mean, psnr.half_width_95)),
        _ => None,
    }
}

fn papers(line: &PaperLine<'_, '_>, figures: &[Figure]) -> Option<Point> {
    let value = |figure: Figure| Some(line.paper.values[figures.iter().position(|f| *f == figure)?]);
    Some((value(Figure::Time)?, value(Figure::PsnrRadio)?, None))
}

/// The points of a series over all tables, each once: ours and the paper's.
fn points(tables: &[Beside<'_, '_>], families: &[PaperMethod]) -> (Vec<Point>, Vec<Point>) {
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
    let (seconds, psnr) = (extent(all().map(|p| p.0)), extent(all().map(|p| p.1)));
    let (x, y) = (Scale::logarithmic(seconds.0 / 1.6, seconds.1 * 1.6)?, Scale::linear(psnr.0 - 1.0, psnr.1 + 1.0)?);
    let mut svg = Svg::new(900, 540);
    let mut plot = Plot::new(&mut svg, AxesFrame { left: 64.0, top: 42.0, right: 886.0, bottom: 490.0 }, x, y);
    plot.title("Novel spectra: quality over reconstruction time");
    plot.y_axis("PSNR rf, dB", true);
    plot.x_axis("reconstruction time, s (logarithmic)", true);
    let mut legend = Vec::new();
    for ((mine, theirs), name, colour) in &series {
        plot.points(theirs.iter().map(|p| (p.0, p.1)), 5.0, *colour, false);
        for (seconds, psnr, half) in mine {
            half.iter().for_each(|half| plot.interval((*seconds, *psnr), *half, *colour));
        }
        plot.points(mine.iter().map(|p| (p.0, p.1)), 5.0, *colour, true);
        let label = if mine.is_empty() { format!("{name} (ours not run)") } else { (*name).to_owned() };
        legend.push((LegendMark::Disc(*colour), label));
    }
    legend.push((LegendMark::Disc(INK), "ours, with 95 % interval".to_owned()));
    legend.push((LegendMark::Ring(INK), "the paper's (RTX 4090, other data)".to_owned()));
    plot.legend(Corner::BottomLeft, &legend.iter().map(|(mark, text)| (*mark, text.as_str())).collect::<Vec<_>>());
    Ok(svg.finish())
}
