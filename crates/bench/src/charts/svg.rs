//! A canvas: shapes, text and pictures in pixels, x to the right and y down, written as SVG.

use super::WHITE;
use crate::files::escape;
use std::fmt::Write;

/// sRGB.
pub type Colour = [u8; 3];

/// Width of a character over the size of its text, about: no font is asked, so that a figure is the same everywhere.
const CHARACTER: f64 = 0.64;
/// From a text's middle down to its base line, over its size.
const BASE_LINE: f64 = 0.36;

/// The side of a text at which its place is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Anchor {
    /// The text begins there.
    Start,
    /// Its middle is there.
    Middle,
    /// The text ends there.
    End,
}

/// How a line is drawn.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stroke {
    /// Its colour.
    pub colour: Colour,
    /// Its width, pixels.
    pub width: f64,
    /// Length of strokes and of the gaps between them, pixels; `None` is a whole line.
    pub dash: Option<f64>,
}

impl Stroke {
    /// A whole line.
    pub fn of(colour: Colour, width: f64) -> Self {
        Self { colour, width, dash: None }
    }
}

/// A figure being drawn: what comes later lies over what came before.
#[derive(Debug)]
pub struct Svg {
    width: u32,
    height: u32,
    body: String,
}

/// A length with a tenth of a pixel.
fn px(value: f64) -> f64 {
    (10.0 * value).round() / 10.0 + 0.0
}

fn hex([r, g, b]: Colour) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

/// Width of a text of a size, pixels, about.
pub fn text_width(text: &str, size: f64) -> f64 {
    CHARACTER * size * text.chars().count() as f64
}

// Writing to a String cannot fail.
impl Svg {
    /// A white figure of so many pixels.
    pub fn new(width: u32, height: u32) -> Self {
        Self { width, height, body: String::new() }
    }

    /// Gives it another height, where that is known once its parts are drawn.
    pub fn set_height(&mut self, height: u32) {
        self.height = height;
    }

    fn text_at(&mut self, place: &str, text: &str, size: f64, colour: Colour, anchor: Anchor) {
        let anchor = match anchor {
            Anchor::Start => "start",
            Anchor::Middle => "middle",
            Anchor::End => "end",
        };
        let (colour, text) = (hex(colour), escape::html(text));
        let _ =
            writeln!(self.body, "<text {place} font-size=\"{size}\" text-anchor=\"{anchor}\" fill=\"{colour}\">{text}</text>");
    }

    /// Text whose middle is at the height of `at`.
    pub fn text(&mut self, at: (f64, f64), text: &str, size: f64, colour: Colour, anchor: Anchor) {
        let place = format!("x=\"{}\" y=\"{}\"", px(at.0), px(at.1 + BASE_LINE * size));
        self.text_at(&place, text, size, colour, anchor);
    }

    /// Text that reads upwards, with its middle at `at`.
    pub fn upward_text(&mut self, at: (f64, f64), text: &str, size: f64, colour: Colour) {
        let (x, y) = (px(at.0 + BASE_LINE * size), px(at.1));
        self.text_at(&format!("x=\"{x}\" y=\"{y}\" transform=\"rotate(-90 {x} {y})\""), text, size, colour, Anchor::Middle);
    }

    /// A filled rectangle between two opposite corners; `opacity` is from 0 to 1.
    pub fn rectangle(&mut self, [a, b]: [(f64, f64); 2], colour: Colour, opacity: f64) {
        let (x, y, width, height) = (px(a.0.min(b.0)), px(a.1.min(b.1)), px((a.0 - b.0).abs()), px((a.1 - b.1).abs()));
        let opacity = if opacity < 1.0 { format!(" fill-opacity=\"{opacity}\"") } else { String::new() };
        let colour = hex(colour);
        let _ =
            writeln!(self.body, "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{height}\" fill=\"{colour}\"{opacity}/>");
    }

    /// A line through points; through fewer than two there is none.
    pub fn line(&mut self, points: impl IntoIterator<Item = (f64, f64)>, stroke: Stroke) {
        let points: Vec<String> = points.into_iter().map(|(x, y)| format!("{},{}", px(x), px(y))).collect();
        if points.len() < 2 {
            return;
        }
        let dash = stroke.dash.map_or(String::new(), |dash| format!(" stroke-dasharray=\"{dash}\""));
        let (points, colour, width) = (points.join(" "), hex(stroke.colour), stroke.width);
        let _ = writeln!(
            self.body,
            "<polyline points=\"{points}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"{width}\" stroke-linejoin=\"round\"{dash}/>"
        );
    }

    /// A disc, or the ring around one.
    pub fn circle(&mut self, at: (f64, f64), radius: f64, colour: Colour, filled: bool) {
        let colour = hex(colour);
        let fill =
            if filled { format!("fill=\"{colour}\"") } else { format!("fill=\"none\" stroke=\"{colour}\" stroke-width=\"2\"") };
        let _ = writeln!(self.body, "<circle cx=\"{}\" cy=\"{}\" r=\"{radius}\" {fill}/>", px(at.0), px(at.1));
    }

    /// A picture between two opposite corners, stretched to fill them; `uri` is its data URI.
    pub fn image(&mut self, [a, b]: [(f64, f64); 2], uri: &str) {
        let _ = writeln!(
            self.body,
            "<image href=\"{uri}\" x=\"{}\" y=\"{}\" width=\"{}\" height=\"{}\" preserveAspectRatio=\"none\" style=\"image-rendering:pixelated\"/>",
            px(a.0.min(b.0)),
            px(a.1.min(b.1)),
            px((a.0 - b.0).abs()),
            px((a.1 - b.1).abs())
        );
    }

    /// The figure as a file.
    pub fn finish(self) -> String {
        let Self { width, height, body } = self;
        let mut ground = Self::new(width, height);
        ground.rectangle([(0.0, 0.0), (f64::from(width), f64::from(height))], WHITE, 1.0);
        let ground = ground.body;
        format!(
            "<svg width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\" xmlns=\"http://www.w3.org/2000/svg\" \
             font-family=\"sans-serif\">\n{ground}{body}</svg>\n"
        )
    }
}

/// An SVG that takes the width it is given, for a page.
pub fn without_size(svg: &str) -> String {
    let end = svg.find('>').unwrap_or(0);
    let (head, rest) = svg.split_at(end);
    let kept = |word: &&str| !word.starts_with("width=") && !word.starts_with("height=");
    // The viewBox has blanks between its numbers and stays whole.
    head.split(' ').filter(kept).collect::<Vec<_>>().join(" ") + rest
}
