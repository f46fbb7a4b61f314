//! Sampling probability from the Laplacian of Gaussian (paper Eqs. (13)–(15)).

use crate::{
    images::Planes,
    simd::{Isa, Kernel, Lanes},
};
use corf_scene::{Raster, Rng};
use rayon::prelude::*;

/// Radius of the disc over which the response is averaged, pixels: 1, 5, 5, 7, 5, 5 and 1 of them in its rows.
const DISC_RADIUS: usize = 3;
/// Half widths of the disc's rows.
const DISC: [usize; 2 * DISC_RADIUS + 1] = [0, 2, 2, 3, 2, 2, 0];
/// Rows worked on together: what they need of the image fits into a core's cache.
const STRIP: usize = 32;

/// `P(u) = min(‖∇²(G_σ ∗ I)(u)‖, 1)` (Eq. (13); on a rendered image, Eq. (14)): smoothed, Laplacian, norm over the channels, averaged
/// over a disc of radius 3 pixels, clamped to `[0, 1]`. Beyond the border the image continues with its edge pixels.
pub fn probability(image: &Planes, sigma_px: f32) -> Raster<f32> {
    let (w, h) = (image.width, image.height);
    if w == 0 || h == 0 {
        return Raster::from_vec(w, h, Vec::new());
    }
    let (weights, isa) = (kernel(sigma_px), Isa::detect());
    let mut pixels = vec![0.0; w * h];
    pixels.par_chunks_mut(STRIP * w).enumerate().for_each(|(k, out)| {
        isa.dispatch(Strip { image, weights: &weights, first: k * STRIP, out });
    });
    Raster::from_vec(w, h, pixels)
}

/// The weights of `G_σ` along an axis, truncated at 3 σ.
pub(crate) fn kernel(sigma_px: f32) -> Vec<f32> {
    let radius = (3.0 * sigma_px).ceil() as isize;
    let weights: Vec<f32> = (-radius..=radius).map(|k| (-0.5 * (k as f32 / sigma_px).powi(2)).exp()).collect();
    let total: f32 = weights.iter().sum();
    weights.iter().map(|v| v / total).collect()
}

/// `out = Σ_k weights[k]·row(k)`, added up in this order; rows are as long as `out`.
#[inline(always)]
fn weighted_sum<'r, L: Lanes>(out: &mut [f32], weights: &[f32], row: impl Fn(usize) -> &'r [f32]) {
    /// Lanes whose sums stay in registers.
    const AT_ONCE: usize = 4;
    let block = AT_ONCE * L::WIDTH;
    let whole = out.len() / block * block;
    for at in (0..whole).step_by(block) {
        let mut sums = [L::splat(0.0); AT_ONCE];
        for (k, weight) in weights.iter().enumerate() {
            let (weight, values) = (L::splat(*weight), &row(k)[at..at + block]);
            for (j, sum) in sums.iter_mut().enumerate() {
                *sum = *sum + weight * L::load(&values[j * L::WIDTH..]);
            }
        }
        for (j, sum) in sums.into_iter().enumerate() {
            sum.store(&mut out[at + j * L::WIDTH..]);
        }
    }
    for (i, sum) in out.iter_mut().enumerate().skip(whole) {
        *sum = weights.iter().enumerate().fold(0.0, |sum, (k, weight)| sum + weight * row(k)[i]);
    }
}

/// Some rows of the probability.
struct Strip<'a> {
    image: &'a Planes,
    weights: &'a [f32],
    first: usize,
    out: &'a mut [f32],
}

impl Kernel for Strip<'_> {
    type Output = ();

    // For the most part plain loops over slices, which the compiler widens to the instruction set.
    #[inline(always)]
    fn run<L: Lanes>(self) {
        let (w, h, n) = (self.image.width, self.image.height, self.image.channels);
        let (first, rows) = (self.first, self.out.len() / w);
        // Rows of the Laplacian that the discs reach, and of the smooth image that it reaches.
        let norms = first.saturating_sub(DISC_RADIUS)..(first + rows + DISC_RADIUS).min(h);
        let smooth = norms.start.saturating_sub(1)..(norms.end + 1).min(h);
        let (stride, side) = (w * n, n * (self.weights.len() / 2));
        let mut padded = vec![0.0f32; stride + 2 * side];
        // One pixel more on both sides.
        let mut smoothed = vec![0.0f32; smooth.len() * (stride + 2 * n)];
        for (y, out) in smooth.clone().zip(smoothed.chunks_exact_mut(stride + 2 * n)) {
            let row = |k: usize| {
                let from = (y + k).saturating_sub(self.weights.len() / 2).min(h - 1) * stride;
                &self.image.pixels[from..from + stride]
            };
            weighted_sum::<L>(&mut padded[side..side + stride], self.weights, row);
            for i in 0..side {
                padded[i] = padded[side + i % n];
                padded[side + stride + i] = padded[stride + side - n + i % n];
            }
            weighted_sum::<L>(&mut out[n..n + stride], self.weights, |k| &padded[k * n..k * n + stride]);
            for c in 0..n {
                out[c] = out[n + c];
                out[stride + n + c] = out[stride + c];
            }
        }
        // Norms between zeros, as many as a disc reaches.
        let width = w + 2 * DISC_RADIUS;
        let mut norm = vec![0.0f32; norms.len() * width];
        let mut squares = vec![0.0f32; stride];
        for (y, out) in norms.clone().zip(norm.chunks_exact_mut(width)) {
            let row = |y: usize| &smoothed[(y - smooth.start) * (stride + 2 * n)..][..stride + 2 * n];
            let (above, here, below) = (row(y.saturating_sub(1).max(smooth.start)), row(y), row((y + 1).min(h - 1)));
            for (i, square) in squares.iter_mut().enumerate() {
                let laplacian = here[i] + here[i + 2 * n] + above[i + n] + below[i + n] - 4.0 * here[i + n];
                *square = laplacian * laplacian;
            }
            for (value, squares) in out[DISC_RADIUS..DISC_RADIUS + w].iter_mut().zip(squares.chunks_exact(n)) {
                *value = squares.iter().sum::<f32>().sqrt();
            }
        }
        let zeros = vec![0.0f32; width];
        let mut column = vec![0.0f32; width];
        for (k, out) in self.out.chunks_exact_mut(w).enumerate() {
            let y = first + k;
            let row = |dy: usize| match (y + dy).checked_sub(DISC_RADIUS).filter(|y| norms.contains(y)) {
                Some(y) => &norm[(y - norms.start) * width..][..width],
                None => &zeros[..],
            };
            let rows: [&[f32]; 2 * DISC_RADIUS + 1] = std::array::from_fn(row);
            for i in 0..width {
                column[i] = (rows[1][i] + rows[2][i]) + (rows[4][i] + rows[5][i]) + rows[3][i];
            }
            for x in 0..w {
                let wide = (column[x + 1] + column[x + 2]) + (column[x + 4] + column[x + 5]) + column[x + 3];
                out[x] = wide + (rows[3][x] + rows[3][x + 6]) + (rows[0][x + 3] + rows[6][x + 3]);
            }
            let inside = |at: usize, reach: usize, end: usize| at.min(reach) + (end - 1 - at).min(reach) + 1;
            let counted = |dy: usize| y + dy >= DISC_RADIUS && y + dy < h + DISC_RADIUS;
            let count =
                |x: usize| (0..DISC.len()).filter(|dy| counted(*dy)).map(|dy| inside(x, DISC[dy], w)).sum::<usize>() as f32;
            let edge = DISC_RADIUS.min(w);
            for x in (0..edge).chain(edge.max(w.saturating_sub(edge))..w) {
                out[x] = (out[x] / count(x)).min(1.0);
            }
            if w > 2 * edge {
                let most = count(edge);
                for value in &mut out[edge..w - edge] {
                    *value = (*value / most).min(1.0);
                }
            }
        }
    }
}

/// `P̄ = max(P − P̃, 0)` (Eq. (15)) of a pixel.
pub fn final_probability(image: f32, penalty: f32) -> f32 {
    (image - penalty).max(0.0)
}

/// The pixels where a Gaussian is to be spawned: accepted where `rand < acceptance(u)`, in row-major order.
///
/// The draw of a pixel depends on (seed, stage, pixel) alone, so the result does not depend on threads.
pub fn draw(image: &Raster<f32>, acceptance: impl Fn(f32) -> f32 + Sync, seed: u64, stage: u64) -> Vec<(usize, usize)> {
    let w = image.width();
    let rows = image.pixels().par_chunks(w.max(1)).enumerate();
    let drawn = |(y, row): (usize, &[f32])| -> Vec<(usize, usize)> {
        let accepted = |(x, p): (usize, &f32)| accepted(y * w + x, acceptance(*p), seed, stage).then_some((x, y));
        row.iter().enumerate().filter_map(accepted).collect()
    };
    rows.map(drawn).collect::<Vec<_>>().concat()
}

/// Whether pixel `i` (row-major) is drawn with probability `p`.
pub fn accepted(i: usize, p: f32, seed: u64, stage: u64) -> bool {
    p > 0.0 && Rng::keyed(seed, stage, i as u64).uniform() < p
}

#[cfg(test)]
mod tests {
    use super::*;

    fn planes(w: usize, h: usize, f: impl Fn(usize, usize) -> [f32; 3]) -> Planes {
        let pixels = (0..w * h).flat_map(|i| f(i % w, i / w)).collect();
        Planes { width: w, height: h, channels: 3, pixels }
    }

    #[test]
    fn constant_and_linear_images_have_no_response() {
        // A Laplacian annihilates an affine image; only the border, where the image is continued flat, may respond.
        let p = probability(&planes(40, 30, |x, y| [0.3, 0.01 * x as f32, 0.02 * y as f32]), 1.0);
        for y in 8..22 {
            for x in 8..32 {
                assert!(p[(x, y)] < 1e-5, "{}", p[(x, y)]);
            }
        }
    }

    #[test]
    fn the_response_of_a_smooth_wave_is_its_analytic_laplacian() {
        // I = A sin(kx): ∇²(G_σ ∗ I) = −A (2 − 2cos k) e^{−k²σ²/2} sin(kx) with the five-point stencil.
        let (amplitude, k, sigma) = (0.2f32, 0.35f32, 1.2f32);
        let p = probability(&planes(96, 40, |x, _| [amplitude * (k * x as f32).sin(), 0.0, 0.0]), sigma);
        let gain = amplitude * (2.0 - 2.0 * k.cos()) * (-0.5 * (k * sigma).powi(2)).exp();
        for x in 20..76 {
            let (mut sum, mut n) = (0.0, 0);
            for dy in -3i32..=3 {
                for dx in -3i32..=3 {
                    if dx * dx + dy * dy <= 9 {
                        sum += (gain * (k * (x as i32 + dx) as f32).sin()).abs();
                        n += 1;
                    }
                }
            }
            let expected = sum / n as f32;
            // The truncated kernel keeps 99.7 % of its weight and is renormalised: below 1 % here.
            assert!((p[(x, 20)] - expected).abs() < 0.01 * gain, "{} {expected}", p[(x, 20)]);
        }
    }

    /// The definition, pixel by pixel, in f64.
    fn by_definition(image: &Planes, sigma: f64) -> Vec<f64> {
        let (w, h) = (image.width as isize, image.height as isize);
        let held = |x: isize, y: isize| (x.clamp(0, w - 1), y.clamp(0, h - 1));
        let r = (3.0 * sigma).ceil() as isize;
        let weight = |k: isize| (-0.5 * (k as f64 / sigma).powi(2)).exp();
        let total: f64 = (-r..=r).map(weight).sum();
        let at = |x: isize, y: isize, c: usize| f64::from(image.pixels[(y * w + x) as usize * image.channels + c]);
        let around = move |x: isize, y: isize| {
            (-r..=r).flat_map(move |dy| (-r..=r).map(move |dx| (held(x + dx, y + dy), weight(dx) * weight(dy) / (total * total))))
        };
        let smooth: Vec<Vec<f64>> = (0..image.channels)
            .map(|c| (0..w * h).map(|i| around(i % w, i / w).map(|((x, y), weight)| weight * at(x, y, c)).sum()).collect())
            .collect();
        let laplacian = |plane: &[f64], x: isize, y: isize| {
            let v = |x, y| {
                plane[{
                    let (x, y) = held(x, y);
                    (y * w + x) as usize
                }]
            };
            v(x - 1, y) + v(x + 1, y) + v(x, y - 1) + v(x, y + 1) - 4.0 * v(x, y)
        };
        let norm = |x, y| smooth.iter().map(|p| laplacian(p, x, y).powi(2)).sum::<f64>().sqrt();
        let disc = |x: isize, y: isize| {
            let inside = (-3..=3).flat_map(|dy| (-3..=3).map(move |dx| (dx, dy))).filter(|(dx, dy)| dx * dx + dy * dy <= 9);
            let reached = inside.map(|(dx, dy)| (x + dx, y + dy)).filter(|p| *p == held(p.0, p.1));
            let values: Vec<f64> = reached.map(|(x, y)| norm(x, y)).collect();
            (values.iter().sum::<f64>() / values.len() as f64).min(1.0)
        };
        (0..w * h).map(|i| disc(i % w, i / w)).collect()
    }

    #[test]
    fn the_response_is_its_definition_up_to_the_border_of_any_image() {
        let mut rng = Rng::keyed(2, 0, 0);
        for (w, h) in [(1, 1), (2, 5), (5, 2), (6, 7), (41, 67)] {
            let image = Planes { width: w, height: h, channels: 3, pixels: (0..w * h * 3).map(|_| rng.uniform()).collect() };
            let p = probability(&image, 1.1);
            for (found, truth) in p.pixels().iter().zip(by_definition(&image, 1.1)) {
                // f32 sums of a few dozen terms of order 1.
                assert!((f64::from(*found) - truth).abs() < 3e-6, "{w}x{h}: {found} {truth}");
            }
        }
    }

    #[test]
    fn an_image_that_is_rendered_already_draws_nothing_and_missing_detail_draws_in_proportion() {
        let texture = planes(64, 64, |x, y| [((x * 7 + y * 13) % 5) as f32 * 0.2; 3]);
        let p = probability(&texture, 0.7);
        let wanted = |penalty: &Raster<f32>| {
            let pixels = p.pixels().iter().zip(penalty.pixels()).map(|(&p, &q)| final_probability(p, q)).collect();
            Raster::from_vec(p.width(), p.height(), pixels)
        };
        let same = wanted(&p);
        assert!(draw(&same, |v| 2.0 * v, 1, 2).is_empty());
        let blank = probability(&planes(64, 64, |_, _| [0.5; 3]), 0.7);
        let acceptance = wanted(&blank).map(|v| (0.5 * v).min(1.0));
        let expected: f32 = acceptance.pixels().iter().sum();
        let drawn = draw(&acceptance, |p| p, 1, 2).len() as f32;
        // Five standard deviations of a sum of independent draws, at most sqrt(Σp).
        assert!((drawn - expected).abs() < 5.0 * expected.sqrt(), "{drawn} {expected}");
        assert_ne!(draw(&acceptance, |p| p, 1, 2), draw(&acceptance, |p| p, 2, 2));
    }

    #[test]
    fn draws_do_not_depend_on_the_number_of_threads() {
        let acceptance = Raster::from_fn(80, 60, |x, y| ((x + y) % 10) as f32 * 0.05);
        let with = |n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap().install(|| draw(&acceptance, |p| p, 9, 4));
        assert_eq!(with(1), with(3));
    }
}
