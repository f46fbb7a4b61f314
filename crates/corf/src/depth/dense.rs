//! Values all over an image, kept at the resolution at which they are known.

use corf_scene::Raster;
use rayon::prelude::*;
use std::collections::VecDeque;
use std::sync::Arc;

/// A map of an image on a grid of the image's shape, of its pixels or of coarser cells; bilinear between the cells' centres.
#[derive(Clone, Debug, PartialEq)]
pub struct Dense {
    grid: Raster<f32>,
    image: (usize, usize),
    /// Mask of the holes, cells without a known value, if there are any; they hold the values next to them.
    holes: Option<Arc<[bool]>>,
    /// Whether the values are inverse depths in 1/m as they are.
    is_metric: bool,
}

/// Two neighbouring cells along an axis and the weight of the second.
type Between = (usize, usize, f32);

impl Dense {
    /// A grid over an image of `image` pixels (columns, rows).
    pub fn new(grid: Raster<f32>, image: (usize, usize)) -> Self {
        Self { grid, image, holes: None, is_metric: false }
    }

    /// A map of an image of `image` pixels at any resolution. One that is finer than the image is averaged over its pixels. What is not finite is a
    /// hole: it takes the value of what is known next to it, so that nothing that is interpolated there is spoilt, and is no longer
    /// [known](Self::is_known). A map without a finite value stays as it is.
    pub fn reduced(map: Raster<f32>, image: (usize, usize)) -> Self {
        let mut grid = reduce(map, image);
        let holes = fill_holes(&mut grid).map(Arc::from);
        Self { holes, ..Self::new(grid, image) }
    }

    /// Takes the cells that have a pixel of the image's mask that does not count as holes, as in [`Self::reduced`]. A map of an image of which
    /// nothing counts is a hole throughout and keeps its values.
    pub fn masked(mut self, mask: &Raster<bool>) -> Self {
        let (width, height) = (self.grid.width(), self.grid.height());
        let cell = |at: usize, pixels: usize, cells: usize| (2 * at + 1) * cells / (2 * pixels);
        let mut holes = self.holes.as_ref().map_or_else(|| vec![false; width * height], |h| h.to_vec());
        for (i, _) in mask.pixels().iter().enumerate().filter(|(_, counts)| !**counts) {
            let (x, y) = (i % mask.width(), i / mask.width());
            holes[cell(y, mask.height(), height) * width + cell(x, mask.width(), width)] = true;
        }
        fill(&mut self.grid, &holes);
        self.holes = holes.contains(&true).then(|| holes.into());
        self
    }

    /// Marks the map as metric: its values are inverse depths in 1/m that need no alignment.
    pub fn in_metres(self) -> Self {
        Self { is_metric: true, ..self }
    }

    /// Whether the values are inverse depths in 1/m as they are.
    pub fn is_metric(&self) -> bool {
        self.is_metric
    }

    /// Whether the value of an image pixel rests on no hole.
    pub fn is_known(&self, x: usize, y: usize) -> bool {
        let Some(holes) = &self.holes else { return true };
        let ((x0, x1, _), (y0, y1, _)) = (self.along_x(x), self.along_y(y));
        [(x0, y0), (x1, y0), (x0, y1), (x1, y1)].iter().all(|(x, y)| !holes[y * self.grid.width() + x])
    }

    /// Sets what stands at the holes, on a grid like this one, to 0.
    pub fn clear_holes(&self, grid: &mut Raster<f32>) {
        let holes = self.holes.iter().flat_map(|h| h.iter());
        grid.pixels_mut().iter_mut().zip(holes).filter(|(_, hole)| **hole).for_each(|(value, _)| *value = 0.0);
    }

    /// Columns and rows of the image.
    pub fn image(&self) -> (usize, usize) {
        self.image
    }

    /// The grid itself.
    pub fn grid(&self) -> &Raster<f32> {
        &self.grid
    }

    /// A map of the same image with the values of `grid`.
    pub fn with(&self, grid: Raster<f32>) -> Self {
        Self::new(grid, self.image)
    }

    /// Cells per pixel along either axis: at most 1.
    pub fn cells_per_pixel(&self) -> [f32; 2] {
        let ratio = |cells: usize, pixels: usize| cells as f32 / pixels.max(1) as f32;
        [ratio(self.grid.width(), self.image.0), ratio(self.grid.height(), self.image.1)]
    }

    fn is_of_pixels(&self) -> bool {
        (self.grid.width(), self.grid.height()) == self.image
    }

    fn along_x(&self, x: usize) -> Between {
        between(x, self.image.0, self.grid.width())
    }

    fn along_y(&self, y: usize) -> Between {
        between(y, self.image.1, self.grid.height())
    }

    /// The value at the centre of an image pixel.
    pub fn at(&self, x: usize, y: usize) -> f32 {
        if self.is_of_pixels() { self.grid[(x, y)] } else { self.mix(self.along_x(x), self.along_y(y)) }
    }

    fn mix(&self, (x0, x1, fx): Between, (y0, y1, fy): Between) -> f32 {
        let g = &self.grid;
        let top = g[(x0, y0)] + fx * (g[(x1, y0)] - g[(x0, y0)]);
        let bottom = g[(x0, y1)] + fx * (g[(x1, y1)] - g[(x0, y1)]);
        top + fy * (bottom - top)
    }

    /// The value at the centre of an image pixel, 0 where any of the cells around it is 0.
    pub fn at_unless_zero(&self, x: usize, y: usize) -> f32 {
        if self.is_of_pixels() { self.grid[(x, y)] } else { self.mix_unless_zero(self.along_x(x), self.along_y(y)) }
    }

    fn mix_unless_zero(&self, x: Between, y: Between) -> f32 {
        let g = &self.grid;
        let zero = [(x.0, y.0), (x.1, y.0), (x.0, y.1), (x.1, y.1)].iter().any(|&c| g[c] == 0.0);
        if zero { 0.0 } else { self.mix(x, y) }
    }

    /// [`Self::at`] of every pixel of the image.
    pub fn to_pixels(&self) -> Raster<f32> {
        self.spread::<false>()
    }

    /// [`Self::at_unless_zero`] of every pixel of the image.
    pub fn to_pixels_unless_zero(&self) -> Raster<f32> {
        self.spread::<true>()
    }

    /// Every pixel as [`Self::mix`] has it or, if `UNLESS_ZERO`, [`Self::mix_unless_zero`]; the cells' rows are looked up once a row.
    fn spread<const UNLESS_ZERO: bool>(&self) -> Raster<f32> {
        if self.is_of_pixels() {
            return self.grid.clone();
        }
        let (w, h) = self.image;
        let columns: Vec<Between> = (0..w).map(|x| self.along_x(x)).collect();
        let cells = |y: usize| &self.grid.pixels()[y * self.grid.width()..(y + 1) * self.grid.width()];
        let mut pixels = vec![0.0; w * h];
        pixels.par_chunks_mut(w.max(1)).enumerate().for_each(|(y, row)| {
            let (y0, y1, fy) = self.along_y(y);
            let (above, below) = (cells(y0), cells(y1));
            for (value, &(x0, x1, fx)) in row.iter_mut().zip(&columns) {
                let [a, b, c, d] = [above[x0], above[x1], below[x0], below[x1]];
                if UNLESS_ZERO && (a == 0.0 || b == 0.0 || c == 0.0 || d == 0.0) {
                    continue;
                }
                let (top, bottom) = (a + fx * (b - a), c + fx * (d - c));
                *value = top + fy * (bottom - top);
            }
        });
        Raster::from_vec(w, h, pixels)
    }
}

/// The cells on both sides of the centre of pixel `at` of `pixels`; one cell twice at its centre, and beyond the outermost one's.
fn between(at: usize, pixels: usize, cells: usize) -> Between {
    let position = ((at as f32 + 0.5) * cells as f32 / pixels as f32 - 0.5).clamp(0.0, (cells - 1) as f32);
    let first = position as usize;
    let fraction = position - first as f32;
    (first, first + usize::from(fraction > 0.0), fraction)
}

/// A map that is finer than an image as one of its pixels, each the mean of those finite cells that it covers, if that is half of them.
fn reduce(map: Raster<f32>, image: (usize, usize)) -> Raster<f32> {
    let cells = (map.width(), map.height());
    let (width, height) = (cells.0.min(image.0), cells.1.min(image.1));
    if cells == (width, height) {
        return map;
    }
    let covered = |at: usize, of: usize, cells: usize| at * cells / of..((at + 1) * cells / of).max(at * cells / of + 1);
    let mut pixels = vec![0.0; width * height];
    pixels.par_chunks_mut(width.max(1)).enumerate().for_each(|(y, row)| {
        for (x, pixel) in row.iter_mut().enumerate() {
            let (mut sum, mut known, mut all) = (0.0, 0, 0);
            for v in covered(y, height, cells.1) {
                for value in covered(x, width, cells.0).map(|u| map[(u, v)]) {
                    all += 1;
                    if value.is_finite() {
                        known += 1;
                        sum += f64::from(value);
                    }
                }
            }
            *pixel = if 2 * known >= all { (sum / f64::from(known)) as f32 } else { f32::NAN };
        }
    });
    Raster::from_vec(width, height, pixels)
}

/// Gives every cell that is not finite the value of the nearest one that is, counted in steps along the axes, and says which they were; `None` where
/// all are finite, or none is.
fn fill_holes(grid: &mut Raster<f32>) -> Option<Vec<bool>> {
    let holes: Vec<bool> = grid.pixels().iter().map(|v| !v.is_finite()).collect();
    fill(grid, &holes).then_some(holes)
}

/// Gives every hole the value of the nearest pixel that is none, counted in steps along the axes; returns whether it did, which takes both.
pub(crate) fn fill<T: Copy>(grid: &mut Raster<T>, holes: &[bool]) -> bool {
    if holes.iter().all(|h| *h) || !holes.contains(&true) {
        return false;
    }
    let (width, height) = (grid.width(), grid.height());
    let mut left = holes.to_vec();
    let mut queue: VecDeque<usize> = (0..holes.len()).filter(|&i| !holes[i]).collect();
    while let Some(from) = queue.pop_front() {
        let (x, y) = (from % width, from / width);
        let value = grid.pixels()[from];
        let beside = [(x > 0, from.wrapping_sub(1)), (x + 1 < width, from + 1)];
        let above = [(y > 0, from.wrapping_sub(width)), (y + 1 < height, from + width)];
        for (_, to) in beside.into_iter().chain(above).filter(|(is_inside, _)| *is_inside) {
            if std::mem::take(&mut left[to]) {
                grid.pixels_mut()[to] = value;
                queue.push_back(to);
            }
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_stays_a_ramp_and_pixels_stay_themselves() {
        // Linear in the image's pixels: cell centres lie at 2.5 i + 0.75.
        let ramp = Raster::from_fn(8, 6, |x, y| 2.5 * (x as f32 + 0.5) + 30.0 * (y as f32 + 0.5));
        let dense = Dense::new(ramp.clone(), (20, 12));
        for (x, y) in [(2, 3), (7, 5), (17, 10)] {
            let truth = (x as f32 + 0.5) + 15.0 * (y as f32 + 0.5);
            // f32 arithmetic on numbers around 100.
            assert!((dense.at(x, y) - truth).abs() < 1e-4, "{} {truth}", dense.at(x, y));
            assert_eq!(dense.to_pixels()[(x, y)], dense.at(x, y));
        }
        assert_eq!(dense.at(0, 0), ramp[(0, 0)], "held at the border");
        assert_eq!(Dense::new(ramp.clone(), (8, 6)).to_pixels(), ramp);
    }

    #[test]
    fn a_zero_spreads_over_all_that_is_mixed_with_it() {
        let mut grid = Raster::filled(4, 4, 1.0);
        grid[(1, 1)] = 0.0;
        let dense = Dense::new(grid, (8, 8));
        let zeros = dense.to_pixels_unless_zero().pixels().iter().filter(|v| **v == 0.0).count();
        // Cell 1 takes part in pixels 1 to 4 along each axis.
        assert_eq!(zeros, 16);
        assert_eq!(dense.at_unless_zero(4, 4), 0.0);
        assert_eq!(dense.at_unless_zero(5, 4), 1.0);
    }

    #[test]
    fn a_cell_with_a_pixel_that_does_not_count_is_a_hole_filled_from_beside() {
        // Columns 0 to 3 hold 0 to 3, on pixels twice as fine, of which one in cell (2, 1) does not count.
        let dense = Dense::new(Raster::from_fn(4, 4, |x, _| x as f32), (8, 8)).in_metres();
        let mask = Raster::from_fn(8, 8, |x, y| (x, y) != (5, 2));
        let masked = dense.clone().masked(&mask);
        let others = (0..16).filter(|i| *i != 6);
        assert!(others.into_iter().all(|i| masked.grid().pixels()[i] == dense.grid().pixels()[i]));
        // Beside it in its row; above or below it stands what it had.
        assert!([1.0, 2.0, 3.0].contains(&masked.grid()[(2, 1)]) && masked.is_metric());
        assert!(!masked.is_known(5, 2) && !masked.is_known(4, 2) && masked.is_known(1, 6));
        let mut confidence = Raster::filled(4, 4, 1.0);
        masked.clear_holes(&mut confidence);
        assert_eq!(masked.with(confidence).at_unless_zero(5, 2), 0.0);
        assert_eq!(dense.clone().masked(&mask.map(|_| true)), dense, "a mask that leaves nothing out changes nothing");
    }

    #[test]
    fn a_hole_is_filled_from_beside_and_spoils_nothing() {
        // A ramp along x with a hole of 2 × 2 cells, on pixels twice as fine.
        let mut map = Raster::from_fn(6, 5, |x, _| x as f32 + 1.0);
        for (at, hole) in [((2, 1), f32::NAN), ((3, 1), f32::INFINITY), ((2, 2), f32::NAN), ((3, 2), f32::NEG_INFINITY)] {
            map[at] = hole;
        }
        let (whole, dense) = (Raster::from_fn(6, 5, |x, _| x as f32 + 1.0), Dense::reduced(map, (12, 10)));
        let whole = Dense::new(whole, (12, 10));
        for (x, y) in (0..10).flat_map(|y| (0..12).map(move |x| (x, y))) {
            // Cells 2 and 3 along x take part in pixels 3 to 8, cells 1 and 2 along y in pixels 1 to 6.
            let is_known = !((3..=8).contains(&x) && (1..=6).contains(&y));
            assert_eq!(dense.is_known(x, y), is_known, "({x}, {y})");
            assert!(
                (dense.at(x, y) - whole.at(x, y)).abs() < if is_known { 1e-6 } else { 2.0 },
                "({x}, {y}): {}",
                dense.at(x, y)
            );
        }
        let mut ones = Raster::filled(6, 5, 1.0);
        dense.clear_holes(&mut ones);
        assert_eq!(ones.pixels().iter().sum::<f32>(), 26.0);
        assert!(Dense::reduced(Raster::filled(2, 2, f32::NAN), (2, 2)).at(0, 0).is_nan(), "there is nothing to fill it with");
    }

    #[test]
    fn a_finer_map_is_averaged_over_the_pixels_where_half_of_it_is_known() {
        let mut map = Raster::from_fn(6, 4, |x, y| (x + 10 * y) as f32);
        (map[(0, 0)], map[(2, 0)], map[(2, 1)], map[(3, 0)]) = (f32::NAN, f32::NAN, f32::NAN, f32::NAN);
        let dense = Dense::reduced(map, (3, 2));
        assert_eq!((dense.grid().width(), dense.grid().height()), (3, 2));
        // Cells 1, 10 and 11; one cell of four is too little, so the pixel takes what is on its left.
        assert!((dense.at(0, 0) - 22.0 / 3.0).abs() < 1e-6 && dense.is_known(0, 0));
        assert!(!dense.is_known(1, 0) && dense.at(1, 0) == dense.at(0, 0));
        assert_eq!(dense.at(2, 1), 29.5);
    }
}
