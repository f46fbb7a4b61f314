//! Images over spectra of some keyframes along the way, in one picture.

use super::Publication;
use anyhow::Result;
use corf_scene::Raster;
use corf_scene::dataset::stem;
use corf_scene::draw::{Canvas, PictureFormat, TextAnchor, hex, text};

/// Columns and rows of the sheet.
const GRID: [usize; 2] = [4, 3];
/// Width of a picture, pixels.
const WIDTH: usize = 240;
/// Between pictures, pixels.
const GAP: usize = 12;
/// Height of a label's capitals, and of its line, pixels.
const LABEL: (f32, usize) = (9.0, 20);
const INK: [f32; 3] = hex(0x1a1a1a);
const PAPER: [f32; 3] = hex(0xffffff);

/// A picture in the sheet's size: each pixel the mean of those it covers, sRGB from 0 to 1.
fn scaled(picture: &Raster<[u8; 3]>) -> Raster<[f32; 3]> {
    let (width, height) = (picture.width(), picture.height());
    let rows = (WIDTH * height).div_ceil(width).max(1);
    Raster::from_fn(WIDTH, rows, |x, y| {
        let covered =
            |i: usize, of: usize, from: usize| (i * from / of)..((i + 1) * from).div_ceil(of).max(i * from / of + 1).min(from);
        let (mut sum, mut count) = ([0.0; 3], 0.0);
        for v in covered(y, rows, height) {
            for u in covered(x, WIDTH, width) {
                let pixel = picture[(u, v)];
                sum.iter_mut().zip(pixel).for_each(|(sum, c)| *sum += f32::from(c) / 255.0);
                count += 1.0;
            }
        }
        sum.map(|c| c / count)
    })
}

/// So many of `len` indices, equally far apart, the first among them.
fn chosen(len: usize, most: usize) -> Vec<usize> {
    let count = len.min(most);
    (0..count).map(|i| i * len / count).collect()
}

impl Publication<'_> {
    /// The PNG's bytes.
    pub(super) fn contact_sheet(&self) -> Result<Vec<u8>> {
        let keyframes = chosen(self.dataset.len(), GRID[0] * GRID[1]);
        let mut cells: Vec<Vec<Raster<[f32; 3]>>> = Vec::new();
        for &index in &keyframes {
            let keyframe = self.dataset.keyframe(index)?;
            let image = keyframe.light.map(|light| scaled(&light.image));
            let spectrum =
                keyframe.radio.zip(self.dataset.db_range()).map(|(radio, range)| scaled(&range.jet_image(&radio.spectrum)));
            cells.push(image.into_iter().chain(spectrum).collect());
        }
        let pictures: usize = cells[0].iter().map(|picture| picture.height() + GAP / 3).sum();
        let (cell_width, cell_height) = (WIDTH + GAP, pictures + LABEL.1 + GAP);
        let [columns, rows] = [keyframes.len().min(GRID[0]), keyframes.len().div_ceil(GRID[0])];
        let (width, height) = (columns * cell_width + GAP, rows * cell_height + GAP);
        let mut canvas = Canvas::filled(width, height, PAPER);
        canvas.recolour(|u, v, paper| {
            let (x, y) = ((u * width as f32) as usize, (v * height as f32) as usize);
            let (Some(x), Some(y)) = (x.checked_sub(GAP), y.checked_sub(GAP)) else { return paper };
            let Some(cell) = cells.get(y / cell_height * GRID[0] + x / cell_width) else { return paper };
            let (x, y) = (x % cell_width, y % cell_height);
            let (Some(mut y), true) = (y.checked_sub(LABEL.1), x < WIDTH) else { return paper };
            for picture in cell {
                if y < picture.height() {
                    return picture[(x, y)];
                }
                match y.checked_sub(picture.height() + GAP / 3) {
                    Some(below) => y = below,
                    None => break,
                }
            }
            paper
        });
        for (i, &index) in keyframes.iter().enumerate() {
            let at = [(GAP + i % GRID[0] * cell_width) as f32, (GAP + i / GRID[0] * cell_height) as f32 + LABEL.0 + 3.0];
            text(&mut canvas, &format!("{} {}", stem(index), self.role(index)), at, TextAnchor::Left, LABEL.0, INK);
        }
        Ok(canvas.encode(PictureFormat::Png))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn keyframes_are_chosen_along_the_whole_way() {
        assert_eq!(chosen(24, 12), (0..12).map(|i| 2 * i).collect::<Vec<_>>());
        assert_eq!(chosen(3, 12), [0, 1, 2]);
    }

    #[test]
    fn a_picture_is_averaged_down_and_repeated_up() {
        // Columns of black and white twice as wide as the sheet: grey. One pixel: itself everywhere.
        let stripes = Raster::from_fn(2 * WIDTH, 4, |x, _| [if x % 2 == 0 { 0 } else { 255 }; 3]);
        let grey = scaled(&stripes);
        assert_eq!((grey.width(), grey.height()), (WIDTH, 2));
        assert!(grey.pixels().iter().flatten().all(|c| (c - 0.5).abs() < 1e-6));
        let one = scaled(&Raster::from_fn(1, 1, |_, _| [255, 0, 51]));
        assert!(one.height() == WIDTH && one.pixels().iter().all(|c| *c == [1.0, 0.0, 0.2]));
    }
}
