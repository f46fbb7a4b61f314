//! The minimum variance (Capon) spectrum: resolves what a conventional beam cannot.

use super::hermitian::Hermitian;
use super::lags::LagForm;
use crate::radio::PlanarArray;
use glam::DVec3;

/// P(u) = 1 / (v(u)ᴴ R⁻¹ v(u)) with R = Σ_l x_l x_lᴴ + ε·tr(R)/N·I over the delay taps.
#[derive(Clone, Debug)]
pub(super) struct Mvdr {
    /// The quadratic form vᴴ R⁻¹ v, summed by lags; `None` where nothing arrives.
    form: Option<LagForm>,
}

impl Mvdr {
    /// The spectrum of a covariance without its loading; `loading` is ε, the diagonal loading in units of the mean eigenvalue.
    pub fn new(array: PlanarArray, mut covariance: Hermitian, loading: f64) -> Self {
        covariance.load(loading * covariance.trace() / array.elements() as f64);
        Self { form: covariance.inverse().map(|inverse| LagForm::of_matrix(array, inverse.entries())) }
    }

    /// Linear power: a lone arrival of power p exactly there gives p·(1 + ε/N).
    pub fn power(&self, direction: DVec3) -> f64 {
        self.form.as_ref().map_or(0.0, |form| 1.0 / form.value(direction))
    }
}
