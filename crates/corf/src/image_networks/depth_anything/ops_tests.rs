//! Every operation against its definition in f64.

use super::*;
use corf_scene::Rng;

fn noise(seed: u64, count: usize) -> Vec<f32> {
    let mut rng = Rng::keyed(seed, 1, 0);
    (0..count).map(|_| rng.normal() as f32).collect()
}

fn map(seed: u64, height: usize, width: usize, channels: usize) -> Map {
    Map { height, width, channels, values: noise(seed, height * width * channels) }
}

/// Largest difference.
fn worst(found: &[f32], exact: &[f64]) -> f64 {
    assert_eq!(found.len(), exact.len());
    found.iter().zip(exact).map(|(a, b)| (f64::from(*a) - b).abs()).fold(0.0, f64::max)
}

/// Φ(x)·x with erf by its series, good to 1e-12 for |x| < 6.
fn exact_gelu(x: f64) -> f64 {
    let z = x / std::f64::consts::SQRT_2;
    let (mut term, mut sum) = (z, z);
    for n in 1..200 {
        term *= -z * z / f64::from(n);
        sum += term / f64::from(2 * n + 1);
    }
    0.5 * x * (1.0 + 2.0 / std::f64::consts::PI.sqrt() * sum)
}

#[test]
fn functions_are_what_they_are_called() {
    let mut worst_exp = 0.0_f64;
    for i in 0..=100_000 {
        let x = -87.0 + 0.001_75 * i as f32;
        worst_exp = worst_exp.max((f64::from(exp(x)) / f64::from(x).exp() - 1.0).abs());
    }
    assert!(worst_exp < 3e-7, "{worst_exp}");
    assert_eq!((exp(-100.0), exp(f32::NEG_INFINITY), exp(0.0)), (0.0, 0.0, 1.0));
    let mut values: Vec<f32> = (0..=1000).map(|i| -5.0 + 0.01 * i as f32).collect();
    let exact: Vec<f64> = values.iter().map(|v| exact_gelu(f64::from(*v))).collect();
    gelu(&mut values);
    // erf to 3e-7 times half of 5.
    assert!(worst(&values, &exact) < 1e-6, "{}", worst(&values, &exact));
}

#[test]
fn rows_are_normalised_and_mapped() {
    let (rows, width) = (noise(3, 7 * 37), 37);
    let (scale, shift) = (noise(4, width), noise(5, width));
    let exact: Vec<f64> = rows
        .chunks(width)
        .flat_map(|row| {
            let row: Vec<f64> = row.iter().map(|v| f64::from(*v)).collect();
            let mean = row.iter().sum::<f64>() / width as f64;
            let variance = row.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / width as f64;
            let (scale, shift) = (scale.clone(), shift.clone());
            row.into_iter()
                .enumerate()
                .map(move |(i, v)| (v - mean) / (variance + 1e-6).sqrt() * f64::from(scale[i]) + f64::from(shift[i]))
        })
        .collect();
    assert!(worst(&layer_norm(&rows, &scale, &shift, 1e-6), &exact) < 1e-5);
}

#[test]
fn attention_weighs_values_by_the_softmax_of_products() {
    let (tokens, width, heads) = (70, 8, 2);
    let qkv = noise(13, tokens * 3 * width);
    let at = |token: usize, part: usize, h: usize, c: usize| f64::from(qkv[token * 24 + part * 8 + h * 4 + c]);
    let mut exact = vec![];
    for (t, h) in (0..tokens).flat_map(|t| (0..heads).map(move |h| (t, h))) {
        let product = |s: usize| (0..4).map(|c| at(t, 0, h, c) * at(s, 1, h, c)).sum::<f64>() / 2.0;
        let weights: Vec<f64> = (0..tokens).map(|s| product(s).exp()).collect();
        let total: f64 = weights.iter().sum();
        exact.extend((0..4).map(|c| (0..tokens).map(|s| weights[s] / total * at(s, 2, h, c)).sum::<f64>()));
    }
    assert!(worst(&attention(&qkv, width, heads), &exact) < 1e-5);
}

#[test]
fn resampling_is_interpolation() {
    let map = map(14, 4, 6, 2);
    let value = |y: usize, x: usize, c: usize| f64::from(map.values[(y * 6 + x) * 2 + c]);
    let (height, width) = (9, 11);
    let (mut linear, mut cubic) = (vec![], vec![]);
    let steps = [0.41, 0.63];
    let key = |t: f64| match t.abs() {
        t if t <= 1.0 => 1.25 * t.powi(3) - 2.25 * t.powi(2) + 1.0,
        t if t < 2.0 => -0.75 * t.powi(3) + 3.75 * t.powi(2) - 6.0 * t + 3.0,
        _ => 0.0,
    };
    for (y, x, c) in (0..height).flat_map(|y| (0..width).flat_map(move |x| (0..2).map(move |c| (y, x, c)))) {
        let (v, u) = (y as f64 * 3.0 / 8.0, x as f64 * 5.0 / 10.0);
        let hat = |t: f64| (1.0 - t.abs()).max(0.0);
        let all = || (0..4).flat_map(|j| (0..6).map(move |i| (j, i)));
        linear.push(all().map(|(j, i)| hat(v - j as f64) * hat(u - i as f64) * value(j, i, c)).sum());
        let (v, u) = ((y as f64 + 0.5) * steps[0] - 0.5, (x as f64 + 0.5) * steps[1] - 0.5);
        let wide = || (-4..9).flat_map(|j: i32| (-4..12).map(move |i: i32| (j, i)));
        let held = |j: i32, i: i32| value(j.clamp(0, 3) as usize, i.clamp(0, 5) as usize, c);
        cubic.push(wide().map(|(j, i)| key(v - f64::from(j)) * key(u - f64::from(i)) * held(j, i)).sum());
    }
    assert!(worst(&bilinear(&map, height, width).values, &linear) < 1e-5);
    assert!(worst(&bicubic(&map, [height, width], steps).values, &cubic) < 1e-5);
    assert_eq!(bilinear(&map, 4, 6), map);
}
