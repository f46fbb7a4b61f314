//! Drawing for charts and maps: a canvas with lines, discs and polygons, and text of strokes.

mod canvas;
mod glyphs;
mod plan;

pub use canvas::{Canvas, PictureFormat, Rgb, hex, mix};
pub(crate) use canvas::{scale, smoothstep};
pub(crate) use glyphs::layout as text_layout;
pub use plan::{clip, metre_axes};

/// Strokes of the small letters that units need, on the grid of the capitals (4 wide, 6 high), and how far the pen moves on.
fn small(character: char) -> Option<(&'static [&'static [[f32; 2]]], f32)> {
    match character {
        'd' => Some((
            &[
                &[[3.0, 6.0], [3.0, 0.0]],
                &[[3.0, 3.2], [2.2, 4.0], [0.9, 4.0], [0.0, 3.0], [0.0, 1.0], [0.9, 0.0], [2.2, 0.0], [3.0, 0.8]],
            ],
            4.6,
        )),
        'm' => Some((
            &[
                &[[0.0, 0.0], [0.0, 4.0]],
                &[[0.0, 3.0], [0.9, 4.0], [1.7, 4.0], [2.2, 3.4], [2.2, 0.0]],
                &[[2.2, 3.0], [3.1, 4.0], [3.9, 4.0], [4.4, 3.4], [4.4, 0.0]],
            ],
            6.0,
        )),
        'z' => Some((&[&[[0.0, 4.0], [2.8, 4.0], [0.0, 0.0], [2.8, 0.0]]], 4.4)),
        '=' => Some((&[&[[0.4, 2.0], [3.6, 2.0]], &[[0.4, 4.0], [3.6, 4.0]]], 5.6)),
        _ => None,
    }
}

/// Strokes in units of the capitals' height (x from 0, y up) and the width of the line; small letters without strokes of their own are
/// written as capitals.
fn layout(text: &str) -> (Vec<Vec<[f32; 2]>>, f32) {
    let (mut pen, mut all) = (0.0, Vec::new());
    for character in text.chars() {
        match small(character) {
            Some((strokes, advance)) => {
                all.extend(strokes.iter().map(|s| s.iter().map(|p| [p[0] / 6.0 + pen, p[1] / 6.0]).collect()));
                pen += advance / 6.0;
            }
            None => {
                let (strokes, width) = text_layout(&character.to_string());
                all.extend(strokes.into_iter().map(|s| s.into_iter().map(|p| [p[0] + pen, p[1]]).collect()));
                pen += width + 1.6 / 6.0;
            }
        }
    }
    (all, (pen - 1.6 / 6.0).max(0.0))
}

/// Horizontal anchor of a line of text.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TextAnchor {
    /// The text's left end.
    Left,
    /// The text's middle.
    Middle,
    /// The text's right end.
    Right,
}

/// Writes a line of text: `(x, y)` is the anchor on the base line in pixels, `cap` the height of capitals in pixels.
pub fn text(canvas: &mut Canvas, text: &str, at: [f32; 2], anchor: TextAnchor, cap: f32, colour: Rgb) {
    let (strokes, width) = layout(text);
    let left = at[0]
        - width
            * cap
            * match anchor {
                TextAnchor::Left => 0.0,
                TextAnchor::Middle => 0.5,
                TextAnchor::Right => 1.0,
            };
    let place = |p: [f32; 2]| [left + p[0] * cap, at[1] - p[1] * cap];
    for stroke in strokes {
        for pair in stroke.windows(2) {
            canvas.line(place(pair[0]), place(pair[1]), (0.13 * cap).max(1.2), colour);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_stays_within_its_width_and_is_held_where_it_is_asked_to_be() {
        for (anchor, left) in [(TextAnchor::Left, 100.0), (TextAnchor::Right, 100.0 - 30.0), (TextAnchor::Middle, 85.0)] {
            let mut canvas = Canvas::filled(200, 40, [1.0; 3]);
            let (_, width) = layout("-65 dBm");
            // Scaled so that the line is 30 pixels wide.
            text(&mut canvas, "-65 dBm", [100.0, 30.0], anchor, 30.0 / width, [0.0; 3]);
            let png = crate::io::decode_rgba(&canvas.encode(PictureFormat::Png), "text.png").unwrap();
            let dark: Vec<usize> = (0..200 * 40).filter(|i| png.pixels()[*i][0] < 128).map(|i| i % 200).collect();
            let (first, last) = (*dark.iter().min().unwrap() as f32, *dark.iter().max().unwrap() as f32);
            // The minus sign starts a little in; a pen is about a pixel wide.
            assert!(first >= left - 2.0 && last <= left + 32.0 && last - first > 22.0, "{anchor:?}: {first} {last}");
        }
    }
}
