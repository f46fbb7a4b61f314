//! What figures along the way are drawn with: one width, a column of names at the left, charts over one axis at the right.

use super::{Track, Way};
use crate::report::charts::PALETTE;
use anyhow::{Result, anyhow};
use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use std::ops::Range;

/// Width of a figure, pixels.
const WIDTH: u32 = 1000;
/// Width of the column of names.
const NAMES: u32 = 268;
/// Space at the right.
const RIGHT: u32 = 16;
/// Height of a title with its line of explanation.
pub(super) const HEAD: i32 = 58;
/// Height of a chart's axis.
pub(super) const AXIS: i32 = 40;
/// Height of a row of a strip, or of a name.
pub(super) const ROW: i32 = 22;
/// Longest name that has room, characters.
const LONGEST_NAME: usize = 36;
/// Size of labels.
const LABEL: i32 = 14;
/// Width of a character of a label, about.
const CHARACTER: f64 = 6.3;
/// Narrowest mark that a number of up to three characters has room in, pixels.
const NARROWEST_NUMBERED: f64 = 21.0;
/// Axes longer than this have no ticks to be read.
const LARGEST: f64 = 1e9;

pub(super) const INK: RGBColor = RGBColor(27, 35, 48);
pub(super) const DIM: RGBColor = RGBColor(93, 106, 124);
const GRID: RGBColor = RGBColor(228, 232, 237);
const SHADE: RGBColor = RGBColor(226, 228, 233);

pub(super) const GOOD: RGBColor = RGBColor(178, 222, 190);
pub(super) const FAIR: RGBColor = RGBColor(250, 196, 70);
pub(super) const BAD: RGBColor = RGBColor(200, 40, 60);
pub(super) const OUT: RGBColor = RGBColor(62, 72, 90);

/// A figure, or a part of it.
pub(super) type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
/// A chart in it.
pub(super) type Chart<'a, 'b> = ChartContext<'b, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

pub(super) fn wrong(error: impl std::fmt::Display) -> anyhow::Error {
    anyhow!("cannot draw the figures along the way: {error}")
}

/// A figure of a height, with a title and a line of explanation.
pub(super) fn figure(height: i32, title: &str, line: &str, draw: impl FnOnce(&Area<'_>) -> Result<()>) -> Result<String> {
    let mut svg = String::new();
    {
        let root = SVGBackend::with_string(&mut svg, (WIDTH, height as u32)).into_drawing_area();
        root.fill(&WHITE).map_err(wrong)?;
        write(&root, title, (14, 22), 20, INK, HPos::Left)?;
        write(&root, line, (14, 45), 14, DIM, HPos::Left)?;
        draw(&root)?;
        root.present().map_err(wrong)?;
    }
    Ok(svg)
}

/// An SVG that takes the width it is given.
pub(super) fn without_size(svg: &str) -> String {
    let end = svg.find('>').unwrap_or(0);
    let (head, rest) = svg.split_at(end);
    let kept = |word: &&str| !word.starts_with("width=") && !word.starts_with("height=");
    // The viewBox has blanks between its numbers and stays whole.
    head.split(' ').filter(kept).collect::<Vec<_>>().join(" ") + rest
}

/// Text whose middle is at the height of `at`.
pub(super) fn write(area: &Area<'_>, text: &str, at: (i32, i32), size: i32, colour: RGBColor, from: HPos) -> Result<()> {
    let style = TextStyle::from(("sans-serif", size).into_font()).color(&colour).pos(Pos::new(from, VPos::Center));
    area.draw(&Text::new(text.to_owned(), at, style)).map_err(wrong)
}

/// The part of a figure between two heights.
pub(super) fn part<'a>(root: &Area<'a>, top: i32, height: i32) -> Area<'a> {
    root.clone().shrink((0, top), (WIDTH, height as u32))
}

/// A chart over an axis in a part of a figure; without a name the axis has no ticks.
pub(super) fn chart<'a, 'b>(
    area: &'b Area<'a>,
    x: Range<f64>,
    y: Range<f64>,
    name: Option<&str>,
    ticks: bool,
) -> Result<Chart<'a, 'b>> {
    if !(x.end - x.start).is_finite() || x.end.abs().max(y.end.abs()) > LARGEST {
        return Err(wrong(format!("values up to {:.3e} are beyond an axis", x.end.abs().max(y.end.abs()))));
    }
    let mut chart = ChartBuilder::on(area)
        .margin_right(RIGHT)
        .set_label_area_size(LabelAreaPosition::Left, NAMES)
        .set_label_area_size(LabelAreaPosition::Bottom, if name.is_some() { AXIS } else { 0 })
        .build_cartesian_2d(x, y)
        .map_err(wrong)?;
    let mut mesh = chart.configure_mesh();
    mesh.disable_x_mesh().light_line_style(TRANSPARENT).bold_line_style(GRID).axis_style(DIM).label_style(("sans-serif", LABEL));
    mesh.x_label_formatter(&tick).y_label_formatter(&tick);
    match name {
        Some(name) => mesh.x_desc(name).axis_desc_style(("sans-serif", LABEL)),
        None => mesh.x_labels(0),
    };
    if !ticks {
        mesh.disable_y_mesh().disable_y_axis().y_labels(0);
    }
    mesh.draw().map_err(wrong)?;
    Ok(chart)
}

/// A tick's number without the digits of its rounding.
fn tick(value: &f64) -> String {
    let text = format!("{value:.6}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// Shades the places at which the best beam is in outage.
pub(super) fn shade(chart: &mut Chart<'_, '_>, way: &Way, y: &Range<f64>) -> Result<()> {
    let half = way.axis.half_width;
    let bars = way.out_of_service().map(|at| Rectangle::new([(at - half, y.start), (at + half, y.end)], SHADE.filled()));
    chart.draw_series(bars).map_err(wrong)?;
    Ok(())
}

/// A line through a row's values, with its points.
pub(super) fn line(
    chart: &mut Chart<'_, '_>,
    way: &Way,
    values: impl Iterator<Item = f64>,
    colour: RGBColor,
    width: u32,
) -> Result<()> {
    let points: Vec<(f64, f64)> = way.axis.stops.iter().copied().zip(values).collect();
    chart.draw_series(LineSeries::new(points.iter().copied(), colour.stroke_width(width))).map_err(wrong)?;
    chart.draw_series(points.iter().map(|p| Circle::new(*p, width + 1, colour.filled()))).map_err(wrong)?;
    Ok(())
}

/// A row's colour.
pub(super) fn colour(track: &Track) -> RGBColor {
    PALETTE[track.row % PALETTE.len()]
}

/// What stands before a name.
#[derive(Clone, Copy)]
pub(super) enum Sample {
    /// A line of a row's colour.
    Line(RGBColor),
    /// A line in strokes of a length.
    Dashed(i32, RGBColor),
    /// The shade of [`shade`].
    Shade,
}

/// A name in the column at the left, behind a sample of what it names.
pub(super) fn name(root: &Area<'_>, y: i32, text: &str, sample: Sample) -> Result<()> {
    const FROM: i32 = 14;
    const TO: i32 = 34;
    let bar = |from: i32, to: i32, half: i32, colour: RGBColor| {
        root.draw(&Rectangle::new([(from, y - half), (to, y + half)], colour.filled())).map_err(wrong)
    };
    match sample {
        Sample::Line(colour) => bar(FROM, TO, 2, colour)?,
        Sample::Dashed(stroke, colour) => {
            let strokes = (FROM..TO).step_by(2 * stroke as usize);
            strokes.into_iter().try_for_each(|from| bar(from, (from + stroke).min(TO), 1, colour))?;
        }
        Sample::Shade => bar(FROM, TO, 8, SHADE)?,
    }
    let long = text.chars().count() > LONGEST_NAME;
    let text = if long { text.chars().take(LONGEST_NAME - 1).chain(['…']).collect() } else { text.to_owned() };
    write(root, &text, (TO + 8, y), LABEL, INK, HPos::Left)
}

/// A cell of a strip.
pub(super) struct Cell {
    pub colour: RGBColor,
    /// A word in it, if there is room, in its own colour.
    pub word: Option<(String, RGBColor)>,
}

/// Rows of cells, one a held-out keyframe, under the keyframes' numbers; returns the height at which it ends.
pub(super) fn strips(root: &Area<'_>, way: &Way, top: i32, rows: &[Vec<Cell>], axis_name: Option<&str>) -> Result<i32> {
    let count = rows.len() as f64;
    let height = ROW * rows.len() as i32 + if axis_name.is_some() { AXIS } else { 0 };
    let area = part(root, top + ROW, height);
    let mut chart = chart(&area, way.axis.range.clone(), 0.0..count, axis_name, false)?;
    let half = way.axis.half_width;
    for (row, cells) in rows.iter().enumerate() {
        let (high, low) = (count - row as f64 - 0.08, count - row as f64 - 0.92);
        let boxes = way
            .axis
            .stops
            .iter()
            .zip(cells)
            .map(|(at, cell)| Rectangle::new([(at - half, low), (at + half, high)], cell.colour.filled()));
        chart.draw_series(boxes).map_err(wrong)?;
    }
    let plot = f64::from(WIDTH - NAMES - RIGHT);
    let x = |at: f64| {
        NAMES as i32 + ((at - way.axis.range.start) / (way.axis.range.end - way.axis.range.start) * plot).round() as i32
    };
    if way.axis.mark_share() * plot >= NARROWEST_NUMBERED {
        for (i, at) in way.axis.stops.iter().enumerate() {
            write(root, &way.axis.numbers[i].to_string(), (x(*at), top + ROW / 2 + 2), 12, DIM, HPos::Center)?;
            for (row, cells) in rows.iter().enumerate() {
                if let Some((word, colour)) = cells.get(i).and_then(|cell| cell.word.as_ref()) {
                    write(root, word, (x(*at), top + ROW + row as i32 * ROW + ROW / 2), 12, *colour, HPos::Center)?;
                }
            }
        }
        write(root, "keyframe", (NAMES as i32 - 8, top + ROW / 2 + 2), 12, DIM, HPos::Right)?;
    }
    Ok(top + ROW + height)
}

/// What the colours of a strip mean, in lines as wide as there is room; returns the height at which it ends.
pub(super) fn key(root: &Area<'_>, top: i32, entries: &[(RGBColor, &str)]) -> Result<i32> {
    let (mut x, mut y) = (NAMES as i32, top + ROW / 2);
    for (colour, text) in entries {
        let width = 34 + (CHARACTER * text.chars().count() as f64) as i32;
        if x + width > WIDTH as i32 && x > NAMES as i32 {
            (x, y) = (NAMES as i32, y + ROW);
        }
        root.draw(&Rectangle::new([(x, y - 6), (x + 14, y + 6)], colour.filled())).map_err(wrong)?;
        write(root, text, (x + 20, y), LABEL, INK, HPos::Left)?;
        x += width;
    }
    Ok(y + ROW / 2)
}

/// The heading of a chart, over its axis.
pub(super) fn heading(root: &Area<'_>, top: i32, text: &str) -> Result<()> {
    write(root, text, (NAMES as i32, top + ROW / 2), LABEL, INK, HPos::Left)
}
