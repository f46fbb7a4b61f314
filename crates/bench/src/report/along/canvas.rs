//! What figures along the way are drawn with: one width, a column of names at the left, charts over one axis at the right.

use super::{Track, Way};
use crate::charts::{Anchor, AxesFrame, Colour, DIM, INK, PALETTE, Plot, Scale, Stroke, Svg, text_width};
use anyhow::{Context, Result};
use std::ops::Range;

/// Width of a figure, pixels.
const WIDTH: f64 = 1000.0;
/// Width of the column of names.
const NAMES: f64 = 300.0;
/// Space at the right.
const RIGHT: f64 = 16.0;
/// Height of a title with its line of explanation.
pub(super) const HEAD: f64 = 58.0;
/// Height of a chart's axis.
pub(super) const AXIS: f64 = 40.0;
/// Height of a row of a strip, or of a name.
pub(super) const ROW: f64 = 22.0;
/// Longest name that has room, characters.
const LONGEST_NAME: usize = 30;
/// Size of labels.
const LABEL: f64 = 13.0;
/// Size of numbers in cells and over them.
const NUMBER: f64 = 12.0;
/// Narrowest mark that a number of up to three characters has room in, pixels.
const NARROWEST_NUMBERED: f64 = 21.0;
const SHADE: Colour = [226, 228, 233];

pub(super) const GOOD: Colour = [178, 222, 190];
pub(super) const FAIR: Colour = [250, 196, 70];
pub(super) const BAD: Colour = [200, 40, 60];
pub(super) const OUT: Colour = [62, 72, 90];

/// Space under a figure's last part.
const FOOT: f64 = 14.0;

/// A figure with a title and a line of explanation; `draw` returns the height at which its last part ends, and the figure ends behind it.
pub(super) fn figure(title: &str, line: &str, draw: impl FnOnce(&mut Svg) -> Result<f64>) -> Result<String> {
    let mut svg = Svg::new(WIDTH as u32, 0);
    svg.text((14.0, 22.0), title, 20.0, INK, Anchor::Start);
    svg.text((14.0, 45.0), line, LABEL, DIM, Anchor::Start);
    let end = draw(&mut svg).context("cannot draw the figures along the way")?;
    svg.set_height((end + FOOT).ceil() as u32);
    Ok(svg.finish())
}

/// A chart over an axis in a part of a figure, from `top` on and of a height that the x axis is a part of.
pub(super) fn chart<'s>(
    svg: &'s mut Svg,
    (top, height): (f64, f64),
    x: Range<f64>,
    y: Range<f64>,
    name: &str,
) -> Result<Plot<'s>> {
    let frame = AxesFrame { left: NAMES, top, right: WIDTH - RIGHT, bottom: top + height - AXIS };
    let mut plot = Plot::new(svg, frame, Scale::linear(x.start, x.end)?, Scale::linear(y.start, y.end)?);
    plot.y_axis("", true);
    plot.x_axis(name, false);
    Ok(plot)
}

/// Shades the places at which the best beam is in outage.
pub(super) fn shade(plot: &mut Plot<'_>, way: &Way, y: &Range<f64>) {
    let half = way.axis.half_width;
    way.out_of_service().for_each(|at| plot.bar([(at - half, y.start), (at + half, y.end)], SHADE));
}

/// A line through a row's values, with its points.
pub(super) fn line(plot: &mut Plot<'_>, way: &Way, values: impl Iterator<Item = f64>, colour: Colour, width: f64) {
    let points: Vec<(f64, f64)> = way.axis.stops.iter().copied().zip(values).collect();
    plot.line(points.iter().copied(), Stroke::of(colour, width));
    plot.points(points, width + 1.0, colour, true);
}

/// Width of a row's line: the first row's is the widest.
pub(super) fn width(track: &Track) -> f64 {
    if track.row == 0 { 3.0 } else { 2.0 }
}

/// A row's colour.
pub(super) fn colour(track: &Track) -> Colour {
    PALETTE[track.row % PALETTE.len()]
}

/// What stands before a name.
#[derive(Clone, Copy)]
pub(super) enum Sample {
    /// A line.
    Line(Stroke),
    /// The shade of [`shade`].
    Shade,
}

/// A name in the column at the left, behind a sample of what it names.
pub(super) fn name(svg: &mut Svg, y: f64, text: &str, sample: Sample) {
    const FROM: f64 = 14.0;
    const TO: f64 = 34.0;
    match sample {
        Sample::Line(stroke) => svg.line([(FROM, y), (TO, y)], stroke),
        Sample::Shade => svg.rectangle([(FROM, y - 8.0), (TO, y + 8.0)], SHADE, 1.0),
    }
    let long = text.chars().count() > LONGEST_NAME;
    let text = if long { text.chars().take(LONGEST_NAME - 1).chain(['…']).collect() } else { text.to_owned() };
    svg.text((TO + 8.0, y), &text, LABEL, INK, Anchor::Start);
}

/// Names of rows, each behind a line of its colour, from a height on.
pub(super) fn names(svg: &mut Svg, way: &Way, top: f64) {
    for (i, track) in way.tracks.iter().enumerate() {
        name(svg, top + ROW * (i as f64 + 0.5), &track.label, Sample::Line(Stroke::of(colour(track), 4.0)));
    }
}

/// A cell of a strip.
pub(super) struct Cell {
    pub colour: Colour,
    /// A word in it, if there is room, in its own colour.
    pub word: Option<(String, Colour)>,
}

/// Rows of cells, one a held-out keyframe, under the keyframes' numbers and over their axis if it has a name; returns the height at which it ends.
///
/// # Errors
/// Places that no axis holds.
pub(super) fn strips(svg: &mut Svg, way: &Way, top: f64, rows: &[Vec<Cell>], axis_name: Option<&str>) -> Result<f64> {
    let axis = &way.axis;
    let x = Scale::linear(axis.range.start, axis.range.end)?;
    let place = |at: f64| NAMES + x.share(at) * (WIDTH - RIGHT - NAMES);
    let numbered = axis.mark_share() * (WIDTH - RIGHT - NAMES) >= NARROWEST_NUMBERED;
    for (row, cells) in rows.iter().enumerate() {
        let (high, low) = (top + ROW * (row as f64 + 1.08), top + ROW * (row as f64 + 1.92));
        for (at, cell) in axis.stops.iter().zip(cells) {
            let corners = [(place(at - axis.half_width), high), (place(at + axis.half_width), low)];
            svg.rectangle(corners, cell.colour, 1.0);
            if let Some((word, colour)) = cell.word.as_ref().filter(|_| numbered) {
                svg.text((place(*at), 0.5 * (high + low)), word, NUMBER, *colour, Anchor::Middle);
            }
        }
    }
    if numbered {
        for (at, number) in axis.stops.iter().zip(&axis.numbers) {
            svg.text((place(*at), top + 0.6 * ROW), &number.to_string(), NUMBER, DIM, Anchor::Middle);
        }
        svg.text((NAMES - 8.0, top + 0.6 * ROW), "keyframe", NUMBER, DIM, Anchor::End);
    }
    let end = top + ROW * (rows.len() as f64 + 1.0);
    let Some(name) = axis_name else { return Ok(end) };
    let frame = AxesFrame { left: NAMES, top, right: WIDTH - RIGHT, bottom: end };
    Plot::new(svg, frame, x, Scale::linear(0.0, 1.0)?).x_axis(name, false);
    Ok(end + AXIS)
}

/// What the colours of a strip mean, in lines as wide as there is room; returns the height at which it ends.
pub(super) fn key(svg: &mut Svg, top: f64, entries: &[(Colour, &str)]) -> f64 {
    let (mut x, mut y) = (NAMES, top + 0.5 * ROW);
    for (colour, text) in entries {
        let width = 34.0 + text_width(text, LABEL);
        if x + width > WIDTH && x > NAMES {
            (x, y) = (NAMES, y + ROW);
        }
        svg.rectangle([(x, y - 6.0), (x + 14.0, y + 6.0)], *colour, 1.0);
        svg.text((x + 20.0, y), text, LABEL, INK, Anchor::Start);
        x += width;
    }
    y + 0.5 * ROW
}

/// The heading of a chart, over its axis.
pub(super) fn heading(svg: &mut Svg, top: f64, text: &str) {
    svg.text((NAMES, top + 0.5 * ROW), text, LABEL, INK, Anchor::Start);
}
