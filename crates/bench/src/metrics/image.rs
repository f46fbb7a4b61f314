//! PSNR and SSIM as the 3D Gaussian splatting literature reports them, on 8-bit images.

use corf::device::Planes;
use corf_scene::Raster;

/// Peak signal-to-noise ratio of two 8-bit images over all pixels and channels, dB; infinite for equal images.
pub fn psnr<const C: usize>(a: &Raster<[u8; C]>, b: &Raster<[u8; C]>) -> f64 {
    let squared: f64 = a
        .pixels()
        .iter()
        .zip(b.pixels())
        .flat_map(|(p, q)| (0..C).map(move |c| (f64::from(p[c]) - f64::from(q[c])).powi(2)))
        .sum();
    let mse = squared / (a.pixels().len() * C) as f64;
    10.0 * (255.0_f64 * 255.0 / mse).log10()
}

/// Structural similarity: 11×11 Gaussian window, σ = 1.5, zero padding, per channel, mean over channels and pixels (the 3DGS definition).
pub fn ssim<const C: usize>(a: &Raster<[u8; C]>, b: &Raster<[u8; C]>) -> f64 {
    corf::loss::ssim(&unit(a), &unit(b))
}

/// 8-bit values as `[0, 1]`.
fn unit<const C: usize>(image: &Raster<[u8; C]>) -> Planes {
    let pixels = image.pixels().iter().flatten().map(|&v| f32::from(v) / 255.0).collect();
    Planes { width: image.width(), height: image.height(), channels: C, pixels }
}
