//! Conventional beamforming: what an array measures when a beam is steered at every direction.

use super::hermitian::Hermitian;
use super::lags::LagForm;
use super::snapshots::Aperture;
use crate::radio::{Arrival, PlanarArray};
pub use corf_scene::config::RearHalfSpace;
use glam::{DMat3, DVec3};

/// A Bartlett spectrum of a planar array with weights w = v, v_m(u) = exp(j2π p_m·u).
#[derive(Clone, Debug)]
pub struct Bartlett {
    form: LagForm,
    elements2: f64,
}

impl Bartlett {
    /// The noncoherent spectrum P(u) = Σ_i |a_i|²·|v(u)ᴴv(u_i)|² / N²: the mean over the arrivals' phases.
    ///
    /// `world_from_array`: boresight +x, columns along +y, rows down −z.
    pub fn new(arrivals: &[Arrival], array: PlanarArray, world_from_array: DMat3, rear: RearHalfSpace) -> Self {
        Self::noncoherent(&Aperture { array, world_from_array, rear, elements: None }, arrivals)
    }

    pub(super) fn noncoherent(aperture: &Aperture, arrivals: &[Arrival]) -> Self {
        if aperture.elements.is_some() {
            let covariance = aperture.mean_covariance(arrivals);
            return Self::of(aperture, &covariance);
        }
        let waves: Vec<(DVec3, f64)> = arrivals.iter().filter_map(|a| Some((aperture.seen(a)?, a.power))).collect();
        Self { form: LagForm::of_waves(aperture.array, &waves), elements2: (aperture.array.elements() as f64).powi(2) }
    }

    /// P(u) = Σ_l |v(u)ᴴx_l|² / N²: coherent within a delay tap of 1/B, noncoherent over taps and over looks (pairs of antenna ports).
    pub(super) fn coherent(aperture: &Aperture, port_pairs: &[Vec<Arrival>], bandwidth_hz: f64, seed: u64) -> Self {
        Self::of(aperture, &aperture.covariance(port_pairs, bandwidth_hz, seed))
    }

    fn of(aperture: &Aperture, covariance: &Hermitian) -> Self {
        Self {
            form: LagForm::of_matrix(aperture.array, covariance.entries()),
            elements2: (aperture.array.elements() as f64).powi(2),
        }
    }

    /// Beam output towards a unit direction of the array frame, linear power: a lone arrival exactly there gives its |a|².
    pub fn power(&self, direction: DVec3) -> f64 {
        (self.form.value(direction) / self.elements2).max(0.0)
    }
}
