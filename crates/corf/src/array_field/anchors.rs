//! Places of the receiver at which emitters are known: the basis over which every emitter's power depends on where it is seen from.

use crate::Real;
use glam::DVec3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What is interpolated between the anchors of an emitter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Between {
    /// The logarithm of its power: between a place that sees it and one that does not it is as good as gone.
    #[default]
    Logs,
    /// Its power: between them it is a few decibels fainter than where it is seen.
    Powers,
}

impl Between {
    fn is_logs(&self) -> bool {
        *self == Self::Logs
    }

    /// The correction of a log gain of corrections at anchors by their weights, which sum to 1; 0 without any.
    pub fn mean<T: Real>(self, corrections: impl Iterator<Item = (T, T)> + Clone) -> T {
        match self {
            Self::Logs => corrections.fold(T::ZERO, |sum, (weight, correction)| sum + weight * correction),
            Self::Powers => {
                let Some(most) = corrections.clone().map(|c| c.1).reduce(|most, c| if c > most { c } else { most }) else {
                    return T::ZERO;
                };
                most + corrections.fold(T::ZERO, |sum, (weight, correction)| sum + weight * (correction - most).exp()).ln()
            }
        }
    }
}

/// Places among which a receiver's weights are distributed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Anchors {
    /// World frame, metres.
    pub positions_m: Vec<DVec3>,
    /// Standard deviation of the kernel around each, metres.
    pub width_m: f64,
    /// What is interpolated between them.
    #[serde(default, skip_serializing_if = "Between::is_logs")]
    pub between: Between,
}

/// Weights below this share of the largest are none.
const LEAST: f64 = 1e-3;

impl Anchors {
    /// Weights at a receiver, which sum to 1, by ascending number of the anchor: normalised Gaussian kernels. Far from all of them the nearest
    /// takes it all; without any there are none.
    pub fn weights(&self, receiver_m: DVec3) -> Vec<(usize, f64)> {
        let squared = |a: &DVec3| a.distance_squared(receiver_m);
        let nearest = self.positions_m.iter().map(squared).fold(f64::INFINITY, f64::min);
        let kernel = |a: &DVec3| (-0.5 * (squared(a) - nearest) / (self.width_m * self.width_m)).exp();
        let near = self.positions_m.iter().map(kernel).enumerate().filter(|w| w.1 >= LEAST);
        let mut weights: Vec<(usize, f64)> = near.collect();
        let total: f64 = weights.iter().map(|w| w.1).sum();
        weights.iter_mut().for_each(|w| w.1 /= total);
        weights
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_a_place_that_sees_an_emitter_and_one_that_does_not_its_power_is_half_or_nothing() {
        let halfway = || [(0.5, 1.0), (0.5, -11.0)].into_iter();
        assert!((Between::Logs.mean::<f64>(halfway()) - -5.0).abs() < 1e-12);
        assert!((Between::Powers.mean::<f64>(halfway()) - (1.0 - 2.0_f64.ln())).abs() < 1e-4);
        for between in [Between::Logs, Between::Powers] {
            assert_eq!(between.mean::<f64>(std::iter::empty()), 0.0);
            assert!(
                (between.mean::<f32>([(0.3, -7.0), (0.7, -7.0)].into_iter()) + 7.0).abs() < 1e-6,
                "where all agree nothing is to choose"
            );
        }
        // A file of before has no such key, and is read as it was meant.
        let anchors = Anchors { positions_m: vec![DVec3::X], width_m: 0.5, between: Between::Logs };
        let text = serde_json::to_string(&anchors).unwrap();
        assert!(!text.contains("between") && serde_json::from_str::<Anchors>(&text).unwrap() == anchors, "{text}");
    }
}
