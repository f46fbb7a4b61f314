//! SSIM and PSNR in f64, for results rather than for gradients.

use super::{C1, C2, RADIUS, WINDOW};
use crate::device::Planes;
use corf_scene::Raster;
use rayon::prelude::*;

/// Mean structural similarity of two images with values in `[0, 1]` (Wang et al. 2004, zero padding; see the module's head) over the pixels that
/// count, all without a mask; NaN where none counts. Windows take in the other pixels as well.
///
/// # Panics
/// If the images differ in width, height or channels, or the mask in width or height.
pub fn ssim(a: &Planes, b: &Planes, mask: Option<&Raster<bool>>) -> f64 {
    assert_same_size(a, b);
    let (w, h) = (a.width, a.height);
    assert!(mask.is_none_or(|mask| (mask.width(), mask.height()) == (w, h)), "a mask is of its image's size");
    let counts = |i: usize| mask.is_none_or(|mask| mask.pixels()[i]);
    let sums: Vec<f64> = (0..a.channels)
        .into_par_iter()
        .map(|channel| {
            let plane =
                |p: &Planes| -> Vec<f64> { p.pixels.iter().skip(channel).step_by(p.channels).map(|v| f64::from(*v)).collect() };
            let (x, y) = (plane(a), plane(b));
            let product = |p: &[f64], q: &[f64]| blur(&p.iter().zip(q).map(|(p, q)| p * q).collect::<Vec<_>>(), w, h);
            let (mean_x, mean_y) = (blur(&x, w, h), blur(&y, w, h));
            let (xx, yy, xy) = (product(&x, &x), product(&y, &y), product(&x, &y));
            (0..w * h)
                .filter(|i| counts(*i))
                .map(|i| {
                    let (mx, my) = (mean_x[i], mean_y[i]);
                    let structure = 2.0 * (xy[i] - mx * my) + C2;
                    let luminance = 2.0 * mx * my + C1;
                    luminance * structure / ((mx * mx + my * my + C1) * (xx[i] - mx * mx + yy[i] - my * my + C2))
                })
                .sum()
        })
        .collect();
    let counted = (0..w * h).filter(|i| counts(*i)).count();
    sums.iter().sum::<f64>() / (counted * a.channels) as f64
}

/// Peak signal-to-noise ratio in dB of two images with values in `[0, 1]`, both rounded to 8 bits first; infinite if they then agree.
///
/// # Panics
/// If the two differ in width, height or channels.
pub fn psnr_8bit(a: &Planes, b: &Planes) -> f64 {
    assert_same_size(a, b);
    let quantise = |v: f32| (f64::from(v.clamp(0.0, 1.0)) * 255.0).round() / 255.0;
    let sum: f64 = a.pixels.iter().zip(&b.pixels).map(|(a, b)| (quantise(*a) - quantise(*b)).powi(2)).sum();
    -10.0 * (sum / a.pixels.len() as f64).log10()
}

fn assert_same_size(a: &Planes, b: &Planes) {
    assert_eq!((a.width, a.height, a.channels), (b.width, b.height, b.channels), "images of one size are compared");
}

/// The window over a plane, zero beyond its border: first along rows, then along columns.
fn blur(plane: &[f64], width: usize, height: usize) -> Vec<f64> {
    let weight = |distance: usize| WINDOW[distance];
    let mut rows = vec![0.0; plane.len()];
    for (out, row) in rows.chunks_exact_mut(width).zip(plane.chunks_exact(width)) {
        for (x, out) in out.iter_mut().enumerate() {
            let (first, last) = (x.saturating_sub(RADIUS), (x + RADIUS).min(width - 1));
            *out = (first..=last).map(|i| weight(i.abs_diff(x)) * row[i]).sum();
        }
    }
    let mut out = vec![0.0; plane.len()];
    for y in 0..height {
        let out = &mut out[y * width..(y + 1) * width];
        for i in y.saturating_sub(RADIUS)..=(y + RADIUS).min(height - 1) {
            let k = weight(i.abs_diff(y));
            for (out, v) in out.iter_mut().zip(&rows[i * width..(i + 1) * width]) {
                *out += k * v;
            }
        }
    }
    out
}
