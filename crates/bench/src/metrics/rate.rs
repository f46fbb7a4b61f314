//! The link budget under which the power of a beam becomes a rate.

/// Transmit power, dBm; spectra are gains, relative to 1 W.
pub const TRANSMIT_POWER_DBM: f64 = 20.0;
/// Bandwidth over which the noise is counted, Hz.
pub const BANDWIDTH_HZ: f64 = 1e9;
/// Noise figure of the receiver, dB.
pub const NOISE_FIGURE_DB: f64 = 7.0;
/// Temperature of the noise at the receiver's input, kelvin (the standard noise temperature of IEEE).
pub const NOISE_TEMPERATURE_K: f64 = 290.0;
/// Rate below which a link is in outage, bit/s/Hz: over the bandwidth above 1 Gbit/s, reached at an SNR of 0 dB.
pub const TARGET_RATE_BPS_HZ: f64 = 1.0;
/// Boltzmann's constant, J/K (exact in SI).
const BOLTZMANN_J_PER_K: f64 = 1.380_649e-23;

/// The budget in words, for definitions: whoever reads a rate can redo it.
pub fn budget() -> String {
    budget_of(TRANSMIT_POWER_DBM)
}

/// The same with another transmit power, dBm.
pub fn budget_of(transmit_power_dbm: f64) -> String {
    format!(
        "{transmit_power_dbm} dBm sent, {} GHz of bandwidth, noise figure {NOISE_FIGURE_DB} dB at {NOISE_TEMPERATURE_K} K",
        BANDWIDTH_HZ / 1e9
    )
}

/// The target in words, for definitions.
pub fn target() -> String {
    format!("{TARGET_RATE_BPS_HZ} bit/s/Hz")
}

/// Power of the noise behind a beam of unit weight, watts: `k·T·B·F`.
pub fn noise_w() -> f64 {
    BOLTZMANN_J_PER_K * NOISE_TEMPERATURE_K * BANDWIDTH_HZ * 10f64.powf(NOISE_FIGURE_DB / 10.0)
}

/// Shannon's spectral efficiency behind a beam, bit/s/Hz: `log2(1 + N·P_t·G / (k·T·B·F))`.
///
/// `beam_gain` is a beam's power G relative to 1 W transmitted, as spectra have it: `Σ |a|²·|wᴴv|²/N²`, so that a lone path in the middle of
/// the beam has its own |a|². The N elements add signals in amplitude and noise in power, which is the factor N.
pub fn spectral_efficiency_bps_hz(beam_gain: f64, elements: usize) -> f64 {
    let transmitted_w = 10f64.powf((TRANSMIT_POWER_DBM - 30.0) / 10.0);
    (elements as f64 * transmitted_w * beam_gain / noise_w()).ln_1p() / std::f64::consts::LN_2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_noise_is_174_dbm_a_hertz_and_what_is_added_to_it() {
        // −173.98 dBm/Hz + 90 dB-Hz + 7 dB.
        assert!((10.0 * noise_w().log10() + 30.0 + 76.98).abs() < 0.01);
    }

    #[test]
    fn a_budget_by_hand() {
        // −86 dB of path gain: 20 − 86 + 18.06 (64 elements) + 76.98 = 29.04 dB of SNR, log2(1 + 801.9) = 9.65.
        assert!((spectral_efficiency_bps_hz(10f64.powf(-8.6), 64) - 9.65).abs() < 0.01);
        assert_eq!(spectral_efficiency_bps_hz(0.0, 64), 0.0);
        assert_eq!(budget(), "20 dBm sent, 1 GHz of bandwidth, noise figure 7 dB at 290 K");
    }
}
