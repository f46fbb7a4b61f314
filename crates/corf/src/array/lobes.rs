//! Spectra of multipath components over the pixels of a pinhole camera: every wave a lobe; and their gradients.
//!
//! A lobe is the Gaussian of the sphere (von Mises–Fisher) of unit integral, value κ/(2π(1 − e^{−2κ}))·exp(−κ·|d − u|²/2) at a pixel's unit
//! direction d, with 1/κ the variance per axis: the data set's lobe, widened by the angle that the wave's emitter subtends.

use super::wave::{WAVES_PER_TASK, Wave};
use crate::Real;
use corf_scene::Pinhole;
use corf_scene::model::ARRAY_FROM_CAMERA;
use rayon::prelude::*;

/// Standard deviations at which a lobe ends: 1e-4 of its power lies beyond, as in the data set's own lobes.
const REACH: f64 = 4.292;
/// Standard deviation beyond which a lobe is not widened, radians.
const WIDEST: f64 = 0.3;

/// A camera among waves.
#[derive(Clone, Debug)]
pub struct Lobes<T> {
    camera: Pinhole,
    /// Variance of a lobe per axis, rad².
    variance: f64,
    /// Unit directions of the pixels, array frame.
    pixels: Vec<[T; 3]>,
}

/// Where a wave's lobe lies, and what it is made of.
struct Lobe<T> {
    columns: std::ops::Range<usize>,
    rows: std::ops::Range<usize>,
    peak: T,
    half_kappa: T,
    /// Squared chord at which it ends.
    end: T,
}

impl<T: Real> Lobes<T> {
    /// Lobes of a standard deviation per axis, in degrees, over a camera's pixels.
    pub fn new(camera: &Pinhole, width_deg: f64) -> Self {
        let direction = |i| ARRAY_FROM_CAMERA.rotation * camera.pixel_direction(i % camera.width, i / camera.width);
        let pixels = (0..camera.width * camera.height).map(|i| direction(i).to_array().map(T::of)).collect();
        Self { camera: *camera, variance: width_deg.to_radians().powi(2), pixels }
    }

    /// Power per steradian at every pixel, 1/sr.
    pub fn observe(&self, waves: &[Wave<T>]) -> Vec<T> {
        let splat = |chunk: &[Wave<T>]| {
            let mut image = vec![T::ZERO; self.pixels.len()];
            for wave in chunk {
                let Some(lobe) = self.lobe(wave) else { continue };
                let peak = lobe.peak * wave.power;
                for row in lobe.rows.clone() {
                    let run = row * self.camera.width + lobe.columns.start..row * self.camera.width + lobe.columns.end;
                    for (pixel, d) in image[run.clone()].iter_mut().zip(&self.pixels[run]) {
                        let chord2 = chord2(d, &wave.direction);
                        if chord2 < lobe.end {
                            *pixel += peak * (-(lobe.half_kappa * chord2)).exp();
                        }
                    }
                }
            }
            image
        };
        let partial: Vec<Vec<T>> = waves.par_chunks(WAVES_PER_TASK).map(splat).collect();
        let mut image = vec![T::ZERO; self.pixels.len()];
        for part in &partial {
            image.iter_mut().zip(part).for_each(|(pixel, more)| *pixel += *more);
        }
        image
    }

    /// Derivatives of two losses by the waves' powers alone, from those by the pixels.
    pub fn pull_powers(&self, waves: &[Wave<T>], by_pixel: [&[T]; 2]) -> Vec<[T; 2]> {
        let powers = |wave: &Wave<T>| {
            let mut powers = [T::ZERO; 2];
            let Some(lobe) = self.lobe(wave) else { return powers };
            for row in lobe.rows.clone() {
                let run = row * self.camera.width + lobe.columns.start..row * self.camera.width + lobe.columns.end;
                for i in run {
                    let chord2 = chord2(&self.pixels[i], &wave.direction);
                    if chord2 < lobe.end {
                        let value = lobe.peak * (-(lobe.half_kappa * chord2)).exp();
                        powers[0] += by_pixel[0][i] * value;
                        powers[1] += by_pixel[1][i] * value;
                    }
                }
            }
            powers
        };
        let parts: Vec<Vec<_>> = waves.par_chunks(WAVES_PER_TASK).map(|c| c.iter().map(powers).collect()).collect();
        parts.concat()
    }

    fn lobe(&self, wave: &Wave<T>) -> Option<Lobe<T>> {
        let sigma2 = (self.variance + wave.spread2.to_f64()).min(WIDEST * WIDEST);
        let kappa = 1.0 / sigma2;
        let radius = REACH * sigma2.sqrt();
        let [forward, left, up] = wave.direction.map(Real::to_f64);
        let columns = extent(-left, forward, radius, self.camera.fx, self.camera.cx, self.camera.width)?;
        let rows = extent(-up, forward, radius, self.camera.fy, self.camera.cy, self.camera.height)?;
        let peak = kappa / (std::f64::consts::TAU * (1.0 - (-2.0 * kappa).exp()));
        let end = (2.0 * (0.5 * radius).sin()).powi(2);
        Some(Lobe { columns, rows, peak: T::of(peak), half_kappa: T::of(0.5 * kappa), end: T::of(end) })
    }
}

/// Pixels along an axis that a cone of half angle `radius` around a direction touches, of `count`; `x` is the direction's component along it.
fn extent(x: f64, forward: f64, radius: f64, focal: f64, centre: f64, count: usize) -> Option<std::ops::Range<usize>> {
    const EDGE: f64 = 1.5;
    let length = x.hypot(forward);
    let half = if length <= radius.sin() { EDGE } else { (radius.sin() / length).asin() };
    let angle = x.atan2(forward);
    if angle - half >= EDGE || angle + half <= -EDGE {
        return None;
    }
    let place = |angle: f64| focal * angle.clamp(-EDGE, EDGE).tan() + centre;
    let (first, last) = (place(angle - half).floor().max(0.0), place(angle + half).ceil().min(count as f64));
    (first < last).then(|| first as usize..last as usize)
}

fn chord2<T: Real>(a: &[T; 3], b: &[T; 3]) -> T {
    let [x, y, z] = [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
    x * x + y * y + z * z
}
