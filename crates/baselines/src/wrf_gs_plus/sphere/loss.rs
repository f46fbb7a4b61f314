//! The published output, a level of two channels, and its loss: `(1 − γ)·L1 + γ·(1 − SSIM)` with the window of the splatting literature.

use super::raster::Channels;
use corf::numeric::Real;
use rayon::prelude::*;

/// Half width of the window.
const RADIUS: usize = 5;
/// Its standard deviation, pixels.
const DEVIATION: f64 = 1.5;
const C1: f64 = 0.01 * 0.01;
const C2: f64 = 0.03 * 0.03;

/// √(a² + b²) of two channels held to at most 1 each; the whole is not held.
pub(super) fn level<T: Real>([a, b]: [T; 2]) -> T {
    let held = |v: T| if v > T::ONE { T::ONE } else { v };
    (held(a) * held(a) + held(b) * held(b)).sqrt()
}

/// The gradient in the channels from that in the level; none where a channel is held, and none in silence.
pub(super) fn of_channels<T: Real>(channels: [T; 2], of_level: T) -> [T; 2] {
    let level = level(channels);
    channels.map(|v| if level > T::ZERO && v <= T::ONE { of_level * v / level } else { T::ZERO })
}

/// The levels of a spectrum.
pub(super) fn levels<T: Real>(image: &Channels<T>) -> Vec<T> {
    image.iter().map(|c| level(*c)).collect()
}

/// A map seen through the window, nothing beyond its borders. It is its own adjoint.
fn seen<T: Real>(map: &[T], columns: usize) -> Vec<T> {
    let weights: Vec<f64> =
        (-(RADIUS as i32)..=RADIUS as i32).map(|i| (-f64::from(i * i) / (2.0 * DEVIATION * DEVIATION)).exp()).collect();
    let sum: f64 = weights.iter().sum();
    let weights: Vec<T> = weights.iter().map(|w| T::of(w / sum)).collect();
    let rows = map.len() / columns;
    let mut across = vec![T::ZERO; map.len()];
    across.par_chunks_mut(columns).zip(map.par_chunks(columns)).for_each(|(out, row)| {
        for (x, out) in out.iter_mut().enumerate() {
            for i in x.saturating_sub(RADIUS)..(x + RADIUS + 1).min(columns) {
                *out += weights[i + RADIUS - x] * row[i];
            }
        }
    });
    let mut down = vec![T::ZERO; map.len()];
    down.par_chunks_mut(columns).enumerate().for_each(|(y, out)| {
        for i in y.saturating_sub(RADIUS)..(y + RADIUS + 1).min(rows) {
            let weight = weights[i + RADIUS - y];
            out.iter_mut().zip(&across[i * columns..(i + 1) * columns]).for_each(|(out, v)| *out += weight * *v);
        }
    });
    down
}

/// The loss of levels against a target, rows of `columns`, and its gradient in them.
pub(super) fn loss<T: Real>(levels: &[T], target: &[T], columns: usize, ssim_weight: T) -> (T, Vec<T>) {
    let (two, count) = (T::of(2.0), T::of(levels.len() as f64));
    let product = |a: &[T], b: &[T]| a.iter().zip(b).map(|(a, b)| *a * *b).collect::<Vec<_>>();
    let (mean_p, mean_g) = (seen(levels, columns), seen(target, columns));
    let (pp, gg) = (seen(&product(levels, levels), columns), seen(&product(target, target), columns));
    let pg = seen(&product(levels, target), columns);
    let (mut ssim, mut absolute) = (T::ZERO, T::ZERO);
    let mut of = [vec![T::ZERO; levels.len()], vec![T::ZERO; levels.len()], vec![T::ZERO; levels.len()]];
    for i in 0..levels.len() {
        let (mp, mg) = (mean_p[i], mean_g[i]);
        let (a1, a2) = (two * mp * mg + T::of(C1), two * (pg[i] - mp * mg) + T::of(C2));
        let (b1, b2) = (mp * mp + mg * mg + T::of(C1), pp[i] - mp * mp + gg[i] - mg * mg + T::of(C2));
        let below = T::ONE / (b1 * b2);
        let s = a1 * a2 * below;
        ssim += s;
        absolute += (levels[i] - target[i]).abs();
        let (by_pp, by_pg) = (-(s / b2), two * a1 * below);
        of[0][i] = two * mg * a2 * below - two * mp * s / b1 - two * mp * by_pp - mg * by_pg;
        of[1][i] = by_pp;
        of[2][i] = by_pg;
    }
    let of = of.map(|map| seen(&map, columns));
    let l1 = (T::ONE - ssim_weight) / count;
    let gradient = (0..levels.len()).map(|i| {
        let difference = levels[i] - target[i];
        let sign = if difference > T::ZERO {
            T::ONE
        } else if difference < T::ZERO {
            -T::ONE
        } else {
            T::ZERO
        };
        let by_ssim = of[0][i] + two * levels[i] * of[1][i] + target[i] * of[2][i];
        l1 * sign - ssim_weight / count * by_ssim
    });
    (l1 * absolute + ssim_weight * (T::ONE - ssim / count), gradient.collect())
}
