//! Sampling probability from the Laplacian of Gaussian (paper Eqs. (13)–(15)).

use crate::device::Planes;
use corf_scene::{Raster, Rng};
use rayon::prelude::*;

/// Radius of the disc over which the response is averaged, pixels.
const DISC_RADIUS: isize = 3;

/// `P(u) = min(‖∇²(G_σ ∗ I)(u)‖, 1)` (Eq. (13); on a rendered image, Eq. (14)): smoothed, Laplacian, norm over the channels, averaged
/// over a disc of radius 3 pixels, clamped to `[0, 1]`. Beyond the border the image continues with its edge pixels.
pub fn probability(image: &Planes, sigma_px: f32) -> Raster<f32> {
    let (w, h) = (image.width, image.height);
    if w == 0 || h == 0 {
        return Raster::from_vec(w, h, Vec::new());
    }
    let smooth = smoothed(image, sigma_px);
    let norm: Vec<f32> = (0..w * h)
        .into_par_iter()
        .map(|i| {
            let (x, y) = (i % w, i / w);
            let at = |x: usize, y: usize, c: usize| smooth[(y * w + x) * image.channels + c];
            let (left, right) = (x.saturating_sub(1), (x + 1).min(w - 1));
            let (up, down) = (y.saturating_sub(1), (y + 1).min(h - 1));
            let squared =
                |c: usize| (at(left, y, c) + at(right, y, c) + at(x, up, c) + at(x, down, c) - 4.0 * at(x, y, c)).powi(2);
            (0..image.channels).map(squared).sum::<f32>().sqrt()
        })
        .collect();
    let pixels = (0..w * h).into_par_iter().map(|i| disc_mean(&norm, w, h, i % w, i / w).min(1.0)).collect();
    Raster::from_vec(w, h, pixels)
}

/// `P̄ = max(P − P̃, 0)` (Eq. (15)) of a pixel.
pub fn final_probability(image: f32, penalty: f32) -> f32 {
    (image - penalty).max(0.0)
}

/// The pixels where a Gaussian is to be spawned: accepted where `rand < acceptance(u)`, in row-major order.
///
/// The draw of a pixel depends on (seed, stage, pixel) alone, so the result does not depend on threads.
pub fn draw(acceptance: &Raster<f32>, seed: u64, stage: u64) -> Vec<(usize, usize)> {
    let w = acceptance.width();
    acceptance
        .pixels()
        .par_iter()
        .enumerate()
        .filter(|&(i, &p)| accepted(i, p, seed, stage))
        .map(|(i, _)| (i % w, i / w))
        .collect()
}

/// Whether pixel `i` (row-major) is drawn with probability `p`.
pub fn accepted(i: usize, p: f32, seed: u64, stage: u64) -> bool {
    p > 0.0 && Rng::keyed(seed, stage, i as u64).uniform() < p
}

/// `G_σ ∗ I`, truncated at 3 σ; interleaved channels.
fn smoothed(image: &Planes, sigma_px: f32) -> Vec<f32> {
    let radius = (3.0 * sigma_px).ceil() as isize;
    let weights: Vec<f32> = (-radius..=radius).map(|k| (-0.5 * (k as f32 / sigma_px).powi(2)).exp()).collect();
    let total: f32 = weights.iter().sum();
    let weights: Vec<f32> = weights.iter().map(|v| v / total).collect();
    let (w, h, channels) = (image.width, image.height, image.channels);
    let clamp = |v: isize, n: usize| v.clamp(0, n as isize - 1) as usize;
    let mut rows = vec![0.0f32; image.pixels.len()];
    rows.par_chunks_mut(w * channels).enumerate().for_each(|(y, row)| {
        let source = &image.pixels[y * w * channels..(y + 1) * w * channels];
        for (x, out) in row.chunks_exact_mut(channels).enumerate() {
            for (k, weight) in weights.iter().enumerate() {
                let xs = clamp(x as isize + k as isize - radius, w) * channels;
                out.iter_mut().zip(&source[xs..xs + channels]).for_each(|(o, s)| *o += weight * s);
            }
        }
    });
    let mut out = vec![0.0f32; image.pixels.len()];
    out.par_chunks_mut(w * channels).enumerate().for_each(|(y, row)| {
        for (k, weight) in weights.iter().enumerate() {
            let ys = clamp(y as isize + k as isize - radius, h) * w * channels;
            row.iter_mut().zip(&rows[ys..ys + w * channels]).for_each(|(o, s)| *o += weight * s);
        }
    });
    out
}

/// Mean over the part of the disc around `(x, y)` that lies inside the image.
fn disc_mean(values: &[f32], w: usize, h: usize, x: usize, y: usize) -> f32 {
    let (mut sum, mut count) = (0.0, 0u32);
    for dy in -DISC_RADIUS..=DISC_RADIUS {
        let half = ((DISC_RADIUS * DISC_RADIUS - dy * dy) as f32).sqrt() as isize;
        let yy = y as isize + dy;
        if yy < 0 || yy >= h as isize {
            continue;
        }
        let (from, to) = ((x as isize - half).max(0) as usize, (x as isize + half).min(w as isize - 1) as usize);
        let row = &values[yy as usize * w + from..=yy as usize * w + to];
        sum += row.iter().sum::<f32>();
        count += row.len() as u32;
    }
    sum / count as f32
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

    #[test]
    fn an_image_that_is_rendered_already_draws_nothing_and_missing_detail_draws_in_proportion() {
        let texture = planes(64, 64, |x, y| [((x * 7 + y * 13) % 5) as f32 * 0.2; 3]);
        let p = probability(&texture, 0.7);
        let wanted = |penalty: &Raster<f32>| {
            let pixels = p.pixels().iter().zip(penalty.pixels()).map(|(&p, &q)| final_probability(p, q)).collect();
            Raster::from_vec(p.width(), p.height(), pixels)
        };
        let same = wanted(&p);
        assert!(draw(&same.map(|v| 2.0 * v), 1, 2).is_empty());
        let blank = probability(&planes(64, 64, |_, _| [0.5; 3]), 0.7);
        let acceptance = wanted(&blank).map(|v| (0.5 * v).min(1.0));
        let expected: f32 = acceptance.pixels().iter().sum();
        let drawn = draw(&acceptance, 1, 2).len() as f32;
        // Five standard deviations of a sum of independent draws, at most sqrt(Σp).
        assert!((drawn - expected).abs() < 5.0 * expected.sqrt(), "{drawn} {expected}");
        assert_ne!(draw(&acceptance, 1, 2), draw(&acceptance, 2, 2));
    }

    #[test]
    fn draws_do_not_depend_on_the_number_of_threads() {
        let acceptance = Raster::from_fn(80, 60, |x, y| ((x + y) % 10) as f32 * 0.05);
        let with = |n| rayon::ThreadPoolBuilder::new().num_threads(n).build().unwrap().install(|| draw(&acceptance, 9, 4));
        assert_eq!(with(1), with(3));
    }
}
