//! Image losses and the metrics built from the same definitions.
//!
//! SSIM everywhere is that of the splatting literature: 11×11 Gaussian window of σ = 1.5 px, per channel, zero padding, C₁ = 0.01²,
//! C₂ = 0.03², mean over pixels and channels.

pub(crate) mod fused;
mod metrics;

pub use metrics::{psnr_8bit, ssim};

/// Half width of the SSIM window.
pub(crate) const RADIUS: usize = 5;
/// exp(−i²/(2·1.5²)) / Σ at distance i = 0 … 5 from the middle.
pub(crate) const WINDOW: [f64; RADIUS + 1] = [
    0.266_011_724_861_794_3,
    0.213_005_537_711_253_66,
    0.109_360_689_509_7,
    0.036_000_772_128_430_82,
    0.007_598_758_135_239_184,
    0.001_028_380_084_479_111,
];
pub(crate) const C1: f64 = 0.01 * 0.01;
pub(crate) const C2: f64 = 0.03 * 0.03;
