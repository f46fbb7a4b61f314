//! Spectra of multipath components over the pixels of a pinhole camera: every wave a lobe; and their gradients.
//!
//! A lobe is the Gaussian of the sphere (von Mises–Fisher) of unit integral, value κ/(2π(1 − e^{−2κ}))·exp(−κ·|d − u|²/2) at a pixel's unit
//! direction d, with 1/κ the variance per axis: the data set's lobe, widened by the angle that the wave's emitter subtends.

use super::wave::{WAVES_PER_TASK, Wave};
use crate::Real;
use corf_scene::Pinhole;
use corf_scene::model::ARRAY_FROM_CAMERA;
use rayon::prelude::*;
use std::ops::Range;

/// Standard deviations at which a lobe ends: 1e-4 of its power lies beyond, as in the data set's own lobes.
pub(super) const REACH: f64 = 4.292;
/// Standard deviation beyond which a lobe is not widened, radians.
pub(super) const WIDEST: f64 = 0.3;

/// A camera among waves.
#[derive(Clone, Debug)]
pub struct Lobes<T> {
    camera: Pinhole,
    /// Variance of a lobe per axis, rad².
    variance: f64,
    /// Components of the pixels' unit directions, array frame.
    pixels: [Vec<T>; 3],
}

/// Where a wave's lobe lies, and what it is made of.
struct Lobe<T> {
    columns: Range<usize>,
    rows: Range<usize>,
    peak: T,
    half_kappa: T,
    /// Squared chord at which it ends.
    end: T,
}

impl<T: Real> Lobe<T> {
    /// The pixels it touches, row by row.
    fn runs(&self, width: usize) -> impl Iterator<Item = Range<usize>> {
        let Range { start, end } = self.columns;
        self.rows.clone().map(move |row| row * width + start..row * width + end)
    }

    /// Its values at pixels, for a power of 1.
    #[inline(always)]
    fn values(&self, [xs, ys, zs]: [&[T]; 3], [x, y, z]: &[T; 3], mut take: impl FnMut(usize, T)) {
        const BLOCK: usize = 16;
        let mut values = [T::ZERO; BLOCK];
        for (block, ((xs, ys), zs)) in xs.chunks(BLOCK).zip(ys.chunks(BLOCK)).zip(zs.chunks(BLOCK)).enumerate() {
            for (value, ((px, py), pz)) in values.iter_mut().zip(xs.iter().zip(ys).zip(zs)) {
                let [dx, dy, dz] = [*px - *x, *py - *y, *pz - *z];
                let chord2 = dx * dx + dy * dy + dz * dz;
                let inside = self.peak * exp_of_negative(self.half_kappa * chord2);
                *value = if chord2 < self.end { inside } else { T::ZERO };
            }
            values[..xs.len()].iter().enumerate().for_each(|(i, value)| take(block * BLOCK + i, *value));
        }
    }
}

/// e^−x for 0 ≤ x ≤ 10 within 6e-4, and within 1e-6 below 2, in operations that vectorise: (e^(−x/32))³², the inner one by its series.
#[inline(always)]
fn exp_of_negative<T: Real>(x: T) -> T {
    let y = T::of(1.0 / 32.0) * x;
    let mut e = T::ONE - y * (T::ONE - y * (T::of(0.5) - y * (T::of(1.0 / 6.0) - y * T::of(1.0 / 24.0))));
    for _ in 0..5 {
        e = e * e;
    }
    e
}

impl<T: Real> Lobes<T> {
    /// Lobes of a standard deviation per axis, in degrees, over a camera's pixels.
    pub fn new(camera: &Pinhole, width_deg: f64) -> Self {
        let direction = |i| ARRAY_FROM_CAMERA.rotation * camera.pixel_direction(i % camera.width, i / camera.width);
        let pixels = [0, 1, 2].map(|axis| (0..camera.width * camera.height).map(|i| T::of(direction(i)[axis])).collect());
        Self { camera: *camera, variance: width_deg.to_radians().powi(2), pixels }
    }

    /// Power per steradian at every pixel, 1/sr.
    pub fn observe(&self, waves: &[Wave<T>]) -> Vec<T> {
        let splat = |chunk: &[Wave<T>]| {
            let mut image = vec![T::ZERO; self.camera.width * self.camera.height];
            for wave in chunk {
                let Some(lobe) = self.lobe(wave) else { continue };
                for run in lobe.runs(self.camera.width) {
                    let pixels = self.pixels.each_ref().map(|axis| &axis[run.clone()]);
                    lobe.values(pixels, &wave.direction, |i, value| image[run.start + i] += value * wave.power);
                }
            }
            image
        };
        let partial: Vec<Vec<T>> = waves.par_chunks(WAVES_PER_TASK).map(splat).collect();
        let mut image = vec![T::ZERO; self.camera.width * self.camera.height];
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
            for run in lobe.runs(self.camera.width) {
                let pixels = self.pixels.each_ref().map(|axis| &axis[run.clone()]);
                let [one, two] = by_pixel.map(|by_pixel| &by_pixel[run.clone()]);
                lobe.values(pixels, &wave.direction, |i, value| {
                    powers[0] += one[i] * value;
                    powers[1] += two[i] * value;
                });
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
fn extent(x: f64, forward: f64, radius: f64, focal: f64, centre: f64, count: usize) -> Option<Range<usize>> {
    const EDGE: f64 = 1.5;
    let length = x.hypot(forward);
    let half = if length <= radius.sin() { EDGE } else { (radius.sin() / length).asin() };
    let angle = x.atan2(forward);
    if angle - half >= EDGE || angle + half <= -EDGE {
        return None;
    }
    let place = |angle: f64| focal * angle.clamp(-EDGE, EDGE).tan() + centre;
    let (first, last) = (place(angle - half).floor().max(0.0), place(angle + half).ceil().min(count as f64));
    (first < last).then_some(first as usize..last as usize)
}
