//! Row-major images of any pixel type.

/// A `height × width` image, row-major, row 0 at the top. Pixel `(x, y)` covers `[x, x+1) × [y, y+1)`; its centre is at +0.5.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Raster<T> {
    width: usize,
    height: usize,
    data: Vec<T>,
}

impl<T: Clone> Raster<T> {
    /// An image filled with one value.
    pub fn filled(width: usize, height: usize, value: T) -> Self {
        Self { width, height, data: vec![value; width * height] }
    }
}

impl<T> Raster<T> {
    /// Wraps row-major pixels.
    ///
    /// # Panics
    /// If `data.len() != width * height`.
    pub fn from_vec(width: usize, height: usize, data: Vec<T>) -> Self {
        assert_eq!(data.len(), width * height, "a {width}x{height} raster needs {} pixels", width * height);
        Self { width, height, data }
    }

    /// Evaluates `f(x, y)` at every pixel.
    pub fn from_fn(width: usize, height: usize, mut f: impl FnMut(usize, usize) -> T) -> Self {
        let data = (0..width * height).map(|i| f(i % width, i / width)).collect();
        Self { width, height, data }
    }

    /// Columns.
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    pub fn height(&self) -> usize {
        self.height
    }

    /// All pixels, row-major.
    pub fn pixels(&self) -> &[T] {
        &self.data
    }

    /// All pixels, row-major, to be written.
    pub fn pixels_mut(&mut self) -> &mut [T] {
        &mut self.data
    }

    /// The row-major pixels themselves.
    pub fn into_vec(self) -> Vec<T> {
        self.data
    }

    /// The image with `f` applied to every pixel.
    pub fn map<U>(&self, f: impl FnMut(&T) -> U) -> Raster<U> {
        Raster { width: self.width, height: self.height, data: self.data.iter().map(f).collect() }
    }
}

impl<T> std::ops::Index<(usize, usize)> for Raster<T> {
    type Output = T;
    fn index(&self, (x, y): (usize, usize)) -> &T {
        &self.data[y * self.width + x]
    }
}

impl<T> std::ops::IndexMut<(usize, usize)> for Raster<T> {
    fn index_mut(&mut self, (x, y): (usize, usize)) -> &mut T {
        &mut self.data[y * self.width + x]
    }
}
