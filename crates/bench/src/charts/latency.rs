//! The figure of a live run's latency, keyframe by keyframe.

use super::{Anchor, AxesFrame, Colour, INK, PALETTE, Plot, Scale, Svg, text_width};
use anyhow::{Context, Result};

/// Size of the figure, pixels.
const SIZE: (u32, u32) = (760, 400);
/// Size of the names of the parts.
const NAME: f64 = 12.0;
/// Edge of the square before a name, and the room between two names.
const SQUARE: f64 = 12.0;
const ROOM: f64 = 24.0;
/// Width of a bar, as a share of what a keyframe has to itself.
const BAR: f64 = 0.8;

/// The parts of a latency, in the order of time, and their colours.
const PARTS: [(&str, Colour); 4] = [
    ("waited for keyframes before it", PALETTE[5]),
    ("waited for its preparation", PALETTE[1]),
    ("expanded", PALETTE[2]),
    ("trained", PALETTE[0]),
];

/// From the arrival of a keyframe to the end of its training.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KeyframeLatency {
    /// Index of the keyframe in the run's data set.
    pub index: usize,
    /// Time in which keyframes before it were expanded and trained with, in which nothing was but its own preparation, of its expansion, and of its
    /// training, seconds.
    pub parts_s: [f64; 4],
}

impl KeyframeLatency {
    /// All of it, seconds.
    pub fn total_s(&self) -> f64 {
        self.parts_s.iter().sum()
    }
}

/// A bar of four parts for each keyframe over its index. `None` without keyframes.
///
/// # Errors
/// Times that no axis holds.
pub fn latency(title: &str, keyframes: &[KeyframeLatency]) -> Result<Option<String>> {
    let (Some(first), Some(last)) = (keyframes.iter().map(|k| k.index).min(), keyframes.iter().map(|k| k.index).max()) else {
        return Ok(None);
    };
    let longest_ms = keyframes.iter().map(|k| 1e3 * k.total_s()).fold(1e-3, f64::max);
    let x = Scale::linear(first as f64 - 1.0, last as f64 + 1.0).context("cannot draw the indices of keyframes")?;
    let y = Scale::linear(0.0, 1.05 * longest_ms).context("cannot draw latencies")?;
    let (width, height) = (f64::from(SIZE.0), f64::from(SIZE.1));
    let mut svg = Svg::new(SIZE.0, SIZE.1);
    svg.text((14.0, 20.0), title, 17.0, INK, Anchor::Start);
    let mut left = 84.0;
    for (name, colour) in PARTS {
        svg.rectangle([(left, 40.0), (left + SQUARE, 40.0 + SQUARE)], colour, 1.0);
        svg.text((left + SQUARE + 6.0, 40.0 + 0.5 * SQUARE), name, NAME, INK, Anchor::Start);
        left += SQUARE + 6.0 + text_width(name, NAME) + ROOM;
    }
    let mut plot = Plot::new(&mut svg, AxesFrame { left: 84.0, top: 66.0, right: width - 20.0, bottom: height - 48.0 }, x, y);
    plot.y_axis("from arrival to trained, ms", true);
    plot.x_axis("index of the keyframe", false);
    for KeyframeLatency { index, parts_s } in keyframes {
        let mut low_ms = 0.0;
        for (part_s, (_, colour)) in parts_s.iter().zip(PARTS) {
            let high_ms = low_ms + 1e3 * part_s;
            let half = 0.5 * BAR;
            plot.bar([(*index as f64 - half, low_ms), (*index as f64 + half, high_ms)], colour);
            low_ms = high_ms;
        }
    }
    Ok(Some(svg.finish()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bar_is_as_high_as_its_parts_and_they_stand_on_each_other() {
        let keyframe = |index: usize, parts_s: [f64; 4]| KeyframeLatency { index, parts_s };
        let svg = latency("run <a>", &[keyframe(3, [0.1, 0.2, 0.3, 0.4]), keyframe(5, [0.0, 0.5, 0.0, 0.0])]).unwrap().unwrap();
        assert!(svg.contains("run &lt;a&gt;") && svg.contains(">from arrival to trained, ms</text>"), "{svg}");
        // Rectangles: of the ground, of four names, and of the bars; read as (x, y, width, height).
        let value = |line: &str, key: &str| -> f64 {
            let text = line.split_once(&format!(" {key}=\"")).unwrap().1;
            text.split_once('"').unwrap().0.parse().unwrap()
        };
        let rectangles: Vec<[f64; 4]> = svg
            .lines()
            .filter(|line| line.starts_with("<rect"))
            .map(|line| ["x", "y", "width", "height"].map(|key| value(line, key)))
            .collect();
        let bars: Vec<_> = rectangles.iter().filter(|r| r[3] > 0.0).skip(5).collect();
        assert_eq!(bars.len(), 5, "{svg}");
        let unit = bars[0][3];
        for (k, bar) in bars[..4].iter().enumerate() {
            assert!((bar[3] / unit - (k + 1) as f64).abs() < 0.02, "{bars:?}");
            assert_eq!(bar[0], bars[0][0]);
            assert!(k == 0 || (bar[1] + bar[3] - bars[k - 1][1]).abs() < 0.11, "{bars:?}");
        }
        assert!((bars[4][3] / unit - 5.0).abs() < 0.02 && bars[4][0] > bars[0][0], "{bars:?}");
        assert_eq!(latency("t", &[]).unwrap(), None);
        assert!(latency("t", &[keyframe(0, [0.0; 4])]).unwrap().is_some(), "one at once is a figure");
    }
}
