//! Maps of channels, and the layers that turn one into another: linear layers, convolutions, pooling. All in f32.
//!
//! Work is cut into blocks of a fixed number of rows, so that every sum is taken in the same order whatever the number of threads. Maps have
//! their channels innermost: a map's pixels and a transformer's tokens are both rows of a matrix.

use crate::Result;
use crate::files::tensors::Tensors;
use crate::numeric::{Matrix, multiply};
use rayon::prelude::*;

/// Rows that are worked on at once.
const BLOCK: usize = 256;

/// A map of `height × width` pixels of `channels` values each, row by row, channels innermost.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Map {
    pub height: usize,
    pub width: usize,
    pub channels: usize,
    pub values: Vec<f32>,
}

impl Map {
    /// All zero.
    pub fn zero(height: usize, width: usize, channels: usize) -> Self {
        Self { height, width, channels, values: vec![0.0; height * width * channels] }
    }

    /// One pixel's channels.
    pub fn pixel(&self, x: usize, y: usize) -> &[f32] {
        let start = (y * self.width + x) * self.channels;
        &self.values[start..start + self.channels]
    }

    /// Adds a map of the same size.
    pub fn add(&mut self, other: &Self) {
        self.values.par_iter_mut().zip(&other.values).with_min_len(4096).for_each(|(a, b)| *a += b);
    }

    /// Negative values become 0.
    pub fn rectify(&mut self) {
        self.values.par_iter_mut().with_min_len(4096).for_each(|v| *v = v.max(0.0));
    }
}

/// A square window that moves over a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Window {
    /// Side, pixels.
    pub side: usize,
    /// Pixels from one place of it to the next.
    pub stride: usize,
    /// Width of the border of zeros around the map, pixels.
    pub border: usize,
}

impl Window {
    /// 3×3 at every `stride`-th pixel, with a border of one.
    pub const fn three(stride: usize) -> Self {
        Self { side: 3, stride, border: 1 }
    }

    /// Places of the window along an axis of `length` pixels; `None` where it does not fit.
    pub fn places(self, length: usize) -> Option<usize> {
        Some((length + 2 * self.border).checked_sub(self.side)? / self.stride + 1)
    }
}

/// An affine map of rows: `y = W·x + b`.
#[derive(Clone, Debug)]
pub(crate) struct Layer {
    pub inputs: usize,
    pub outputs: usize,
    /// Outputs × inputs.
    pub weights: Vec<f32>,
    pub bias: Vec<f32>,
}

impl Tensors {
    /// A convolution of `side × side` pixels, its inputs in the order (row, column, channel); without a bias where none is named.
    ///
    /// # Errors
    /// Those of [`Self::values`].
    pub(crate) fn convolution(&self, weight: &str, bias: Option<&str>, [inputs, outputs, side]: [usize; 3]) -> Result<Layer> {
        let values = self.values(weight, &[outputs, inputs, side, side])?;
        let mut weights = Vec::with_capacity(values.len());
        for kernel in values.chunks_exact(inputs * side * side) {
            weights.extend((0..side * side).flat_map(|k| (0..inputs).map(move |c| kernel[c * side * side + k])));
        }
        let bias = bias.map_or_else(|| Ok(vec![0.0; outputs]), |name| self.values(name, &[outputs]))?;
        Ok(Layer { inputs: inputs * side * side, outputs, weights, bias })
    }
}

impl Layer {
    /// Row by row.
    fn apply(&self, rows: &[f32], out: &mut [f32]) {
        out.chunks_exact_mut(self.outputs).for_each(|row| row.copy_from_slice(&self.bias));
        let (inputs, outputs) = (self.inputs, self.outputs);
        let a = Matrix::by_rows(rows, rows.len() / inputs, inputs, inputs);
        let w = Matrix::by_rows(&self.weights, outputs, inputs, inputs);
        multiply(a, w.transposed(), 1.0, out, outputs);
    }

    /// Applies the layer to every row, in parallel.
    pub fn of_rows(&self, rows: &[f32]) -> Vec<f32> {
        let mut out = vec![0.0; rows.len() / self.inputs * self.outputs];
        let blocks = out.par_chunks_mut(BLOCK * self.outputs).zip(rows.par_chunks(BLOCK * self.inputs));
        blocks.for_each(|(out, rows)| self.apply(rows, out));
        out
    }

    /// Applies the layer to every pixel: a 1×1 convolution.
    pub fn of_pixels(&self, map: &Map) -> Map {
        Map { channels: self.outputs, values: self.of_rows(&map.values), ..*map }
    }

    /// A convolution over the places of a window; inputs are (row, column, channel) of it.
    ///
    /// # Panics
    /// If the window does not fit into the map.
    pub fn convolve(&self, map: &Map, window: Window) -> Map {
        let [height, width] = [map.height, map.width].map(|n| window.places(n).expect("the window fits into the map"));
        let Window { side, stride, border } = window;
        let mut out = Map::zero(height, width, self.outputs);
        out.values.par_chunks_mut(BLOCK * self.outputs).enumerate().for_each_init(
            || vec![0.0; BLOCK * self.inputs],
            |rows, (block, out)| {
                let count = out.len() / self.outputs;
                let rows = &mut rows[..count * self.inputs];
                for (i, row) in rows.chunks_exact_mut(self.inputs).enumerate() {
                    let at = block * BLOCK + i;
                    let (x, y) = (stride * (at % width), stride * (at / width));
                    for (k, part) in row.chunks_exact_mut(map.channels).enumerate() {
                        // To the right and below of the pixel meant by the border's width.
                        let (u, v) = (x + k % side, y + k / side);
                        if (border..border + map.width).contains(&u) && (border..border + map.height).contains(&v) {
                            part.copy_from_slice(map.pixel(u - border, v - border));
                        } else {
                            part.fill(0.0);
                        }
                    }
                }
                self.apply(rows, out);
            },
        );
        out
    }

    /// A transposed convolution whose kernel is as large as its stride: every pixel becomes `side × side` of them; outputs are (row, column,
    /// channel) of those.
    pub fn spread(&self, map: &Map, side: usize) -> Map {
        let channels = self.outputs / (side * side);
        let mut out = Map::zero(side * map.height, side * map.width, channels);
        let (row, run) = (out.width * channels, side * channels);
        out.values.par_chunks_mut(side * row).zip(map.values.par_chunks(map.width * map.channels)).for_each(|(out, source)| {
            let mut spread = vec![0.0; map.width * self.outputs];
            self.apply(source, &mut spread);
            for (x, pixels) in spread.chunks_exact(self.outputs).enumerate() {
                for (j, pixels) in pixels.chunks_exact(run).enumerate() {
                    out[j * row + x * run..][..run].copy_from_slice(pixels);
                }
            }
        });
        out
    }
}

/// A square window's largest values, without a border.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct MaxPool {
    /// Side, pixels.
    pub side: usize,
    /// Pixels from one place of it to the next.
    pub stride: usize,
    /// Whether a last window that reaches beyond the map counts, with the pixels that are there ("ceil mode").
    pub beyond: bool,
}

impl MaxPool {
    /// Places of the window along an axis of `length` pixels; `None` where there is none.
    pub fn places(self, length: usize) -> Option<usize> {
        let reach = if self.beyond { length + self.stride - 1 } else { length };
        Some(reach.checked_sub(self.side)? / self.stride + 1)
    }

    /// The largest value of each channel at each place.
    ///
    /// # Panics
    /// If the window does not fit into the map.
    pub fn of(self, map: &Map) -> Map {
        let [height, width] = [map.height, map.width].map(|n| self.places(n).expect("the window fits into the map"));
        let mut out = Map::zero(height, width, map.channels);
        out.values.par_chunks_mut(width * map.channels).enumerate().for_each(|(y, row)| {
            let lines = self.stride * y..(self.stride * y + self.side).min(map.height);
            for (x, most) in row.chunks_exact_mut(map.channels).enumerate() {
                let columns = self.stride * x..(self.stride * x + self.side).min(map.width);
                most.copy_from_slice(map.pixel(columns.start, lines.start));
                for (u, v) in lines.clone().flat_map(|v| columns.clone().map(move |u| (u, v))) {
                    most.iter_mut().zip(map.pixel(u, v)).for_each(|(most, value)| *most = most.max(*value));
                }
            }
        });
        out
    }
}

#[cfg(test)]
#[path = "layer_tests.rs"]
mod tests;
