//! A spectrum of multipath components taken apart: the lobes that stand out of it, and the remainder that surfaces scatter.
//!
//! Lobes of specular paths slide over the walls as the receiver moves, so that nothing bound to a wall can show them; the remainder
//! is a picture of the surfaces. Where lobes hide it, it is filled in from around them.

use super::peaks::{SpectrumRay, refined};
use super::sensor::ArraySensor;
use super::wave::Wave;
use corf_scene::{Pinhole, Raster};
use rayon::prelude::*;

/// Ratio of a lobe's peak to the median around it from which it stands out: 6 dB.
const STANDS_OUT: f32 = 4.0;
/// Distances between which what is around a peak is looked at, standard deviations of a lobe.
const AROUND: [f64; 2] = [3.0, 7.0];
/// Share of a pixel's power from which lobes hide the remainder.
const HIDES: f32 = 0.5;
/// Pixels that are not hidden, of which a hidden one is made at least.
const FILLED_FROM: usize = 6;

/// The parts of a spectrum.
#[derive(Clone, Debug, PartialEq)]
pub struct Peeled {
    /// Lobes that stand out, strongest first.
    pub rays: Vec<SpectrumRay>,
    /// What is left, linear, as the spectrum.
    pub remainder: Raster<f32>,
}

/// Takes the lobes off a spectrum of a standard deviation of `width_deg` that a sensor of lobes sees; of those under `floor` none.
pub fn peel(sensor: &ArraySensor<f32>, camera: &Pinhole, spectrum: &Raster<f32>, width_deg: f64, floor: f32) -> Peeled {
    let (width, height) = (camera.width, camera.height);
    let pixels = spectrum.pixels();
    let sigma_px = (width_deg.to_radians() * camera.fx).max(1.0);
    let mut peaks: Vec<usize> =
        (0..pixels.len()).filter(|at| pixels[*at] > floor && is_highest(pixels, width, height, *at)).collect();
    peaks.sort_by(|a, b| pixels[*b].total_cmp(&pixels[*a]).then(a.cmp(b)));
    let mut left = pixels.to_vec();
    let mut lobes = vec![0.0; pixels.len()];
    let mut rays = vec![];
    for at in peaks {
        let Some(around) = median_around(&left, width, height, at, sigma_px) else { continue };
        if left[at] < STANDS_OUT * around.max(floor) {
            continue;
        }
        let direction = refined(camera, &left, at).map(|v| v as f32);
        let response = sensor.observe(&[Wave { direction, power: 1.0, spread2: 0.0 }]);
        if response[at] <= 0.0 {
            continue;
        }
        let power = (left[at] - around) / response[at];
        for ((left, lobes), response) in left.iter_mut().zip(&mut lobes).zip(&response) {
            *left -= power * response;
            *lobes += power * response;
        }
        rays.push(SpectrumRay { direction, power });
    }
    rays.sort_by(|a, b| b.power.total_cmp(&a.power));
    let hidden: Vec<bool> = lobes.iter().zip(pixels).map(|(l, p)| *l > HIDES * p).collect();
    let fill = |at: usize| if hidden[at] { filled(&left, &hidden, width, height, at) } else { left[at].max(0.0) };
    let remainder = (0..pixels.len()).into_par_iter().map(fill).collect();
    Peeled { rays, remainder: Raster::from_vec(width, height, remainder) }
}

/// Pixels of a square around another, with their squared distances.
fn square(width: usize, height: usize, at: usize, reach: usize) -> impl Iterator<Item = (usize, usize)> {
    let (x, y) = (at % width, at / width);
    let rows = y.saturating_sub(reach)..(y + reach + 1).min(height);
    rows.flat_map(move |v| {
        let columns = x.saturating_sub(reach)..(x + reach + 1).min(width);
        columns.map(move |u| (v * width + u, u.abs_diff(x).pow(2) + v.abs_diff(y).pow(2)))
    })
}

/// Whether no neighbour is higher, and none before it as high.
fn is_highest(pixels: &[f32], width: usize, height: usize, at: usize) -> bool {
    square(width, height, at, 1).all(|(i, _)| i == at || pixels[i] < pixels[at] || (pixels[i] == pixels[at] && i > at))
}

/// Median of the power in a ring around a pixel.
fn median_around(left: &[f32], width: usize, height: usize, at: usize, sigma_px: f64) -> Option<f32> {
    let [inner, outer] = AROUND.map(|a| a * sigma_px);
    let within = |d2: usize| (d2 as f64) >= inner * inner && (d2 as f64) <= outer * outer;
    let ring = square(width, height, at, outer.ceil() as usize).filter(|(_, d2)| within(*d2));
    let mut values: Vec<f32> = ring.map(|(i, _)| left[i].max(0.0)).collect();
    values.sort_by(f32::total_cmp);
    values.get(values.len() / 2).copied()
}

/// Mean of the logarithms of the nearest pixels that are not hidden.
fn filled(left: &[f32], hidden: &[bool], width: usize, height: usize, at: usize) -> f32 {
    for reach in 2..width.max(height) {
        let seen = square(width, height, at, reach).filter(|(i, _)| !hidden[*i]).map(|(i, d2)| (left[i], 1.0 / d2 as f32));
        let (mut count, mut sum, mut weights) = (0, 0.0, 0.0);
        for (power, weight) in seen {
            count += 1;
            sum += weight * power.max(f32::MIN_POSITIVE).ln();
            weights += weight;
        }
        if count >= FILLED_FROM {
            return (sum / weights).exp();
        }
    }
    0.0
}
