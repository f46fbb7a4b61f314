//! A frame between two axes, and what is drawn in it.

use super::{Anchor, Colour, DIM, GRID, INK, Scale, Stroke, Svg, WHITE, text_width};

/// Size of labels.
const LABEL: f64 = 12.0;
/// Size of the names of axes.
const NAME: f64 = 13.0;
/// Length of a tick.
const TICK: f64 = 5.0;
/// Pixels that a tick of the x axis has to itself.
const X_TICK: f64 = 70.0;
/// Pixels that a tick of the y axis has to itself.
const Y_TICK: f64 = 36.0;
/// Height of a line of a legend.
const LEGEND_LINE: f64 = 18.0;
/// Width of a sample in a legend.
const SAMPLE: f64 = 18.0;
/// Colours of a colour bar.
const BAR_STEPS: usize = 64;

/// The part of a figure between the axes, pixels. Below it the x axis takes some 40 pixels, left of it the y axis some 65, and right of it a
/// colour bar some 75.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AxesFrame {
    /// Where the y axis stands.
    pub left: f64,
    /// The upper end.
    pub top: f64,
    /// The right end.
    pub right: f64,
    /// Where the x axis stands.
    pub bottom: f64,
}

impl AxesFrame {
    /// Ticks that the x axis has room for.
    pub fn x_ticks(&self) -> usize {
        ((self.right - self.left) / X_TICK) as usize
    }

    /// Ticks that the y axis has room for.
    pub fn y_ticks(&self) -> usize {
        ((self.bottom - self.top) / Y_TICK) as usize
    }
}

/// A sample of what a legend names.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LegendMark {
    /// A line.
    Line(Stroke),
    /// A disc.
    Disc(Colour),
    /// A ring.
    Ring(Colour),
}

/// The corner of the frame in which a legend stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Corner {
    /// At the upper end of the y axis.
    TopLeft,
    /// Where the axes meet.
    BottomLeft,
}

/// A part of a figure with axes. Points are given as values of both; what lies beyond an axis's end is drawn at it, and what is no number is not drawn.
pub struct Plot<'s> {
    svg: &'s mut Svg,
    frame: AxesFrame,
    x: Scale,
    y: Scale,
}

impl<'s> Plot<'s> {
    /// A part of a figure, still without anything in it.
    pub fn new(svg: &'s mut Svg, frame: AxesFrame, x: Scale, y: Scale) -> Self {
        Self { svg, frame, x, y }
    }

    /// The axes: x, y.
    pub fn scales(&self) -> [Scale; 2] {
        [self.x, self.y]
    }

    /// The part of the figure between them.
    pub fn frame(&self) -> AxesFrame {
        self.frame
    }

    /// The place of a value.
    fn at(&self, (x, y): (f64, f64)) -> (f64, f64) {
        let AxesFrame { left, top, right, bottom } = self.frame;
        (left + self.x.share(x) * (right - left), bottom - self.y.share(y) * (bottom - top))
    }

    /// The places of those of some points that are numbers.
    fn places(&self, points: impl IntoIterator<Item = (f64, f64)>) -> Vec<(f64, f64)> {
        points.into_iter().filter(|(x, y)| x.is_finite() && y.is_finite()).map(|p| self.at(p)).collect()
    }

    /// A title over the frame.
    pub fn title(&mut self, text: &str) {
        let AxesFrame { left, top, right, .. } = self.frame;
        self.svg.text((0.5 * (left + right), top - 18.0), text, 16.0, INK, Anchor::Middle);
    }

    /// The x axis with ticks and name; `grid` draws lines from its ticks through the frame.
    pub fn x_axis(&mut self, name: &str, grid: bool) {
        let AxesFrame { left, top, right, bottom } = self.frame;
        for (value, text) in self.x.ticks(self.frame.x_ticks()) {
            let x = left + self.x.share(value) * (right - left);
            if grid {
                self.svg.line([(x, top), (x, bottom)], Stroke::of(GRID, 1.0));
            }
            self.svg.line([(x, bottom), (x, bottom + TICK)], Stroke::of(DIM, 1.0));
            self.svg.text((x, bottom + TICK + 8.0), &text, LABEL, INK, Anchor::Middle);
        }
        self.svg.line([(left, bottom), (right, bottom)], Stroke::of(DIM, 1.0));
        self.svg.text((0.5 * (left + right), bottom + TICK + 26.0), name, NAME, INK, Anchor::Middle);
    }

    /// The y axis with ticks, and with a name if it is not empty; `grid` draws lines from its ticks through the frame.
    pub fn y_axis(&mut self, name: &str, grid: bool) {
        let AxesFrame { left, top, right, bottom } = self.frame;
        let mut widest = 0.0_f64;
        for (value, text) in self.y.ticks(self.frame.y_ticks()) {
            let y = bottom - self.y.share(value) * (bottom - top);
            if grid {
                self.svg.line([(left, y), (right, y)], Stroke::of(GRID, 1.0));
            }
            self.svg.line([(left - TICK, y), (left, y)], Stroke::of(DIM, 1.0));
            self.svg.text((left - TICK - 3.0, y), &text, LABEL, INK, Anchor::End);
            widest = widest.max(text_width(&text, LABEL));
        }
        self.svg.line([(left, top), (left, bottom)], Stroke::of(DIM, 1.0));
        if !name.is_empty() {
            self.svg.upward_text((left - TICK - widest - 14.0, 0.5 * (top + bottom)), name, NAME, INK);
        }
    }

    /// A line through points.
    pub fn line(&mut self, points: impl IntoIterator<Item = (f64, f64)>, stroke: Stroke) {
        let places = self.places(points);
        self.svg.line(places, stroke);
    }

    /// Points as discs or as rings.
    pub fn points(&mut self, points: impl IntoIterator<Item = (f64, f64)>, radius: f64, colour: Colour, filled: bool) {
        for place in self.places(points) {
            self.svg.circle(place, radius, colour, filled);
        }
    }

    /// An interval of `half` to either side of a point, along y.
    pub fn interval(&mut self, (x, y): (f64, f64), half: f64, colour: Colour) {
        self.line([(x, y - half), (x, y + half)], Stroke::of(colour, 2.0));
    }

    /// A bar: a filled rectangle between two opposite corners.
    pub fn bar(&mut self, corners: [(f64, f64); 2], colour: Colour) {
        if let [a, b] = self.places(corners)[..] {
            self.svg.rectangle([a, b], colour, 1.0);
        }
    }

    /// A picture that fills the frame; `uri` is its data URI.
    pub fn image(&mut self, uri: &str) {
        let AxesFrame { left, top, right, bottom } = self.frame;
        self.svg.image([(left, top), (right, bottom)], uri);
    }

    /// Names with their samples in a corner of the frame.
    pub fn legend(&mut self, corner: Corner, entries: &[(LegendMark, &str)]) {
        let AxesFrame { left, top, bottom, .. } = self.frame;
        let width = entries.iter().map(|(_, text)| text_width(text, LABEL)).fold(0.0, f64::max) + SAMPLE + 30.0;
        let height = LEGEND_LINE * entries.len() as f64 + 12.0;
        let (x, y) = match corner {
            Corner::TopLeft => (left + 8.0, top + 6.0),
            Corner::BottomLeft => (left + 8.0, bottom - height - 8.0),
        };
        self.svg.rectangle([(x, y), (x + width, y + height)], WHITE, 0.85);
        let outline = [(x, y), (x + width, y), (x + width, y + height), (x, y + height), (x, y)];
        self.svg.line(outline, Stroke::of(GRID, 1.0));
        for (i, (mark, text)) in entries.iter().enumerate() {
            let (x, y) = (x + 10.0, y + 6.0 + LEGEND_LINE * (i as f64 + 0.5));
            match *mark {
                LegendMark::Line(stroke) => self.svg.line([(x, y), (x + SAMPLE, y)], stroke),
                LegendMark::Disc(colour) => self.svg.circle((x + 0.5 * SAMPLE, y), 5.0, colour, true),
                LegendMark::Ring(colour) => self.svg.circle((x + 0.5 * SAMPLE, y), 5.0, colour, false),
            }
            self.svg.text((x + SAMPLE + 10.0, y), text, LABEL, INK, Anchor::Start);
        }
    }

    /// A colour bar right of the frame: the colours of 0 to 1, lowest first, the values that they stand for, and over it their unit.
    pub fn colour_bar(&mut self, colour: impl Fn(f64) -> Colour, values: Scale, unit: &str) {
        let AxesFrame { top, right, bottom, .. } = self.frame;
        let (left, end) = (right + 14.0, right + 28.0);
        let step = (bottom - top) / BAR_STEPS as f64;
        for i in 0..BAR_STEPS {
            let (low, high) = (bottom - step * i as f64, bottom - step * (i + 1) as f64);
            // A little over the next one, which covers it: no gap is seen between them.
            self.svg.rectangle([(left, low), (end, (high - 0.5).max(top))], colour((i as f64 + 0.5) / BAR_STEPS as f64), 1.0);
        }
        for (value, text) in values.ticks(self.frame.y_ticks()) {
            let y = bottom - values.share(value) * (bottom - top);
            self.svg.line([(end, y), (end + TICK, y)], Stroke::of(DIM, 1.0));
            self.svg.text((end + TICK + 3.0, y), &text, LABEL, INK, Anchor::Start);
        }
        self.svg.text((left, top - 12.0), unit, LABEL, INK, Anchor::Start);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_stand_where_the_axes_say_and_what_is_no_number_nowhere() {
        let mut svg = Svg::new(200, 100);
        let frame = AxesFrame { left: 50.0, top: 10.0, right: 150.0, bottom: 90.0 };
        let mut plot = Plot::new(&mut svg, frame, Scale::linear(0.0, 10.0).unwrap(), Scale::logarithmic(1.0, 100.0).unwrap());
        plot.points([(5.0, 10.0), (f64::NAN, 2.0), (20.0, 1000.0)], 3.0, INK, true);
        plot.interval((0.0, 10.0), 1e3, INK);
        let svg = svg.finish();
        assert!(svg.contains("cx=\"100\" cy=\"50\"") && svg.contains("cx=\"150\" cy=\"10\""), "{svg}");
        assert_eq!(svg.matches("<circle").count(), 2);
        // A logarithmic axis has no place for what is not positive: the interval goes to its end.
        assert!(!svg.contains("NaN") && !svg.contains("inf"), "{svg}");
    }

    #[test]
    fn a_picture_has_axes_in_degrees_and_a_colour_bar_with_its_unit() {
        let mut svg = Svg::new(460, 300);
        let frame = AxesFrame { left: 70.0, top: 40.0, right: 370.0, bottom: 250.0 };
        let mut plot = Plot::new(&mut svg, frame, Scale::linear(-90.0, 90.0).unwrap(), Scale::linear(-45.0, 45.0).unwrap());
        plot.image("data:image/png;base64,AAAA");
        plot.x_axis("azimuth, °", false);
        plot.y_axis("elevation, °", false);
        plot.colour_bar(|t| [(255.0 * t) as u8, 0, 0], Scale::linear(-60.0, 0.0).unwrap(), "dB");
        plot.title("Spectrum <1>");
        let svg = svg.finish();
        assert!(
            svg.contains("<image href=\"data:image/png;base64,AAAA\" x=\"70\" y=\"40\" width=\"300\" height=\"210\""),
            "{svg}"
        );
        for text in ["azimuth, °", "elevation, °", "dB", "-60", "Spectrum &lt;1&gt;", "50", "-40"] {
            assert!(svg.contains(&format!(">{text}</text>")), "{text}: {svg}");
        }
        // From dark to bright, upwards.
        assert!(svg.find("#010000") < svg.find("#fd0000") && svg.find("#010000").is_some(), "{svg}");
    }
}
