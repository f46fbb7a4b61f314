//! Every layer against its definition in f64.

use super::*;
use corf_scene::Rng;

fn noise(seed: u64, count: usize) -> Vec<f32> {
    let mut rng = Rng::keyed(seed, 1, 0);
    (0..count).map(|_| rng.normal() as f32).collect()
}

fn map(seed: u64, height: usize, width: usize, channels: usize) -> Map {
    Map { height, width, channels, values: noise(seed, height * width * channels) }
}

fn layer(seed: u64, inputs: usize, outputs: usize) -> Layer {
    Layer { inputs, outputs, weights: noise(seed, inputs * outputs), bias: noise(seed + 1, outputs) }
}

/// Largest difference.
fn worst(found: &[f32], exact: &[f64]) -> f64 {
    assert_eq!(found.len(), exact.len());
    found.iter().zip(exact).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max)
}

#[test]
fn rows_are_mapped_one_by_one() {
    // More rows than a block, and a last block that is short.
    let (layer, rows) = (layer(6, 19, 5), noise(8, 19 * 300));
    let exact: Vec<f64> = rows
        .chunks(19)
        .flat_map(|row| {
            let layer = &layer;
            (0..5).map(move |o| {
                let products = row.iter().zip(&layer.weights[19 * o..]).map(|(a, b)| f64::from(*a) * f64::from(*b));
                products.sum::<f64>() + f64::from(layer.bias[o])
            })
        })
        .collect();
    assert!(worst(&layer.of_rows(&rows), &exact) < 1e-5);
}

#[test]
fn convolutions_are_sums_over_windows() {
    let three = |stride| Window { side: 3, stride, border: 1 };
    let plain = |side, stride| Window { side, stride, border: 0 };
    let cases = [
        (5, 7, three(1)),
        (5, 7, three(2)),
        (6, 8, three(2)),
        (1, 1, three(1)),
        (20, 30, three(1)),
        (9, 8, plain(3, 2)),
        (4, 6, plain(1, 1)),
        (23, 31, Window { side: 11, stride: 4, border: 2 }),
        (6, 5, Window { side: 5, stride: 1, border: 2 }),
    ];
    for (height, width, window) in cases {
        let Window { side, stride, border } = window;
        let (map, layer) = (map(9, height, width, 3), layer(10, 3 * side * side, 4));
        let found = layer.convolve(&map, window);
        let [h, w] = [height, width].map(|n| (n + 2 * border - side) / stride + 1);
        assert_eq!((found.height, found.width, found.channels), (h, w, 4));
        let mut exact = vec![];
        for (y, x, o) in (0..h).flat_map(|y| (0..w).flat_map(move |x| (0..4).map(move |o| (y, x, o)))) {
            let mut sum = f64::from(layer.bias[o]);
            for (k, c) in (0..side * side).flat_map(|k| (0..3).map(move |c| (k, c))) {
                let [v, u] = [y * stride + k / side, x * stride + k % side].map(|at| at as isize - border as isize);
                if (0..height as isize).contains(&v) && (0..width as isize).contains(&u) {
                    let value = map.values[(v as usize * width + u as usize) * 3 + c];
                    sum += f64::from(value) * f64::from(layer.weights[layer.inputs * o + 3 * k + c]);
                }
            }
            exact.push(sum);
        }
        // An f32 sum's error grows with its terms.
        let tolerance = 1e-5 * (layer.inputs as f64 / 27.0).max(1.0);
        assert!(worst(&found.values, &exact) < tolerance, "{height}x{width}, {window:?}");
    }
    assert_eq!(plain(5, 1).places(4), None);
    // A pixel becomes a square of its own.
    let (map, layer) = (map(11, 2, 3, 5), layer(12, 5, 3 * 3 * 2));
    let found = layer.spread(&map, 3);
    assert_eq!((found.height, found.width, found.channels), (6, 9, 2));
    let mut exact = vec![];
    for (y, x, o) in (0..6).flat_map(|y| (0..9).flat_map(move |x| (0..2).map(move |o| (y, x, o)))) {
        let out = ((y % 3) * 3 + x % 3) * 2 + o;
        let source = &map.values[(y / 3 * 3 + x / 3) * 5..][..5];
        let products = source.iter().zip(&layer.weights[5 * out..]).map(|(a, b)| f64::from(*a) * f64::from(*b));
        exact.push(products.sum::<f64>() + f64::from(layer.bias[out]));
    }
    assert!(worst(&found.values, &exact) < 1e-5);
}

#[test]
fn pooling_takes_the_largest_value_of_each_window() {
    // Floor mode drops what a last window would reach beyond the map, ceil mode keeps what there is of it: torch's sizes.
    let sizes = |pool: MaxPool, lengths: [usize; 6]| lengths.map(|n| pool.places(n));
    let pool = |side, beyond| MaxPool { side, stride: 2, beyond };
    assert_eq!(sizes(pool(3, false), [2, 3, 4, 5, 6, 7]), [None, Some(1), Some(1), Some(2), Some(2), Some(3)]);
    assert_eq!(sizes(pool(3, true), [1, 2, 3, 4, 5, 6]), [None, Some(1), Some(1), Some(2), Some(2), Some(3)]);
    assert_eq!(sizes(pool(2, false), [1, 2, 3, 4, 5, 6]), [None, Some(1), Some(1), Some(2), Some(2), Some(3)]);
    for (side, beyond, height, width) in [(3, false, 6, 8), (3, true, 6, 8), (3, true, 7, 2), (2, false, 5, 9)] {
        let (map, pool) = (map(15, height, width, 2), pool(side, beyond));
        let found = pool.of(&map);
        let mut exact = vec![];
        for (y, x, c) in (0..found.height).flat_map(|y| (0..found.width).flat_map(move |x| (0..2).map(move |c| (y, x, c)))) {
            let inside = |start: usize, end: usize| 2 * start..(2 * start + side).min(end);
            let values = inside(y, height).flat_map(|v| inside(x, width).map(move |u| (u, v))).map(|(u, v)| map.pixel(u, v)[c]);
            exact.push(f64::from(values.fold(f32::NEG_INFINITY, f32::max)));
        }
        assert_eq!(worst(&found.values, &exact), 0.0, "{pool:?}");
    }
}
