//! Coordinates so far from the origin that single precision, in which Gaussians and rays are, does not hold them.

use crate::finding::{Finding, Severity};
use glam::DVec3;

/// From here on, metres, single precision has steps of a millimetre: 2⁻¹⁰ m between 2¹³ and 2¹⁴ m, twice that up to 2¹⁵ m, and so on.
pub const FAR_M: f64 = 8192.0;

/// The step of single precision at a coordinate, millimetres.
pub fn step_mm(coordinate_m: f64) -> f64 {
    let at = coordinate_m.abs() as f32;
    1e3 * f64::from(at.next_up() - at)
}

/// The largest coordinate of some positions, metres.
pub fn largest_m(positions: impl Iterator<Item = DVec3>) -> f64 {
    positions.fold(0.0, |largest, p| p.abs().max_element().max(largest))
}

/// A warning where the largest coordinate is [`FAR_M`] or more; `what` is what stands there, `help` how it is brought nearer.
pub fn finding(place: &str, what: &str, largest_m: f64, help: &str) -> Option<Finding> {
    let step_mm = step_mm(largest_m);
    let text = format!(
        "{what} up to {largest_m:.0} m from the origin along an axis, where single precision has steps of {step_mm:.1} mm: positions are that coarse"
    );
    (largest_m >= FAR_M).then(|| Finding::new(Severity::Warning, place, text, help))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limit_is_where_steps_become_a_millimetre() {
        assert_eq!(step_mm(FAR_M), 1e3 * 2.0_f64.powi(-10));
        assert_eq!(step_mm(FAR_M - 1.0), 0.5e3 * 2.0_f64.powi(-10));
        let warned = |x: f64| {
            finding("d", "cameras stand", largest_m([DVec3::ONE, DVec3::new(0.0, -x, 1.0)].into_iter()), "move").is_some()
        };
        assert!(warned(8192.0) && warned(446_522.0) && !warned(8191.0) && !warned(0.0));
        let text = finding("d", "cameras stand", 446_522.0, "move them").unwrap().to_string();
        assert!(text.contains("446522 m") && text.contains("31.2 mm") && text.contains("move them"), "{text}");
    }
}
