//! Bartlett spectra of a planar array over the pixels of a pinhole camera, and their gradients.
//!
//! The spectrum of waves of the powers p is P(u) = Σ p·K_C(y − y′)·K_R(z − z′) / N² with the phase steps y = 2π·s_y·u_y, z = 2π·s_z·u_z of a
//! direction u, those (y′, z′) of a wave, and the Fejér kernel K_n(x) = Σ_{|l| < n} (n − |l|)·cos(l·x): power is linear in the waves and depends on
//! lags between elements alone. Σ p·h(y′)h(z′)ᵀ with the harmonics h(x) = (cos l·x, sin l·x), l ∈ [0, n), therefore holds all that the array
//! can know of the waves, wherever they come from, and a wave costs as much as a pixel.

use super::wave::{WAVES_PER_TASK, Wave};
use crate::Real;
use corf_scene::Pinhole;
use corf_scene::model::ARRAY_FROM_CAMERA;
use rayon::prelude::*;

/// Most elements along a side of the array.
pub(super) const MOST_ELEMENTS: usize = 16;
/// Most harmonics along a side.
const MOST: usize = 2 * MOST_ELEMENTS;
/// Pixels that a task takes.
const PIXELS_PER_TASK: usize = 1024;

/// An array among waves, looked at over the pixels of a camera.
#[derive(Clone, Debug)]
pub struct ArrayBeam<T> {
    columns: usize,
    rows: usize,
    /// 2π times the spacing in wavelengths, between columns and between rows.
    steps: [T; 2],
    /// Weight of every entry of the table: (C − l_y)(R − l_z)/N², twice for a lag that stands for both signs.
    weights: Vec<T>,
    /// Harmonics of every pixel: 2C of y, then 2R of z.
    pixels: Vec<T>,
}

impl<T: Real> ArrayBeam<T> {
    /// An array of `columns` × `rows` elements, `spacing` wavelengths apart, its boresight along the camera's optical axis.
    pub fn new(camera: &Pinhole, [columns, rows]: [usize; 2], spacing: [f64; 2]) -> Self {
        let steps = spacing.map(|s| std::f64::consts::TAU * s);
        let n2 = ((columns * rows) as f64).powi(2);
        let weight = |l: usize, n: usize| (n - l) as f64 * if l > 0 { 2.0 } else { 1.0 };
        let entry = |a: usize, b: usize| T::of(weight(a % columns, columns) * weight(b % rows, rows) / n2);
        let weights = (0..2 * columns).flat_map(|a| (0..2 * rows).map(move |b| entry(a, b))).collect();
        let mut pixels = vec![];
        for i in 0..camera.width * camera.height {
            let u = ARRAY_FROM_CAMERA.rotation * camera.pixel_direction(i % camera.width, i / camera.width);
            let mut both = [0.0; 2 * MOST];
            harmonics(steps[0] * u.y, &mut both[..2 * columns]);
            harmonics(steps[1] * u.z, &mut both[2 * columns..2 * (columns + rows)]);
            pixels.extend(both[..2 * (columns + rows)].iter().map(|v| T::of(*v)));
        }
        Self { columns, rows, steps: steps.map(T::of), weights, pixels }
    }

    /// The spectrum of waves at every pixel.
    pub fn observe(&self, waves: &[Wave<T>]) -> Vec<T> {
        self.at_pixels(&self.weighted(self.table_of_waves(waves)))
    }

    /// Derivatives of two losses by the waves' powers alone, from those by the pixels.
    pub fn pull_powers(&self, waves: &[Wave<T>], by_pixel: [&[T]; 2]) -> Vec<[T; 2]> {
        self.at_waves(&by_pixel.map(|by_pixel| self.weighted(self.table_of_pixels(by_pixel))), waves)
    }

    /// Σ p·h(y)h(z)ᵀ of waves.
    pub(super) fn table_of_waves(&self, waves: &[Wave<T>]) -> Vec<T> {
        self.sum(waves.par_chunks(WAVES_PER_TASK).map(|chunk| self.products(chunk)).collect())
    }

    /// h(y)ᵀ T h(z) at every pixel.
    pub(super) fn at_pixels(&self, table: &[T]) -> Vec<T> {
        let stride = 2 * (self.columns + self.rows);
        let evaluate = |pixels: &[T]| pixels.chunks_exact(stride).map(|h| self.value(table, h)).collect::<Vec<T>>();
        let parts: Vec<Vec<T>> = self.pixels.par_chunks(stride * PIXELS_PER_TASK).map(evaluate).collect();
        parts.concat()
    }

    /// h(y)ᵀ T h(z) of two tables in the direction of every wave.
    pub(super) fn at_waves(&self, tables: &[Vec<T>; 2], waves: &[Wave<T>]) -> Vec<[T; 2]> {
        let chunk = |waves: &[Wave<T>]| waves.iter().map(|wave| self.at_wave(tables, wave)).collect::<Vec<_>>();
        waves.par_chunks(WAVES_PER_TASK).map(chunk).collect::<Vec<_>>().concat()
    }

    /// Σ d·h(y)h(z)ᵀ of pixels, each as much as a number says.
    pub(super) fn table_of_pixels(&self, by_pixel: &[T]) -> Vec<T> {
        let (of_y, of_z) = (2 * self.columns, 2 * self.rows);
        let stride = of_y + of_z;
        let gather = |(pixels, by_pixel): (&[T], &[T])| {
            let mut table = vec![T::ZERO; self.weights.len()];
            for (h, d) in pixels.chunks_exact(stride).zip(by_pixel) {
                let (y, z) = h.split_at(of_y);
                for (row, y) in table.chunks_exact_mut(of_z).zip(y) {
                    let factor = *y * *d;
                    row.iter_mut().zip(z).for_each(|(entry, z)| *entry += factor * *z);
                }
            }
            table
        };
        let pairs = self.pixels.par_chunks(stride * PIXELS_PER_TASK).zip(by_pixel.par_chunks(PIXELS_PER_TASK));
        self.sum(pairs.map(gather).collect())
    }

    fn sum(&self, partial: Vec<Vec<T>>) -> Vec<T> {
        let mut table = vec![T::ZERO; self.weights.len()];
        for sums in &partial {
            table.iter_mut().zip(sums).for_each(|(entry, sum)| *entry += *sum);
        }
        table
    }

    fn weighted(&self, mut table: Vec<T>) -> Vec<T> {
        table.iter_mut().zip(&self.weights).for_each(|(entry, weight)| *entry = *entry * *weight);
        table
    }

    /// Number of pixels.
    pub(super) fn pixel_count(&self) -> usize {
        self.pixels.len() / (2 * (self.columns + self.rows))
    }

    /// Numbers of antenna elements: columns (along y), then rows (along z).
    pub(super) fn elements(&self) -> [usize; 2] {
        [self.columns, self.rows]
    }

    fn at_wave(&self, [one, two]: &[Vec<T>; 2], wave: &Wave<T>) -> [T; 2] {
        let (of_y, of_z) = (2 * self.columns, 2 * self.rows);
        let (mut y, mut z) = ([T::ZERO; MOST], [T::ZERO; MOST]);
        harmonics(self.steps[0] * wave.direction[1], &mut y[..of_y]);
        harmonics(self.steps[1] * wave.direction[2], &mut z[..of_z]);
        let mut sums = [[T::ZERO; MOST]; 2];
        let [first, second] = &mut sums;
        let (first, second) = (&mut first[..of_z], &mut second[..of_z]);
        for ((row_one, row_two), y) in one.chunks_exact(of_z).zip(two.chunks_exact(of_z)).zip(&y) {
            for (((first, second), one), two) in first.iter_mut().zip(second.iter_mut()).zip(row_one).zip(row_two) {
                *first += *y * *one;
                *second += *y * *two;
            }
        }
        sums.map(|sums| sums.iter().zip(&z[..of_z]).fold(T::ZERO, |total, (sum, z)| total + *sum * *z))
    }

    /// Σ p·h(y)h(z)ᵀ.
    fn products(&self, waves: &[Wave<T>]) -> Vec<T> {
        let (of_y, of_z) = (2 * self.columns, 2 * self.rows);
        let mut table = vec![T::ZERO; of_y * of_z];
        let (mut y, mut z) = ([[T::ZERO; MOST]; 4], [[T::ZERO; MOST]; 4]);
        for few in waves.chunks(4) {
            for i in 0..4 {
                // What is missing at the end has no power.
                let (u, power) = few.get(i).map_or(([T::ZERO; 3], T::ZERO), |wave| (wave.direction, wave.power));
                harmonics(self.steps[0] * u[1], &mut y[i][..of_y]);
                harmonics(self.steps[1] * u[2], &mut z[i][..of_z]);
                z[i][..of_z].iter_mut().for_each(|z| *z = *z * power);
            }
            let [z0, z1, z2, z3] = z.each_ref().map(|z| &z[..of_z]);
            for (a, row) in table.chunks_exact_mut(of_z).enumerate() {
                let [p, q, r, s] = y.each_ref().map(|y| y[a]);
                for ((((entry, z0), z1), z2), z3) in row.iter_mut().zip(z0).zip(z1).zip(z2).zip(z3) {
                    *entry += (p * *z0 + q * *z1) + (r * *z2 + s * *z3);
                }
            }
        }
        table
    }

    /// h(y)ᵀ T h(z).
    fn value(&self, table: &[T], h: &[T]) -> T {
        let (y, z) = h.split_at(2 * self.columns);
        let mut sums = [T::ZERO; MOST];
        let sums = &mut sums[..z.len()];
        for (row, y) in table.chunks_exact(z.len()).zip(y) {
            sums.iter_mut().zip(row).for_each(|(sum, entry)| *sum += *y * *entry);
        }
        sums.iter().zip(z).fold(T::ZERO, |total, (sum, z)| total + *sum * *z)
    }
}

/// cos(l·x) for l = 0, 1, … in the first half, sin(l·x) in the second.
fn harmonics<T: Real>(x: T, into: &mut [T]) {
    let (sin, cos) = x.sin_cos();
    let (mut re, mut im) = (T::ONE, T::ZERO);
    let (cosines, sines) = into.split_at_mut(into.len() / 2);
    for (c, s) in cosines.iter_mut().zip(sines) {
        (*c, *s) = (re, im);
        (re, im) = (re * cos - im * sin, re * sin + im * cos);
    }
}
