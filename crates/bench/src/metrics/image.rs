//! PSNR and SSIM as the 3D Gaussian splatting literature reports them, on 8-bit images.

use corf::device::Planes;
use corf_scene::Raster;

/// PSNR assigned to equal images, dB: records are JSON, which has no infinity, and a mean needs a number. One 8-bit step in one value of a
/// 1600×900 image is 114 dB; differences that small are not what PSNR is read for.
pub const PSNR_OF_EQUAL_DB: f64 = 100.0;

/// Peak signal-to-noise ratio of two 8-bit images over all pixels and channels, dB, at most [`PSNR_OF_EQUAL_DB`].
pub fn psnr<const C: usize>(a: &Raster<[u8; C]>, b: &Raster<[u8; C]>) -> f64 {
    corf::loss::psnr_8bit(&unit(a), &unit(b)).min(PSNR_OF_EQUAL_DB)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_images_have_a_finite_psnr_and_an_ssim_of_one() {
        let image = Raster::from_fn(24, 16, |x, y| [(x * 9) as u8, (y * 15) as u8, 77]);
        assert_eq!(psnr(&image, &image), PSNR_OF_EQUAL_DB);
        assert!((ssim(&image, &image) - 1.0).abs() < 1e-9);
        let off_by_one = image.map(|p| p.map(|v| v ^ 1));
        assert!((psnr(&image, &off_by_one) - 20.0 * 255.0_f64.log10()).abs() < 1e-9);
    }
}
