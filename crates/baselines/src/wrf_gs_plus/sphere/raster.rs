//! Blending of a spectrum front to back, and its gradient. A band of rows is a unit of parallel work and owns its pixels; what the bands say about a
//! Gaussian is added up in their order, so that the bytes do not depend on the number of threads.

use super::Lens;
use super::lens::{Splat, SplatGradient};
use crate::wrf_gs_plus::Shape;
use corf::gaussians::SH_C0;
use corf::numeric::Real;
use rayon::prelude::*;
use std::ops::Range;

/// Rows of a band.
const BAND: usize = 3;
/// No Gaussian hides more than this.
const MOST_ALPHA: f64 = 0.999;
/// A pixel ends when less than this remains.
const LEAST_TRANSMITTANCE: f64 = 1e-4;

/// A spectrum of two channels, `[row][column]`.
pub(super) type Channels<T> = Vec<[T; 2]>;

/// Gaussians as they are drawn, near to far.
pub(super) struct Drawing<'a, T> {
    lens: &'a Lens,
    shapes: &'a [Shape<T>],
    splats: Vec<Splat<T>>,
    /// Splats that reach each band, near to far.
    lists: Vec<Vec<u32>>,
}

/// What is not negative of `½ + C₀·dc`, of the first two channels; the colour as splatting has it.
fn color<T: Real>(dc: &[T; 3]) -> [T; 2] {
    [dc[0], dc[1]].map(|dc| {
        let value = T::of(0.5) + T::of(f64::from(SH_C0)) * dc;
        if value > T::ZERO { value } else { T::ZERO }
    })
}

/// Rows whose centres are within a splat's reach.
fn rows_of<T: Real>(splat: &Splat<T>, rows: usize) -> Range<usize> {
    let (v, h) = (splat.mean[1].to_f64(), splat.half_height.to_f64());
    let first = (v - h - 0.5).ceil().max(0.0) as usize;
    let end = ((v + h + 0.5).floor().max(0.0) as usize).min(rows);
    first.min(end)..end
}

/// Projects Gaussians with the logits of their opacities.
pub(super) fn draw<'a, T: Real>(lens: &'a Lens, shapes: &'a [Shape<T>], logits: &[T]) -> Drawing<'a, T> {
    let one = |(id, (shape, logit)): (usize, (&Shape<T>, &T))| lens.project(id, shape, *logit, color(&shape.dc));
    let mut splats: Vec<Splat<T>> =
        shapes.par_iter().zip(logits).enumerate().map(one).collect::<Vec<_>>().into_iter().flatten().collect();
    splats.par_sort_by(|a, b| a.distance.to_f64().total_cmp(&b.distance.to_f64()).then(a.id.cmp(&b.id)));
    let mut lists = vec![Vec::new(); lens.rows.div_ceil(BAND)];
    for (k, splat) in splats.iter().enumerate() {
        let rows = rows_of(splat, lens.rows);
        if !rows.is_empty() {
            lists[rows.start / BAND..rows.end.div_ceil(BAND)].iter_mut().for_each(|list| list.push(k as u32));
        }
    }
    Drawing { lens, shapes, splats, lists }
}

/// A band's walk over its Gaussians.
struct Walk<T> {
    columns: usize,
    /// First row and rows.
    rows: Range<usize>,
    /// What remains behind each pixel's Gaussians so far.
    transmittance: Vec<T>,
}

/// A weight in a pixel of the band.
struct Weight<T> {
    pixel: usize,
    /// Mean less pixel.
    d: [T; 2],
    alpha: T,
    /// Whether it is held at its largest.
    held: bool,
    /// Transmittance in front of it.
    before: T,
}

impl<T: Real> Walk<T> {
    fn new(lens: &Lens, band: usize) -> Self {
        let rows = band * BAND..((band + 1) * BAND).min(lens.rows);
        Self { columns: lens.columns, transmittance: vec![T::ONE; rows.len() * lens.columns], rows }
    }

    /// Goes over the pixels that a splat reaches; azimuth closes behind the last column.
    fn over(&mut self, splat: &Splat<T>, mut each: impl FnMut(Weight<T>)) {
        let (most, still) = (T::of(MOST_ALPHA), T::of(LEAST_TRANSMITTANCE));
        let [qa, qb, qc] = splat.conic;
        let columns = self.columns as isize;
        let two_bounds = T::of(2.0) * splat.bound;
        let reached = rows_of(splat, self.rows.end);
        for row in reached.start.max(self.rows.start)..reached.end {
            let dv = splat.mean[1] - T::of(row as f64 + 0.5);
            // σ ≤ bound where qa du² + 2 qb du dv + qc dv² ≤ 2 bound.
            let inside = qb * qb * dv * dv - qa * (qc * dv * dv - two_bounds);
            let is_reached = inside > T::ZERO;
            if !is_reached {
                continue;
            }
            let (middle, reach) = (splat.mean[0] + qb / qa * dv, inside.sqrt() / qa);
            let whole = |x: T| x.to_f64();
            // Once around at most.
            let first = (whole(middle - reach) - 0.5).ceil().max((whole(middle) - 0.5 * columns as f64).floor()) as isize;
            let last = ((whole(middle + reach) - 0.5).floor() as isize).min(first + columns - 1);
            let start = (row - self.rows.start) * self.columns;
            for column in first..=last {
                let pixel = start + column.rem_euclid(columns) as usize;
                let before = self.transmittance[pixel];
                if before < still {
                    continue;
                }
                let du = splat.mean[0] - T::of(column as f64 + 0.5);
                let sigma = T::of(0.5) * (qa * du * du + qc * dv * dv) + qb * du * dv;
                if sigma > splat.bound {
                    continue;
                }
                let free = splat.opacity * (-sigma).exp();
                let held = free > most;
                let alpha = if held { most } else { free };
                self.transmittance[pixel] = before * (T::ONE - alpha);
                each(Weight { pixel, d: [du, dv], alpha, held, before });
            }
        }
    }
}

/// Gradient in a Gaussian, in its opacity's logit, and in its mean, pixels.
pub type GaussianGradient<T> = (Shape<T>, T, [T; 2]);

impl<T: Real> Drawing<'_, T> {
    /// The spectrum, over nothing.
    pub fn image(&self) -> Channels<T> {
        let band = |(band, list): (usize, &Vec<u32>)| {
            let mut walk = Walk::new(self.lens, band);
            let mut out = vec![[T::ZERO; 2]; walk.transmittance.len()];
            for splat in list.iter().map(|k| &self.splats[*k as usize]) {
                walk.over(splat, |w| {
                    let weight = w.alpha * w.before;
                    out[w.pixel] = [0, 1].map(|c| out[w.pixel][c] + weight * splat.color[c]);
                });
            }
            out
        };
        self.lists.par_iter().enumerate().map(band).collect::<Vec<_>>().concat()
    }

    /// The gradient in every Gaussian and its opacity's logit from that in the spectrum, and of those that are drawn the gradient in the mean, pixels.
    pub fn gradient(&self, image: &Channels<T>, of_image: &Channels<T>) -> Vec<Option<GaussianGradient<T>>> {
        let band = |(band, list): (usize, &Vec<u32>)| {
            let mut walk = Walk::new(self.lens, band);
            let pixels = band * BAND * self.lens.columns..;
            let (image, of_image) = (&image[pixels.clone()], &of_image[pixels]);
            // g · (what is composited from here on), per pixel.
            let mut behind: Vec<T> =
                (0..walk.transmittance.len()).map(|i| of_image[i][0] * image[i][0] + of_image[i][1] * image[i][1]).collect();
            let of_splat = |k: &u32| {
                let splat = &self.splats[*k as usize];
                let mut sum = SplatGradient::<T>::default();
                walk.over(splat, |w| {
                    let g = of_image[w.pixel];
                    let weight = w.alpha * w.before;
                    let shade = g[0] * splat.color[0] + g[1] * splat.color[1];
                    sum.color = [0, 1].map(|c| sum.color[c] + weight * g[c]);
                    let rest = behind[w.pixel] - weight * shade;
                    behind[w.pixel] = rest;
                    if w.held {
                        return;
                    }
                    let of_alpha = w.before * shade - rest / (T::ONE - w.alpha);
                    sum.opacity += of_alpha * w.alpha / splat.opacity;
                    let of_sigma = -(w.alpha * of_alpha);
                    let [du, dv] = w.d;
                    let (u, v) = (of_sigma * du, of_sigma * dv);
                    sum.first = [sum.first[0] + u, sum.first[1] + v];
                    sum.moments = [sum.moments[0] + u * du, sum.moments[1] + u * dv, sum.moments[2] + v * dv];
                });
                sum
            };
            list.iter().map(of_splat).collect::<Vec<_>>()
        };
        let parts: Vec<Vec<SplatGradient<T>>> = self.lists.par_iter().enumerate().map(band).collect();
        let mut sums = vec![SplatGradient::<T>::default(); self.splats.len()];
        for (list, parts) in self.lists.iter().zip(parts) {
            for (k, part) in list.iter().zip(parts) {
                let sum = &mut sums[*k as usize];
                sum.color = [0, 1].map(|c| sum.color[c] + part.color[c]);
                sum.opacity += part.opacity;
                sum.first = [0, 1].map(|c| sum.first[c] + part.first[c]);
                sum.moments = [0, 1, 2].map(|c| sum.moments[c] + part.moments[c]);
            }
        }
        let mut out = vec![None; self.shapes.len()];
        let all: Vec<_> = self.splats.par_iter().zip(&sums).map(|(splat, sum)| self.of_gaussian(splat, sum)).collect();
        for (splat, gradient) in self.splats.iter().zip(all) {
            out[splat.id] = Some(gradient);
        }
        out
    }

    fn of_gaussian(&self, splat: &Splat<T>, sum: &SplatGradient<T>) -> (Shape<T>, T, [T; 2]) {
        let (mut shape, logit, mean) = self.lens.backward(&self.shapes[splat.id], splat, sum);
        // Nothing where a colour is held at 0.
        let of = |c: usize| if splat.color[c] > T::ZERO { sum.color[c] * T::of(f64::from(SH_C0)) } else { T::ZERO };
        shape.dc = [of(0), of(1), T::ZERO];
        (shape, logit, mean)
    }
}
