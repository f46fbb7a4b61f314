//! A stroke alphabet: every letter is a few polylines on a grid 4 wide and 6 high (y up), drawn with a round pen.

/// The strokes of a character: polylines of `(x, y)` on the 4 × 6 grid; unknown characters are blank.
pub fn strokes(character: char) -> Vec<Vec<[f32; 2]>> {
    let text = match character.to_ascii_uppercase() {
        'A' => "0,0 2,6 4,0;0.7,2 3.3,2",
        'B' => "0,0 0,6 2.4,6 3.5,5.5 3.5,3.8 2.4,3.2 0,3.2;2.4,3.2 4,2.6 4,0.7 2.8,0 0,0",
        'C' => "4,5 3,6 1.2,6 0,4.8 0,1.2 1.2,0 3,0 4,1",
        'D' => "0,0 0,6 2.2,6 4,4.4 4,1.6 2.2,0 0,0",
        'E' => "4,6 0,6 0,0 4,0;0,3.1 3,3.1",
        'F' => "4,6 0,6 0,0;0,3.1 3,3.1",
        'G' => "4,5 3,6 1.2,6 0,4.8 0,1.2 1.2,0 3,0 4,1 4,2.8 2.4,2.8",
        'H' => "0,0 0,6;4,0 4,6;0,3 4,3",
        'I' => "2,0 2,6",
        'J' => "3,6 3,1.2 2,0 1,0 0,1.2",
        'K' => "0,0 0,6;4,6 0,2.6;1.3,3.8 4,0",
        'L' => "0,6 0,0 4,0",
        'M' => "0,0 0,6 2,2.4 4,6 4,0",
        'N' => "0,0 0,6 4,0 4,6",
        'O' => "1.2,0 0,1.2 0,4.8 1.2,6 2.8,6 4,4.8 4,1.2 2.8,0 1.2,0",
        'P' => "0,0 0,6 2.8,6 4,5.2 4,3.6 2.8,2.8 0,2.8",
        'Q' => "1.2,0 0,1.2 0,4.8 1.2,6 2.8,6 4,4.8 4,1.2 2.8,0 1.2,0;2.4,1.6 4,-0.3",
        'R' => "0,0 0,6 2.8,6 4,5.2 4,3.7 2.8,2.9 0,2.9;2.2,2.9 4,0",
        'S' => "4,5.2 3,6 1.2,6 0,5 0,4 1,3.2 3,2.8 4,2 4,1 3,0 1,0 0,0.9",
        'T' => "0,6 4,6;2,6 2,0",
        'U' => "0,6 0,1.2 1.2,0 2.8,0 4,1.2 4,6",
        'V' => "0,6 2,0 4,6",
        'W' => "0,6 0.9,0 2,4.2 3.1,0 4,6",
        'X' => "0,0 4,6;0,6 4,0",
        'Y' => "0,6 2,3 4,6;2,3 2,0",
        'Z' => "0,6 4,6 0,0 4,0",
        '0' => "1.2,0 0,1.2 0,4.8 1.2,6 2.8,6 4,4.8 4,1.2 2.8,0 1.2,0;0.8,1.6 3.2,4.4",
        '1' => "0.8,4.8 2.2,6 2.2,0",
        '2' => "0,4.8 1.2,6 2.8,6 4,4.8 4,3.9 0,0 4,0",
        '3' => "0,6 4,6 1.8,3.6 3,3.6 4,2.6 4,1.1 2.8,0 1.2,0 0,1",
        '4' => "3,0 3,6 0,1.8 4,1.8",
        '5' => "4,6 0.4,6 0,3.4 2.8,3.6 4,2.6 4,1.1 2.8,0 1,0 0,0.9",
        '6' => "3.6,6 1.4,5 0,2.6 0,1.2 1.2,0 2.8,0 4,1.2 4,2.4 2.8,3.5 1.2,3.5 0,2.4",
        '7' => "0,6 4,6 1.4,0",
        '8' => "1.2,3.3 0.2,4.2 0.2,5.2 1.2,6 2.8,6 3.8,5.2 3.8,4.2 2.8,3.3 1.2,3.3 0,2.2 0,1 1.2,0 2.8,0 4,1 4,2.2 2.8,3.3",
        '9' => "0.4,0 2.6,1 4,3.4 4,4.8 2.8,6 1.2,6 0,4.8 0,3.6 1.2,2.5 2.8,2.5 4,3.6",
        '.' => "1.9,0 2.1,0",
        ',' => "2.2,0.2 1.6,-1",
        ':' => "2,1 2,1.1;2,4 2,4.1",
        '-' => "0.8,3 3.2,3",
        '+' => "0.5,3 3.5,3;2,1.5 2,4.5",
        '/' => "0,0 4,6",
        '>' => "0.8,5 3.4,3 0.8,1",
        '%' => "0,0 4,6;0.4,5 1,5.6;3,0.4 3.6,1",
        _ => "",
    };
    let number = |s: &str| s.parse::<f32>().unwrap_or_default();
    let point = |s: &str| s.split_once(',').map(|(x, y)| [number(x), number(y)]);
    text.split(';').map(|line| line.split(' ').filter_map(point).collect()).filter(|l: &Vec<_>| !l.is_empty()).collect()
}

/// Advance width of a character in grid units: the glyph and the gap after it, narrower for thin ones.
pub fn advance(character: char) -> f32 {
    match character {
        'I' | 'i' | '.' | ',' | ':' => 3.6,
        ' ' => 3.2,
        _ => 5.6,
    }
}

/// The strokes of a line of text in units of its cap height, x from 0, y up; and the width of the whole.
pub fn layout(text: &str) -> (Vec<Vec<[f32; 2]>>, f32) {
    let (mut pen, mut all) = (0.0, Vec::new());
    for character in text.chars() {
        let narrow = if advance(character) < 5.0 && character != ' ' { -0.8 } else { 0.0 };
        all.extend(
            strokes(character).into_iter().map(|s| s.into_iter().map(|p| [(p[0] + pen + narrow) / 6.0, p[1] / 6.0]).collect()),
        );
        pen += advance(character);
    }
    (all, (pen - 1.6) / 6.0)
}

impl super::canvas::Canvas {
    /// Writes a line: `x, y` is the left end of the base line in pixels, `cap` the height of capitals, `pen` the stroke width.
    pub fn text(&mut self, text: &str, x: f32, y: f32, cap: f32, pen: f32, colour: super::canvas::Rgb) {
        for stroke in layout(text).0 {
            let at = |p: [f32; 2]| [x + p[0] * cap, y - p[1] * cap];
            for pair in stroke.windows(2) {
                self.line(at(pair[0]), at(pair[1]), pen, colour);
            }
        }
    }

    /// Draws [`text`](Self::text) centred on `x`.
    pub fn text_centred(&mut self, text: &str, x: f32, y: f32, cap: f32, pen: f32, colour: super::canvas::Rgb) {
        self.text(text, x - 0.5 * layout(text).1 * cap, y, cap, pen, colour);
    }
}

#[cfg(test)]
mod tests {
    #[test]
    fn every_letter_and_digit_has_strokes_on_the_grid() {
        for c in ('A'..='Z').chain('0'..='9') {
            let strokes = super::strokes(c);
            assert!(!strokes.is_empty() && strokes.iter().all(|s| s.len() >= 2), "{c}");
            assert!(strokes.iter().flatten().all(|p| (0.0..=4.0).contains(&p[0]) && (-1.0..=6.0).contains(&p[1])), "{c}");
        }
    }
}
