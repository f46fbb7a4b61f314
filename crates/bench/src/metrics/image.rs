//! PSNR and SSIM as the 3D Gaussian splatting literature reports them, on 8-bit images.

use corf::device::Planes;
use corf_scene::Raster;

/// PSNR assigned to equal images, dB: records are JSON, which has no infinity, and a mean needs a number. One 8-bit step in one value of a
/// 1600×900 image is 114 dB; differences that small are not what PSNR is read for.
pub const PSNR_OF_EQUAL_DB: f64 = 100.0;

/// Peak signal-to-noise ratio of two 8-bit images over channels and the pixels that count, all without a mask, dB, at most [`PSNR_OF_EQUAL_DB`].
/// Images with a mask agree where no pixel counts, as [`unmasked`] makes them.
pub fn psnr<const C: usize>(a: &Raster<[u8; C]>, b: &Raster<[u8; C]>, mask: Option<&Raster<bool>>) -> f64 {
    (corf::loss::psnr_8bit(&unit(a), &unit(b)) + 10.0 * mask.map_or(1.0, share).log10()).min(PSNR_OF_EQUAL_DB)
}

/// Structural similarity: 11×11 Gaussian window, σ = 1.5, zero padding, per channel, mean over channels and the pixels that count, all without a mask
/// (the 3DGS definition).
pub fn ssim<const C: usize>(a: &Raster<[u8; C]>, b: &Raster<[u8; C]>, mask: Option<&Raster<bool>>) -> f64 {
    corf::loss::ssim(&unit(a), &unit(b), mask)
}

/// A prediction where pixels count, and the observation elsewhere.
pub fn unmasked(predicted: &Raster<[u8; 3]>, observed: &Raster<[u8; 3]>, mask: &Raster<bool>) -> Raster<[u8; 3]> {
    let shown = |x, y| if mask[(x, y)] { predicted[(x, y)] } else { observed[(x, y)] };
    Raster::from_fn(predicted.width(), predicted.height(), shown)
}

/// Share of the pixels that count.
pub fn share(mask: &Raster<bool>) -> f64 {
    mask.pixels().iter().filter(|counts| **counts).count() as f64 / mask.pixels().len() as f64
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
        assert_eq!(psnr(&image, &image, None), PSNR_OF_EQUAL_DB);
        assert!((ssim(&image, &image, None) - 1.0).abs() < 1e-9);
        // Three quarters of the pixels are painted over and do not count; of what does, every value is off by one.
        let mask = Raster::from_fn(24, 16, |x, _| x < 6);
        let painted = Raster::from_fn(24, 16, |x, y| if mask[(x, y)] { image[(x, y)].map(|v| v ^ 1) } else { [0, 255, 9] });
        let shown = unmasked(&painted, &image, &mask);
        assert_eq!(share(&mask), 0.25);
        assert!((psnr(&shown, &image, Some(&mask)) - 20.0 * 255.0_f64.log10()).abs() < 1e-9);
        let ssim_there = ssim(&shown, &image, Some(&mask));
        assert!(ssim_there < ssim(&shown, &image, None) && ssim_there > 0.9, "{ssim_there}");
        assert_eq!(psnr(&image, &image, Some(&mask)), PSNR_OF_EQUAL_DB);
        let off_by_one = image.map(|p| p.map(|v| v ^ 1));
        assert!((psnr(&image, &off_by_one, None) - 20.0 * 255.0_f64.log10()).abs() < 1e-9);
    }
}
