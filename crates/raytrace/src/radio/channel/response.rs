//! Responses over frequency and over delay taps.

use super::super::Complex;
use super::ChannelRay;
use corf_scene::{Error, Result};
use rayon::prelude::*;
use std::f64::consts::{PI, TAU};
use std::ops::Range;

/// Equally spaced frequencies around the carrier: Δf_k = (k − ⌊n/2⌋)·spacing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Subcarriers {
    /// Their number n.
    pub count: usize,
    /// Distance of one from the next, Hz.
    pub spacing_hz: f64,
}

impl Subcarriers {
    /// `count` subcarriers that fill a band.
    ///
    /// # Errors
    /// No subcarrier, or a bandwidth that is not positive.
    pub fn of_band(bandwidth_hz: f64, count: usize) -> Result<Self> {
        if count == 0 {
            return Err(Error::invalid("subcarriers", "there are 0", "give at least 1"));
        }
        if !(bandwidth_hz.is_finite() && bandwidth_hz > 0.0) {
            return Err(Error::invalid(
                "bandwidth",
                format!("{bandwidth_hz} Hz"),
                "give a bandwidth above 0 in hertz, e.g. 400e6",
            ));
        }
        Ok(Self { count, spacing_hz: bandwidth_hz / count as f64 })
    }

    /// Offsets from the carrier, Hz, ascending.
    pub fn offsets_hz(&self) -> Vec<f64> {
        (0..self.count).map(|k| (k as f64 - (self.count / 2) as f64) * self.spacing_hz).collect()
    }
}

/// Filter that distributes a path of any delay to taps 1/W apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TapFilter {
    /// Ideal band limitation: h_l = Σ g_i sinc(l − Wτ_i).
    Sinc,
    /// Each path into the nearest tap.
    Bin,
}

/// H(Δf) = Σ g_i e^{−j2πΔfτ_i} at each offset from the carrier, Hz.
pub fn frequency_response(rays: &[ChannelRay], offsets_hz: &[f64]) -> Vec<Complex> {
    let at = |offset_hz: &f64| {
        rays.iter().fold(Complex::ZERO, |sum, ray| sum + ray.gain * Complex::new(0.0, -TAU * (offset_hz * ray.delay_s)).exp())
    };
    offsets_hz.par_iter().map(at).collect()
}

/// The baseband response of a channel `bandwidth_hz` wide; tap `l` lies at delay l/W, 0 being the moment of transmission.
pub fn impulse_response(rays: &[ChannelRay], bandwidth_hz: f64, taps: Range<i64>, filter: TapFilter) -> Vec<Complex> {
    let weight = |tap: i64, delay_taps: f64| match filter {
        TapFilter::Sinc => sinc(tap as f64 - delay_taps),
        TapFilter::Bin => f64::from(u8::from(delay_taps.round() as i64 == tap)),
    };
    let at = |tap: i64| rays.iter().fold(Complex::ZERO, |sum, ray| sum + ray.gain * weight(tap, ray.delay_s * bandwidth_hz));
    taps.into_par_iter().map(at).collect()
}

/// sin(πx)/(πx).
fn sinc(x: f64) -> f64 {
    if x == 0.0 { 1.0 } else { (PI * x).sin() / (PI * x) }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rounding of sums of a few hundred terms of order one.
    const ROUNDING: f64 = 1e-12;

    fn some_rays() -> Vec<ChannelRay> {
        let mut rng = corf_scene::Rng::keyed(4, 0, 0);
        (0..12)
            .map(|_| ChannelRay { gain: Complex::new(rng.normal(), rng.normal()), delay_s: 20e-9 + 80e-9 * rng.uniform_f64() })
            .collect()
    }

    #[test]
    fn two_equal_rays_beat_with_the_inverse_of_their_delay_difference() {
        // |1 + e^{−j2πΔfτ}| = 2|cos(πΔfτ)|: zeros every 1/τ.
        let rays = [ChannelRay { gain: Complex::ONE, delay_s: 0.0 }, ChannelRay { gain: Complex::ONE, delay_s: 10e-9 }];
        let offsets: Vec<f64> = (-50..=50).map(|k| 3e6 * f64::from(k)).collect();
        for (h, f) in frequency_response(&rays, &offsets).iter().zip(&offsets) {
            assert!((h.norm() - 2.0 * (PI * f * 10e-9).cos().abs()).abs() < ROUNDING, "{f}");
        }
        assert!(frequency_response(&rays, &[50e6])[0].norm() < ROUNDING);
    }

    #[test]
    fn taps_carry_the_mean_power_over_the_band() {
        // Parseval: Σ_l |h_l|² = (1/W) ∫_{−W/2}^{W/2} |H|² dΔf. The integrand has a spectrum limited to the delays' differences, so
        // that a midpoint rule finer than 1/(2·100 ns) converges like the rectangle rule of a smooth function over a finite interval.
        let (rays, w) = (some_rays(), 400e6);
        let n = 200_000;
        let offsets: Vec<f64> = (0..n).map(|k| ((f64::from(k) + 0.5) / f64::from(n) - 0.5) * w).collect();
        let band: f64 = frequency_response(&rays, &offsets).iter().map(|h| h.norm_squared()).sum::<f64>() / f64::from(n);
        let taps = impulse_response(&rays, w, -20_000..20_040, TapFilter::Sinc);
        let time: f64 = taps.iter().map(|h| h.norm_squared()).sum();
        // The sinc's tails beyond L taps hold 2/(π²L) of a path's power at most: 1e-5 at 20 000.
        assert!((time / band - 1.0).abs() < 1e-4, "{time} {band}");
    }

    #[test]
    fn the_response_is_the_transform_of_the_taps() {
        // H(Δf) = Σ_l h_l e^{−j2πΔf l/W} inside the band for delays on the grid, where the sinc is a unit impulse.
        let w = 1e9;
        let rays: Vec<ChannelRay> =
            some_rays().iter().enumerate().map(|(i, r)| ChannelRay { delay_s: (5 * i + 3) as f64 / w, ..*r }).collect();
        let taps = impulse_response(&rays, w, 0..80, TapFilter::Sinc);
        let binned = impulse_response(&rays, w, 0..80, TapFilter::Bin);
        let offsets = Subcarriers::of_band(w, 64).unwrap().offsets_hz();
        assert_eq!((offsets[0], offsets[32]), (-w / 2.0, 0.0));
        for (h, f) in frequency_response(&rays, &offsets).iter().zip(&offsets) {
            let transform = |taps: &[Complex]| {
                taps.iter().enumerate().fold(Complex::ZERO, |s, (l, t)| s + *t * Complex::new(0.0, -TAU * f * l as f64 / w).exp())
            };
            assert!((transform(&taps) - *h).norm() < 1e-9, "{f}");
            assert!((transform(&binned) - *h).norm() < 1e-9, "{f}");
        }
    }

    #[test]
    fn bins_lose_no_path() {
        let rays = some_rays();
        let sum = |list: Vec<Complex>| list.into_iter().fold(Complex::ZERO, |s, h| s + h);
        let taps = sum(impulse_response(&rays, 400e6, 0..60, TapFilter::Bin));
        let all = sum(rays.iter().map(|r| r.gain).collect());
        assert!((taps - all).norm() < ROUNDING);
    }

    #[test]
    fn an_empty_band_is_refused() {
        assert!(Subcarriers::of_band(0.0, 64).is_err());
        assert!(Subcarriers::of_band(1e8, 0).unwrap_err().to_string().contains("subcarriers"));
    }
}
