//! One link in numbers: power, delay spread, angular spreads, K-factor.

use super::super::{Angles, Antenna, AntennaArray, Arrival, Path};
use super::ArrayLink;
use crate::spectrum::port_pairs;
use serde::Serialize;

/// One transmitter–receiver pair between one element each. Powers are of all their ports: transmit ports share the power and send
/// independent signals, what receive ports get adds ([`Path::received`]). What does not exist is `None`: everything where nothing arrives, the
/// K-factor without a line of sight.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct LinkStatistics {
    /// Whether an unobstructed ray arrives.
    pub line_of_sight: bool,
    /// Power arriving for the stated transmit power, noncoherent (its mean over small displacements), dBm.
    pub rssi_dbm: Option<f64>,
    /// 10·log10 Σ|a_i|², diffuse power among it: the noncoherent path gain, dB.
    pub path_gain_db: Option<f64>,
    /// 10·log10 |Σ a_i e^{−j2πf_cτ_i}|², over pairs of ports as powers are: the gain at the carrier at this very point, dB.
    pub path_gain_coherent_db: Option<f64>,
    /// Power-weighted mean delay from transmission, seconds.
    pub mean_delay_s: Option<f64>,
    /// Power-weighted standard deviation of the delay, seconds.
    pub delay_spread_s: Option<f64>,
    /// Azimuth spread of arrival, degrees (3GPP TR 38.901 Annex A: circular, world frame).
    pub azimuth_spread_of_arrival_deg: Option<f64>,
    /// Zenith spread of arrival, degrees (as above).
    pub zenith_spread_of_arrival_deg: Option<f64>,
    /// Azimuth spread of departure, degrees, of the paths; diffuse power does not know where it departed.
    pub azimuth_spread_of_departure_deg: Option<f64>,
    /// Zenith spread of departure, degrees (as above).
    pub zenith_spread_of_departure_deg: Option<f64>,
    /// Power of the unobstructed ray over that of everything else, dB.
    pub k_factor_db: Option<f64>,
    /// Share of the diffuse field in the power, [0, 1].
    pub diffuse_share: Option<f64>,
}

impl LinkStatistics {
    /// The statistics of `paths` between a transmit and a receive element, and of the `diffuse` arrivals beside them (all ports together);
    /// `seed` draws the phases of the latter for the coherent gain.
    pub fn of(
        paths: &[Path],
        diffuse: &[Arrival],
        [tx, rx]: [&Antenna; 2],
        frequency_hz: f64,
        tx_power_dbm: f64,
        seed: u64,
    ) -> Self {
        let mut port_pairs = port_pairs(paths, tx, rx, frequency_hz);
        let resolved: f64 = port_pairs.iter().flatten().map(|a| a.power).sum();
        port_pairs[0].extend_from_slice(diffuse);
        let [from, to] = [tx, rx].map(|element| AntennaArray::single(*element));
        let matrix = ArrayLink { paths, diffuse, tx: &from, rx: &to, seed }.matrix(frequency_hz);
        let coherent = matrix.norm_squared() / from.ports() as f64;
        let arrivals = port_pairs.concat();
        let total: f64 = arrivals.iter().map(|a| a.power).sum();
        let power = |path: &Path| path.received(tx, rx);
        let direct: f64 = paths.iter().filter(|p| p.interactions.is_empty()).map(power).sum();
        let any = |value: f64| (total > 0.0).then_some(value);
        let decibels = |ratio: f64| (ratio > 0.0 && ratio.is_finite()).then(|| 10.0 * ratio.log10());
        let mean_delay_s = arrivals.iter().map(|a| a.power * a.delay_s).sum::<f64>() / total;
        let variance = arrivals.iter().map(|a| a.power * (a.delay_s - mean_delay_s).powi(2)).sum::<f64>() / total;
        let arrival =
            |angle: fn(Angles) -> f64| circular_spread_deg(arrivals.iter().map(|a| (a.power, angle(Angles::of(a.direction)))));
        let departure = |angle: fn(Angles) -> f64| circular_spread_deg(paths.iter().map(|p| (power(p), angle(p.aod()))));
        Self {
            line_of_sight: direct > 0.0,
            rssi_dbm: decibels(total).map(|gain_db| tx_power_dbm + gain_db),
            path_gain_db: decibels(total),
            path_gain_coherent_db: decibels(coherent),
            mean_delay_s: any(mean_delay_s),
            delay_spread_s: any(variance.sqrt()),
            azimuth_spread_of_arrival_deg: arrival(|a| a.phi),
            zenith_spread_of_arrival_deg: arrival(|a| a.theta),
            azimuth_spread_of_departure_deg: departure(|a| a.phi),
            zenith_spread_of_departure_deg: departure(|a| a.theta),
            k_factor_db: decibels(direct / (total - direct).max(0.0)),
            diffuse_share: any(((total - resolved) / total).max(0.0)),
        }
    }
}

/// The circular angular spread √(−2 ln |Σ P e^{jφ} / ΣP|) of (power, angle in radians) pairs, degrees (3GPP TR 38.901 Annex A);
/// `None` without power. Infinite where the directions cancel, as two opposite ones of equal power do.
pub fn circular_spread_deg(angles: impl Iterator<Item = (f64, f64)>) -> Option<f64> {
    let (mut cos, mut sin, mut total) = (0.0, 0.0, 0.0);
    for (power, angle) in angles {
        cos += power * angle.cos();
        sin += power * angle.sin();
        total += power;
    }
    // Rounding may leave the resultant of one direction a hair above 1.
    (total > 0.0).then(|| (-2.0 * (cos.hypot(sin) / total).min(1.0).ln()).max(0.0).sqrt().to_degrees())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::radio::{Complex, SPEED_OF_LIGHT};
    use glam::DVec3;

    /// Rounding of logarithms and square roots of order-one numbers.
    const ROUNDING: f64 = 1e-9;

    fn arrival(direction: DVec3, power: f64, delay_s: f64) -> Arrival {
        Arrival { direction, power, delay_s, object: 0, phase_rad: Some(0.0) }
    }

    fn between_isotropic(paths: &[Path], diffuse: &[Arrival], tx_power_dbm: f64, seed: u64) -> LinkStatistics {
        let antenna = Antenna::default();
        LinkStatistics::of(paths, diffuse, [&antenna; 2], 60e9, tx_power_dbm, seed)
    }

    fn line_of_sight(length_m: f64, a: f64) -> Path {
        Path {
            interactions: Vec::new(),
            length_m,
            delay_s: length_m / SPEED_OF_LIGHT,
            a: Complex::real(a),
            transfer: [[Complex::real(a), Complex::ZERO], [Complex::ZERO, Complex::real(a)]],
            arrival: -DVec3::X,
            departure: DVec3::X,
        }
    }

    #[test]
    fn free_space_is_friis_in_dbm() {
        // Pr = Pt − 20·log10(4πd/λ).
        let wavelength_m = SPEED_OF_LIGHT / 60e9;
        let path = line_of_sight(10.0, wavelength_m / (4.0 * std::f64::consts::PI * 10.0));
        let s = between_isotropic(&[path], &[], 20.0, 0);
        let expected = 20.0 - 20.0 * (4.0 * std::f64::consts::PI * 10.0 / wavelength_m).log10();
        assert!((s.rssi_dbm.unwrap() - expected).abs() < ROUNDING);
        assert!((s.path_gain_coherent_db.unwrap() - s.path_gain_db.unwrap()).abs() < ROUNDING);
        assert!((s.mean_delay_s.unwrap() - 10.0 / SPEED_OF_LIGHT).abs() < 1e-20);
        assert_eq!((s.delay_spread_s, s.k_factor_db, s.line_of_sight), (Some(0.0), None, true));
        assert_eq!(s.azimuth_spread_of_arrival_deg, Some(0.0));
    }

    #[test]
    fn a_ray_and_an_echo_have_the_spread_and_k_factor_of_textbooks() {
        // Powers 1 and r, Δτ apart: σ_τ = Δτ·√r/(1+r); K = 1/r.
        let (delay, r) = (40e-9, 0.25);
        let direct = line_of_sight(3.0, 1.0);
        let echo = arrival(DVec3::Y, r, direct.delay_s + delay);
        let s = between_isotropic(std::slice::from_ref(&direct), &[echo], 30.0, 0);
        assert!((s.delay_spread_s.unwrap() / (delay * r.sqrt() / (1.0 + r)) - 1.0).abs() < ROUNDING);
        assert!((s.k_factor_db.unwrap() - 10.0 * 4f64.log10()).abs() < ROUNDING);
        assert!((s.mean_delay_s.unwrap() - direct.delay_s - delay * r / (1.0 + r)).abs() < 1e-18);
        assert!((s.diffuse_share.unwrap() - 0.2).abs() < ROUNDING);
    }

    #[test]
    fn two_equal_directions_spread_by_the_circular_law() {
        // |Σ| = cos(Δ/2): AS = √(−2 ln cos(Δ/2)), about Δ/2 for small Δ; the same across the ±180° cut.
        for (centre, half_deg) in [(0.3f64, 5.0f64), (std::f64::consts::PI, 5.0), (-1.0, 40.0)] {
            let half = half_deg.to_radians();
            let spread = circular_spread_deg([(2.0, centre - half), (2.0, centre + half)].into_iter()).unwrap();
            assert!((spread - (-2.0 * half.cos().ln()).sqrt().to_degrees()).abs() < 1e-6, "{centre} {spread}");
        }
        assert!((circular_spread_deg([(1.0, 0.0), (1.0, 0.02)].into_iter()).unwrap() - 0.01f64.to_degrees()).abs() < 1e-4);
        assert_eq!(circular_spread_deg(std::iter::empty()), None);
    }

    #[test]
    fn nothing_arriving_has_no_numbers() {
        let s = between_isotropic(&[], &[], 30.0, 0);
        assert_eq!((s.rssi_dbm, s.path_gain_db, s.mean_delay_s, s.k_factor_db, s.line_of_sight), (None, None, None, None, false));
    }

    #[test]
    fn the_coherent_gain_of_diffuse_power_is_its_sum_on_average() {
        let diffuse: Vec<Arrival> =
            (0..50).map(|i| Arrival { phase_rad: None, ..arrival(DVec3::X, 1.0 + f64::from(i), 0.0) }).collect();
        let total: f64 = diffuse.iter().map(|a| a.power).sum();
        let n = 4000;
        let mean = (0..n)
            .map(|seed| 10f64.powf(between_isotropic(&[], &diffuse, 0.0, seed).path_gain_coherent_db.unwrap() / 10.0))
            .sum::<f64>()
            / n as f64;
        // |h|² of many random phases is exponential: standard error 1/√n = 1.6 %; five of them.
        assert!((mean / total - 1.0).abs() < 0.08, "{}", mean / total);
    }
}
