//! Operations of the network that are its own: normalisation, activation functions, attention, resampling, all in f32.
//!
//! Work is cut into blocks of a fixed number of rows, so that every sum is taken in the same order whatever the number of threads.

use crate::image_networks::Map;
use crate::numeric::{Matrix, multiply};
use rayon::prelude::*;

/// Lanes of a sum.
const LANES: usize = 16;

/// Sum of `f` of the values.
fn sum(values: &[f32], f: impl Fn(f32) -> f32) -> f32 {
    let mut lanes = [0.0; LANES];
    let chunks = values.chunks_exact(LANES);
    let rest: f32 = chunks.remainder().iter().map(|v| f(*v)).sum();
    chunks.for_each(|chunk| lanes.iter_mut().zip(chunk).for_each(|(sum, v)| *sum += f(*v)));
    lanes.iter().sum::<f32>() + rest
}

/// Normalises every row to mean 0 and variance 1 (of all its values, plus `epsilon`), then scales and shifts each column.
pub(super) fn layer_norm(rows: &[f32], scale: &[f32], shift: &[f32], epsilon: f32) -> Vec<f32> {
    let width = scale.len();
    let mut out = vec![0.0; rows.len()];
    out.par_chunks_mut(width).zip(rows.par_chunks(width)).with_min_len(64).for_each(|(out, row)| {
        let mean = sum(row, |v| v) / width as f32;
        let variance = sum(row, |v| (v - mean) * (v - mean)) / width as f32;
        let unit = 1.0 / (variance + epsilon).sqrt();
        for (((out, v), scale), shift) in out.iter_mut().zip(row).zip(scale).zip(shift) {
            *out = (v - mean) * unit * scale + shift;
        }
    });
    out
}

/// e^x to 2e-7 of itself, 0 below −87; written so that a compiler makes vectors of it.
fn exp(x: f32) -> f32 {
    // Adding 1.5·2²³ rounds to a whole number.
    const ROUND: f32 = 12_582_912.0;
    let clamped = x.clamp(-87.0, 88.0);
    let rounded = clamped * std::f32::consts::LOG2_E + ROUND;
    let power = rounded - ROUND;
    // ln 2 in two parts, the first with few digits, so that its product is exact.
    let r = (clamped - power * 0.693_359_4) - power * -2.121_944_4e-4;
    let mut e = 1.0 / 5040.0;
    for c in [1.0 / 720.0, 1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0] {
        e = e * r + c;
    }
    // The power stands in the last bits of what was rounded; what is above them is shifted out.
    let scale = f32::from_bits(rounded.to_bits().wrapping_add(127) << 23);
    if x < -87.0 { 0.0 } else { e * scale }
}

/// erf to 3e-7: Abramowitz and Stegun, 7.1.26.
fn erf(x: f32) -> f32 {
    let a = x.abs();
    let t = 1.0 / (1.0 + 0.327_591_1 * a);
    let polynomial = ((((1.061_405_4 * t - 1.453_152) * t + 1.421_413_8) * t - 0.284_496_74) * t + 0.254_829_6) * t;
    (1.0 - polynomial * exp(-a * a)).copysign(x)
}

/// The Gaussian error linear unit, by the error function: x·Φ(x).
pub(super) fn gelu(values: &mut [f32]) {
    values.par_chunks_mut(4096).for_each(|chunk| {
        chunk.iter_mut().for_each(|v| *v *= 0.5 * (1.0 + erf(*v * std::f32::consts::FRAC_1_SQRT_2)));
    });
}

/// Softmax of `scale · row`, in place.
fn softmax(row: &mut [f32], scale: f32) {
    let mut lanes = [f32::NEG_INFINITY; LANES];
    for chunk in row.chunks(LANES) {
        lanes.iter_mut().zip(chunk).for_each(|(most, v)| *most = most.max(*v));
    }
    let most = lanes.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    row.iter_mut().for_each(|v| *v = exp((*v - most) * scale));
    let unit = 1.0 / sum(row, |v| v);
    row.iter_mut().for_each(|v| *v *= unit);
}

/// Self-attention of several heads. A row of `qkv` is a token's queries, keys and values, each head by head; a row of the result the heads' values.
pub(super) fn attention(qkv: &[f32], width: usize, heads: usize) -> Vec<f32> {
    const ROWS: usize = 64;
    let (tokens, stride, head) = (qkv.len() / (3 * width), 3 * width, width / heads);
    let part =
        |from: usize, rows: usize| Matrix { values: &qkv[from..], rows, columns: head, row_stride: stride, column_stride: 1 };
    let scale = 1.0 / (head as f32).sqrt();
    let mut out = vec![0.0; tokens * width];
    out.par_chunks_mut(ROWS * width).enumerate().for_each_init(
        || vec![0.0; ROWS * tokens],
        |scores, (block, out)| {
            let rows = out.len() / width;
            let scores = &mut scores[..rows * tokens];
            for h in 0..heads {
                let queries = part(block * ROWS * stride + h * head, rows);
                multiply(queries, part(width + h * head, tokens).transposed(), 0.0, scores, tokens);
                scores.chunks_exact_mut(tokens).for_each(|row| softmax(row, scale));
                let weights = Matrix { values: scores, rows, columns: tokens, row_stride: tokens, column_stride: 1 };
                multiply(weights, part(2 * width + h * head, tokens), 0.0, &mut out[h * head..], width);
            }
        },
    );
    out
}

/// Resamples linearly along both axes so that corner pixels keep their values ("align corners").
pub(super) fn bilinear(map: &Map, height: usize, width: usize) -> Map {
    let place = |at: usize, from: usize, to: usize| {
        let position = if to > 1 { at as f32 * ((from - 1) as f32 / (to - 1) as f32) } else { 0.0 };
        let first = (position as usize).min(from - 1);
        (first, (first + 1).min(from - 1), position - first as f32)
    };
    let columns: Vec<_> = (0..width).map(|x| place(x, map.width, width)).collect();
    let mut out = Map::zero(height, width, map.channels);
    out.values.par_chunks_mut(width * map.channels).enumerate().for_each(|(y, row)| {
        let (top, bottom, down) = place(y, map.height, height);
        for (pixel, &(left, right, along)) in row.chunks_exact_mut(map.channels).zip(&columns) {
            let corners = [(left, top), (right, top), (left, bottom), (right, bottom)].map(|(x, y)| map.pixel(x, y));
            for (c, value) in pixel.iter_mut().enumerate() {
                let [a, b] = [[0, 1], [2, 3]].map(|[l, r]| (1.0 - along) * corners[l][c] + along * corners[r][c]);
                *value = (1.0 - down) * a + down * b;
            }
        }
    });
    out
}

/// Indices and weights of a cubic kernel's four taps.
type Taps = ([usize; 4], [f32; 4]);

/// Resamples by Keys's cubic kernel with a = −0.75 and repeated borders, without smoothing beforehand. Along an axis the centre of pixel i comes from
/// `(i + ½)·step − ½`.
pub(super) fn bicubic(map: &Map, [height, width]: [usize; 2], [step_y, step_x]: [f64; 2]) -> Map {
    const A: f64 = -0.75;
    let weight = |distance: f64| match distance.abs() {
        d if d <= 1.0 => ((A + 2.0) * d - (A + 3.0)) * d * d + 1.0,
        d if d < 2.0 => ((A * d - 5.0 * A) * d + 8.0 * A) * d - 4.0 * A,
        _ => 0.0,
    };
    let taps = |at: usize, step: f64, length: usize| -> Taps {
        let position = (at as f64 + 0.5) * step - 0.5;
        let first = position.floor() - 1.0;
        let tap = |k: usize| (first + k as f64).clamp(0.0, (length - 1) as f64) as usize;
        (std::array::from_fn(tap), std::array::from_fn(|k| weight(position - first - k as f64) as f32))
    };
    let columns: Vec<Taps> = (0..width).map(|x| taps(x, step_x, map.width)).collect();
    let mut out = Map::zero(height, width, map.channels);
    out.values.par_chunks_mut(width * map.channels).enumerate().for_each(|(y, row)| {
        let (lines, weights) = taps(y, step_y, map.height);
        let line = |k: usize| &map.values[lines[k] * map.width * map.channels..][..map.width * map.channels];
        let mut blended = vec![0.0; map.width * map.channels];
        for k in 0..4 {
            blended.iter_mut().zip(line(k)).for_each(|(sum, v)| *sum += weights[k] * v);
        }
        for (pixel, (places, weights)) in row.chunks_exact_mut(map.channels).zip(&columns) {
            for (place, weight) in places.iter().zip(weights) {
                let source = &blended[place * map.channels..][..map.channels];
                pixel.iter_mut().zip(source).for_each(|(sum, v)| *sum += weight * v);
            }
        }
    });
    out
}

#[cfg(test)]
#[path = "ops_tests.rs"]
mod tests;
