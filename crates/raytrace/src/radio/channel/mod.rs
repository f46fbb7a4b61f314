//! Channel of a link from its multipath: received power, spreads, responses over time and frequency, the matrix between two arrays.
//!
//! h(f) = Σ a_i e^{−j2πfτ_i}. Resolved paths bring their phase along. Diffuse power has none: every diffuse arrival is given one, drawn
//! from its place in the list, so that a realisation depends on the seed alone and its mean power is the noncoherent sum.

mod array;
mod response;
mod statistics;

pub use array::{ArrayLink, ChannelMatrix};
pub use response::{Subcarriers, TapFilter, frequency_response, impulse_response};
pub use statistics::{LinkStatistics, circular_spread_deg};

use super::Complex;
use corf_scene::Rng;

/// The stage of [`Rng::keyed`] from which the phases of diffuse arrivals are drawn.
const PHASE_STAGE: u64 = 0x7068_6173;

/// One term of the response around the carrier, H(Δf) = Σ g_i e^{−j2πΔfτ_i}.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ChannelRay {
    /// g = a·e^{−j2πf_cτ}: the coefficient with its phase at the carrier.
    pub gain: Complex,
    /// τ, seconds.
    pub delay_s: f64,
}

/// Uniform in [0, 2π), one for each `arrival` and each pair of antennas `link`.
fn random_phase_rad(seed: u64, arrival: u64, link: u64) -> f64 {
    std::f64::consts::TAU * Rng::keyed(seed, PHASE_STAGE ^ (link << 32), arrival).uniform_f64()
}
