//! SSIM and PSNR against values computed elsewhere, and truths that need none.

#![allow(clippy::unwrap_used)]

use corf::{
    device::Planes,
    loss::{psnr_8bit, ssim},
};
use corf_scene::{Rng, io::read_png};
#[path = "../../../tests/shared.rs"]
mod reference_data;
use reference_data::shared;

/// The reference values come from f32 convolutions.
const SSIM_TOLERANCE: f64 = 1e-5;
/// PSNR of 8-bit images is exact up to f64 rounding of a sum.
const PSNR_TOLERANCE_DB: f64 = 1e-6;

fn load(name: &str) -> Option<Planes> {
    let image = read_png(shared(&format!("goldens/{name}.png"))?).unwrap();
    let pixels = image.pixels().iter().flatten().map(|v| f32::from(*v) / 255.0).collect();
    Some(Planes { width: image.width(), height: image.height(), channels: 3, pixels })
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn published_definitions_give_the_same_numbers() {
    let Some(path) = shared("goldens/metrics.json") else { return };
    let goldens: serde_json::Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
    for (pair, expected) in goldens.as_object().unwrap() {
        let (a, b) = pair.split_once('|').unwrap();
        let (Some(a), Some(b)) = (load(a), load(b)) else { return };
        let (truth_ssim, truth_psnr) = (expected["ssim_3dgs_zero_pad"].as_f64().unwrap(), expected["psnr"].as_f64().unwrap());
        assert!(
            (ssim(&a, &b, None) - truth_ssim).abs() < SSIM_TOLERANCE,
            "{pair}: SSIM {} against {truth_ssim}",
            ssim(&a, &b, None)
        );
        assert!(
            (psnr_8bit(&a, &b) - truth_psnr).abs() < PSNR_TOLERANCE_DB,
            "{pair}: PSNR {} against {truth_psnr}",
            psnr_8bit(&a, &b)
        );
    }
}

#[test]
fn an_image_equals_itself_and_noise_lowers_both() {
    let mut rng = Rng::keyed(1, 0, 0);
    let a = Planes { width: 23, height: 9, channels: 1, pixels: (0..23 * 9).map(|_| rng.uniform()).collect() };
    assert!((ssim(&a, &a, None) - 1.0).abs() < 1e-12);
    assert_eq!(psnr_8bit(&a, &a), f64::INFINITY);
    let mut last = (1.0, f64::INFINITY);
    for size in [0.02, 0.1, 0.4] {
        let mut b = a.clone();
        b.pixels.iter_mut().for_each(|v| *v += (rng.uniform() - 0.5) * size);
        let now = (ssim(&a, &b, None), psnr_8bit(&a, &b));
        assert!(now.0 < last.0 && now.1 < last.1, "{now:?} after {last:?}");
        assert!((ssim(&b, &a, None) - now.0).abs() < 1e-12, "SSIM is symmetric");
        last = now;
    }
    // A shift of exactly 25.5/255 rounds to 25 or 26 steps of 1/255: 20 dB.
    let black = Planes { pixels: vec![0.0; 23 * 9], ..a.clone() };
    let grey = Planes { pixels: vec![0.1; 23 * 9], ..a };
    assert!((psnr_8bit(&black, &grey) - 20.0).abs() < 0.2);
}
