//! Antennas so near to each other that the far-field law of the tracer says nothing about them.
//!
//! A path of length L has the gain (λ/4πL)² of isotropic antennas, which grows without bound as L falls and passes 0 dB at λ/4π. Under
//! λ/2π the reactive field prevails, where no gain between two antennas exists on its own: that is refused. Under 2λ the law is off by
//! tenths of a decibel and more: that is a warning. What counts is the distance between the antennas' own positions (of arrays, of the two
//! nearest elements): no path between two points is shorter than their distance, and a mirror however near to an antenna acts by its image,
//! as far away as the whole path is long.

use crate::finding::{Finding, Severity};
use crate::{Error, Result};

/// Speed of light in vacuum, m/s.
pub const SPEED_OF_LIGHT: f64 = 299_792_458.0;

/// The distance under which two antennas have no gain, metres: λ/2π.
pub fn refused_under_m(frequency_hz: f64) -> f64 {
    SPEED_OF_LIGHT / frequency_hz / std::f64::consts::TAU
}

/// The distance under which a gain is doubtful, metres: 2λ.
pub fn doubtful_under_m(frequency_hz: f64) -> f64 {
    2.0 * SPEED_OF_LIGHT / frequency_hz
}

/// A length in words.
fn length(metres: f64) -> String {
    match metres {
        m if m >= 1.0 => format!("{m:.2} m"),
        m if m >= 1e-3 => format!("{:.2} mm", 1e3 * m),
        m => format!("{:.3} µm", 1e6 * m),
    }
}

/// Refuses two antennas nearer than λ/2π; `place` says whose distance it is.
///
/// # Errors
/// The distance and the limit.
pub fn check(place: &str, distance_m: f64, frequency_hz: f64) -> Result<()> {
    let limit_m = refused_under_m(frequency_hz);
    if distance_m >= limit_m {
        return Ok(());
    }
    let what = if distance_m < 1e-9 {
        "it coincides with the transmitter".to_owned()
    } else {
        format!("it is {} from the transmitter", length(distance_m))
    };
    let help = format!(
        "move them apart: nearer than {} (a wavelength over 2 pi) there is no gain between two antennas, and 2 wavelengths are {}",
        length(limit_m),
        length(doubtful_under_m(frequency_hz))
    );
    Err(Error::invalid(place, what, help))
}

/// An error under λ/2π, a warning under 2λ.
pub fn finding(place: &str, distance_m: f64, frequency_hz: f64) -> Option<Finding> {
    if let Err(error) = check(place, distance_m, frequency_hz) {
        return Some(error.into());
    }
    (distance_m < doubtful_under_m(frequency_hz)).then(|| doubtful(place, &[distance_m], frequency_hz))
}

/// One warning of all the distances under 2λ; the least is named. There is one at least.
pub fn doubtful(place: &str, distances_m: &[f64], frequency_hz: f64) -> Finding {
    let least = distances_m.iter().copied().fold(f64::INFINITY, f64::min);
    let of_how_many = if distances_m.len() > 1 { format!(", the nearest of {}", distances_m.len()) } else { String::new() };
    let what = format!("it is {} from the transmitter{of_how_many}, less than 2 wavelengths", length(least));
    let help = format!("the far-field law is inexact there: keep {} between antennas", length(doubtful_under_m(frequency_hz)));
    Finding::new(Severity::Warning, place, what, help)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_refused_doubtful_or_fine() {
        // λ = 4.997 mm: λ/2π = 0.795 mm, 2λ = 9.99 mm.
        let severity = |metres: f64| finding("receiver", metres, 60e9).map(|f| f.severity);
        assert_eq!(severity(0.0), Some(Severity::Error));
        assert_eq!(severity(1e-6), Some(Severity::Error));
        assert_eq!(severity(0.794e-3), Some(Severity::Error));
        assert_eq!(severity(0.796e-3), Some(Severity::Warning));
        assert_eq!(severity(9.9e-3), Some(Severity::Warning));
        assert_eq!(severity(0.01), None);
        // At the limit a gain is under that of no distance: 20·log10(λ/(4π·λ/2π)) = −6 dB.
        let gain_db = 20.0 * (SPEED_OF_LIGHT / 60e9 / (2.0 * std::f64::consts::TAU * refused_under_m(60e9))).log10();
        assert!((gain_db + 20.0 * 2f64.log10()).abs() < 1e-12);
        let text = finding("receiver", 1e-6, 60e9).map(|f| f.to_string()).unwrap_or_default();
        assert!(text.contains("1.000 µm") && text.contains("795.2") && text.contains("9.99 mm"), "{text}");
    }
}
