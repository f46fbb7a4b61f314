//! Places of the receiver at which emitters are known: the basis over which every emitter's power depends on where it is seen from.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Places among which a receiver's weights are distributed.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Anchors {
    /// World frame, metres.
    pub positions_m: Vec<DVec3>,
    /// Standard deviation of the kernel around each, metres.
    pub width_m: f64,
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

    /// A field of a program that interpolated otherwise is another field: what is not known is refused, not left out.
    #[test]
    fn a_rule_of_interpolation_that_is_not_known_is_refused() {
        let text = r#"{"positions_m": [[1.0, 0.0, 0.0]], "width_m": 0.5"#;
        assert_eq!(serde_json::from_str::<Anchors>(&format!("{text}}}")).ok().map(|a| a.positions_m), Some(vec![DVec3::X]));
        let error = serde_json::from_str::<Anchors>(&format!(r#"{text}, "between": "powers"}}"#)).err().map(|e| e.to_string());
        assert!(error.is_some_and(|e| e.contains("between")));
    }
}
