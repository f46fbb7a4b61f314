//! A logarithmic axis of a chart, with a tick at each decade.

use plotters::coord::ranged1d::{KeyPointHint, NoDefaultFormatting, Ranged, ValueFormatter};
use std::ops::Range;

/// From one positive value to a greater one.
pub struct Decades(pub f64, pub f64);

/// Axes of fewer decades have ticks at twice and five times each as well.
const FEW: f64 = 2.0;

impl Ranged for Decades {
    type FormatOption = NoDefaultFormatting;
    type ValueType = f64;

    fn map(&self, value: &f64, limit: (i32, i32)) -> i32 {
        let share = (value.log10() - self.0.log10()) / (self.1.log10() - self.0.log10());
        limit.0 + (share * f64::from(limit.1 - limit.0)).round() as i32
    }

    fn key_points<Hint: KeyPointHint>(&self, _: Hint) -> Vec<f64> {
        let steps: &[f64] = if (self.1 / self.0).log10() < FEW { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let decades = self.0.log10().floor() as i32..=self.1.log10().floor() as i32;
        let ticks = decades.flat_map(|e| steps.iter().map(move |s| s * 10_f64.powi(e)));
        ticks.filter(|v| (self.0..=self.1).contains(v)).collect()
    }

    fn range(&self) -> Range<f64> {
        self.0..self.1
    }
}

impl ValueFormatter<f64> for Decades {
    fn format_ext(&self, value: &f64) -> String {
        // Powers of ten are not exact in floating point below 1.
        let rounded = format!("{value:.3e}").parse::<f64>().unwrap_or(*value);
        if rounded >= 1e6 { format!("{}M", rounded / 1e6) } else { format!("{rounded}") }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plotters::coord::ranged1d::BoldPoints;

    #[test]
    fn ticks_lie_on_the_axis_and_read_as_numbers() {
        let ticks = |low, high| {
            let axis = Decades(low, high);
            axis.key_points(BoldPoints(10)).iter().map(|v| axis.format_ext(v)).collect::<Vec<_>>()
        };
        assert_eq!(ticks(0.05, 30.0), ["0.1", "1", "10"]);
        assert_eq!(ticks(40_000.0, 4e6), ["100000", "1M"]);
        assert_eq!(ticks(0.3, 0.9), ["0.5"]);
        assert_eq!(Decades(1.0, 100.0).map(&10.0, (0, 50)), 25);
    }
}
