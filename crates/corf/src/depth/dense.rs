//! Values all over an image, kept at the resolution at which they are known.

use corf_scene::Raster;
use rayon::prelude::*;

/// A map of an image on a grid of the image's shape, of its pixels or of coarser cells; bilinear between the cells' centres.
#[derive(Clone, Debug, PartialEq)]
pub struct Dense {
    grid: Raster<f32>,
    image: (usize, usize),
}

/// Two neighbouring cells along an axis and the weight of the second.
type Between = (usize, usize, f32);

impl Dense {
    /// A grid over an image of `image` pixels (columns, rows).
    pub fn new(grid: Raster<f32>, image: (usize, usize)) -> Self {
        Self { grid, image }
    }

    /// Columns and rows of the image.
    pub fn image(&self) -> (usize, usize) {
        self.image
    }

    /// The grid itself.
    pub fn grid(&self) -> &Raster<f32> {
        &self.grid
    }

    /// The same image with other values on the grid.
    pub fn with(&self, grid: Raster<f32>) -> Self {
        Self { grid, image: self.image }
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
        self.spread(Self::mix)
    }

    /// [`Self::at_unless_zero`] of every pixel of the image.
    pub fn to_pixels_unless_zero(&self) -> Raster<f32> {
        self.spread(Self::mix_unless_zero)
    }

    fn spread(&self, mix: impl Fn(&Self, Between, Between) -> f32 + Sync) -> Raster<f32> {
        if self.is_of_pixels() {
            return self.grid.clone();
        }
        let (w, h) = self.image;
        let columns: Vec<Between> = (0..w).map(|x| self.along_x(x)).collect();
        let mut pixels = vec![0.0; w * h];
        pixels.par_chunks_mut(w.max(1)).enumerate().for_each(|(y, row)| {
            let rows = self.along_y(y);
            row.iter_mut().zip(&columns).for_each(|(value, column)| *value = mix(self, *column, rows));
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
}
