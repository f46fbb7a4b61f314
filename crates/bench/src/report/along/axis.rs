//! The axis that figures along the way share: how far the platform has come at every held-out keyframe.

use glam::DVec3;
use std::ops::Range;

/// Share of the least distance between neighbours that a keyframe's mark is wide.
const MARK_SHARE: f64 = 0.84;
/// A mark is at most this share of the axis.
const WIDEST: f64 = 0.05;

/// Held-out keyframes on an axis.
pub(super) struct Axis {
    /// Its name, with the unit.
    pub name: &'static str,
    /// Place of every held-out keyframe, rising.
    pub stops: Vec<f64>,
    /// Number of every held-out keyframe, from 1.
    pub numbers: Vec<usize>,
    /// From where to where it goes.
    pub range: Range<f64>,
    /// Half of a mark's width.
    pub half_width: f64,
}

impl Axis {
    /// The axis of these keyframes (indices, rising) of a trajectory: metres travelled since its first keyframe, or the keyframe's number where the
    /// platform does not move between two of them.
    pub fn of(held_out: &[usize], positions: &[DVec3]) -> Self {
        let travelled = travelled(positions);
        let metres: Option<Vec<f64>> = held_out.iter().map(|index| travelled.get(*index).copied()).collect();
        let numbers: Vec<usize> = held_out.iter().map(|index| index + 1).collect();
        let total = travelled.last().copied().unwrap_or(0.0);
        let moves = |m: &Vec<f64>| m.windows(2).all(|pair| pair[1] - pair[0] > 1e-4 * total);
        let (name, stops) = match metres.filter(moves) {
            Some(metres) => ("distance travelled, m", metres),
            None => ("keyframe", numbers.iter().map(|n| *n as f64).collect()),
        };
        let (first, last) = (stops.first().copied().unwrap_or(0.0), stops.last().copied().unwrap_or(0.0));
        let gap = stops.windows(2).map(|pair| pair[1] - pair[0]).fold(f64::INFINITY, f64::min);
        let span = last - first;
        let half_width = if gap.is_finite() { 0.5 * (MARK_SHARE * gap).min(WIDEST * span.max(gap)) } else { 0.025 };
        let pad = (2.0 * half_width).max(0.02 * span).max(if gap.is_finite() { 0.0 } else { 0.5 });
        Self { name, range: first - pad..last + pad, stops, numbers, half_width }
    }

    /// Share of the axis that a mark is wide.
    pub fn mark_share(&self) -> f64 {
        2.0 * self.half_width / (self.range.end - self.range.start)
    }
}

/// Metres travelled since the first position, at every one.
fn travelled(positions: &[DVec3]) -> Vec<f64> {
    let mut sum = 0.0;
    let step = |(i, position): (usize, &DVec3)| {
        sum += if i == 0 { 0.0 } else { position.distance(positions[i - 1]) };
        sum
    };
    positions.iter().enumerate().map(step).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_are_the_way_and_not_the_distance_from_its_beginning() {
        // Round a square of 2 m, a keyframe at every corner and back at the first.
        let corners = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0), (0.0, 0.0)];
        let positions = corners.map(|(x, y)| DVec3::new(x, y, 1.6));
        let axis = Axis::of(&[0, 2, 4], &positions);
        assert_eq!(
            (axis.name, axis.stops.as_slice(), axis.numbers.as_slice()),
            ("distance travelled, m", &[0.0, 4.0, 8.0][..], &[1, 3, 5][..])
        );
        // Marks do not touch, and all of them are on the axis.
        assert!(2.0 * axis.half_width < 4.0 && axis.range.start < -axis.half_width && axis.range.end > 8.0 + axis.half_width);
        assert!(axis.mark_share() > 0.0 && axis.mark_share() < 0.1);
    }

    #[test]
    fn a_platform_that_stands_still_is_counted_by_keyframes() {
        let positions = [DVec3::ZERO; 9];
        let axis = Axis::of(&[0, 8], &positions);
        assert_eq!((axis.name, axis.stops.as_slice()), ("keyframe", &[1.0, 9.0][..]));
        // One keyframe still has an axis, and so has one that the trajectory does not know.
        for held_out in [[3], [30]] {
            let axis = Axis::of(&held_out, &positions);
            assert!(axis.range.end > axis.range.start && axis.half_width > 0.0);
        }
    }
}
