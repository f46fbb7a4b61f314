//! Axes: where a value stands between its ends, and which values have ticks.

use anyhow::{Result, ensure};

/// Linear axes longer than this have no ticks to be read.
const LARGEST_SPAN: f64 = 1e15;
/// Linear axes shorter than this share of their values have none either: their numbers are all the same.
const SMALLEST_SHARE: f64 = 1e-9;
/// Logarithmic axes of fewer decades have ticks at twice and five times each as well.
const FEW_DECADES: f64 = 2.0;

/// How far apart equal steps of a value stand.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Kind {
    Linear,
    /// Linear, of angles in degrees: ticks divide a circle.
    Degrees,
    Logarithmic,
    /// As the tangents of angles in degrees: what a pinhole camera sees.
    Tangent,
}

/// An axis from one value to a greater one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    low: f64,
    high: f64,
    kind: Kind,
    /// Whether the greater value stands at its beginning.
    falling: bool,
}

/// The least and the greatest of some values; of none, infinity and its negative.
pub fn extent(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| (low.min(v), high.max(v)))
}

impl Scale {
    /// A linear axis.
    ///
    /// # Errors
    /// Ends between which no ticks can be read: not finite, in the wrong order, too far apart, or the same but for rounding.
    pub fn linear(low: f64, high: f64) -> Result<Self> {
        let span = high - low;
        ensure!(
            span.is_finite() && span > SMALLEST_SHARE * low.abs().max(high.abs()) && span < LARGEST_SPAN,
            "values from {low:.3e} to {high:.3e} cannot be drawn"
        );
        Ok(Self { low, high, kind: Kind::Linear, falling: false })
    }

    /// A logarithmic axis.
    ///
    /// # Errors
    /// Ends that are not positive or not finite, or in the wrong order.
    pub fn logarithmic(low: f64, high: f64) -> Result<Self> {
        ensure!(
            low.is_normal() && low > 0.0 && high.is_finite() && high > low,
            "values from {low:.3e} to {high:.3e} cannot be drawn on a logarithmic axis"
        );
        Ok(Self { low, high, kind: Kind::Logarithmic, falling: false })
    }

    /// A linear axis of angles in degrees.
    ///
    /// # Errors
    /// Those of [`Self::linear`].
    pub fn degrees(low_deg: f64, high_deg: f64) -> Result<Self> {
        Ok(Self { kind: Kind::Degrees, ..Self::linear(low_deg, high_deg)? })
    }

    /// An axis of angles in degrees on a plane before a pinhole: they stand as their tangents.
    ///
    /// # Errors
    /// Those of [`Self::linear`]; angles of 90° and more, which no plane shows.
    pub fn tangent(low_deg: f64, high_deg: f64) -> Result<Self> {
        ensure!(low_deg > -90.0 && high_deg < 90.0, "angles from {low_deg:.1}° to {high_deg:.1}° cannot be drawn on a plane");
        Ok(Self { kind: Kind::Tangent, ..Self::linear(low_deg, high_deg)? })
    }

    /// The least and the greatest value.
    pub fn ends(&self) -> [f64; 2] {
        [self.low, self.high]
    }

    /// The same axis with the greater value at its beginning.
    pub fn falling(self) -> Self {
        Self { falling: !self.falling, ..self }
    }

    /// Where a value stands: 0 at the beginning, 1 at the end. What lies beyond an end stands at it.
    pub fn share(&self, value: f64) -> f64 {
        let value = value.clamp(self.low, self.high);
        let share = match self.kind {
            Kind::Linear | Kind::Degrees => (value - self.low) / (self.high - self.low),
            Kind::Logarithmic => (value / self.low).log10() / (self.high / self.low).log10(),
            Kind::Tangent => {
                let [value, low, high] = [value, self.low, self.high].map(|angle| angle.to_radians().tan());
                (value - low) / (high - low)
            }
        };
        if self.falling { 1.0 - share } else { share }
    }

    /// Values with ticks, rising, and their texts; about `most` of them.
    pub fn ticks(&self, most: usize) -> Vec<(f64, String)> {
        let most = most.max(2);
        if self.kind != Kind::Logarithmic {
            let least = (self.high - self.low) / most as f64;
            let step = if self.kind == Kind::Linear { round_step(least) } else { degree_step(least) };
            // An end that is a tick stays one in spite of rounding.
            let numbers = (self.low / step - 1e-6).ceil() as i64..=(self.high / step + 1e-6).floor() as i64;
            return numbers.map(|i| i as f64 * step).map(|v| (v, self.text(v, step))).collect();
        }
        let decades = (self.high / self.low).log10();
        let steps: &[f64] = if decades < FEW_DECADES { &[1.0, 2.0, 5.0] } else { &[1.0] };
        let stride = (decades / most as f64).ceil().max(1.0) as usize;
        let first = self.low.log10().floor() as i32;
        let exponents = (first..=self.high.log10().floor() as i32).filter(|e| e.rem_euclid(stride as i32) == 0);
        let ticks = exponents.flat_map(|e| steps.iter().map(move |s| s * 10_f64.powi(e)));
        ticks.filter(|v| (self.low..=self.high).contains(v)).map(|v| (v, self.text(v, v))).collect()
    }

    /// A tick's number, with as many digits as it takes to tell it from the next one, `step` away.
    fn text(&self, value: f64, step: f64) -> String {
        if value == 0.0 {
            return "0".to_owned();
        }
        // A linear axis has one unit; on a logarithmic one every tick has its own.
        let largest = if self.kind == Kind::Logarithmic { value } else { self.low.abs().max(self.high.abs()) };
        let (unit, suffix) = match largest {
            ..1e-4 | 1e9.. => return format!("{:e}", format!("{value:.6e}").parse().unwrap_or(value)),
            1e6.. => (1e6, "M"),
            _ => (1.0, ""),
        };
        let digits = (-(step / unit).log10() - 1e-6).ceil().max(0.0) as usize;
        format!("{:.digits$}{suffix}", value / unit)
    }
}

/// The least step that is not below a positive number of degrees, and by which angles are read.
fn degree_step(least_deg: f64) -> f64 {
    const STEPS: [f64; 8] = [5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0, 90.0];
    let step = || STEPS.into_iter().find(|step| *step >= 0.999_999 * least_deg);
    if least_deg > 2.0 { step().unwrap_or(180.0) } else { round_step(least_deg) }
}

/// The least of 1, 2 and 5 times a power of ten that is not below a positive number.
fn round_step(least: f64) -> f64 {
    let decade = 10_f64.powf(least.log10().floor());
    [1.0, 2.0, 5.0, 10.0].map(|s| s * decade).into_iter().find(|step| *step >= 0.999_999 * least).unwrap_or(10.0 * decade)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn texts(scale: Result<Scale>, most: usize) -> Vec<String> {
        scale.unwrap().ticks(most).into_iter().map(|(_, text)| text).collect()
    }

    #[test]
    fn ticks_lie_on_the_axis_and_read_as_numbers() {
        assert_eq!(texts(Scale::logarithmic(0.05, 30.0), 10), ["0.1", "1", "10"]);
        assert_eq!(texts(Scale::logarithmic(40_000.0, 4e6), 10), ["100000", "1M"]);
        assert_eq!(texts(Scale::logarithmic(0.3, 0.9), 10), ["0.5"]);
        assert_eq!(texts(Scale::logarithmic(1e-6, 2e9), 8), ["1e-6", "0.0001", "0.01", "1", "100", "10000", "1M", "100M"]);
        assert_eq!(Scale::logarithmic(1.0, 100.0).unwrap().share(10.0), 0.5);
        assert_eq!(texts(Scale::linear(-0.3, 0.3), 6), ["-0.3", "-0.2", "-0.1", "0", "0.1", "0.2", "0.3"]);
        assert_eq!(texts(Scale::linear(11.2, 28.0), 9), ["12", "14", "16", "18", "20", "22", "24", "26", "28"]);
        assert_eq!(texts(Scale::linear(0.0, 1_234_567.0), 5), ["0", "0.5M", "1.0M"]);
        assert_eq!(texts(Scale::linear(0.0, 2e12), 2), ["0", "1e12", "2e12"]);
        assert_eq!(texts(Scale::linear(0.0, 0.03), 3), ["0", "0.01", "0.02", "0.03"]);
    }

    #[test]
    fn there_are_at_most_a_few_more_ticks_than_asked_for_and_two_at_least() {
        for (low, high) in [(0.0, 1.0), (19.9, 20.1), (-1e9, 1e9), (1e6, 1e6 + 1.0), (3.0, 3.7), (0.0, 9.999e14)] {
            for most in [2, 5, 10] {
                let count = texts(Scale::linear(low, high), most).len();
                assert!((1..=most + 1).contains(&count), "{low} {high}: {count} of {most}");
            }
        }
    }

    #[test]
    fn angles_stand_as_a_pinhole_sees_them_and_an_axis_may_fall() {
        let scale = Scale::tangent(-45.0, 45.0).unwrap();
        assert!((scale.share(0.0) - 0.5).abs() < 1e-12);
        // tan 26.565° = ½: half-way from the middle to the end.
        assert!((scale.share(0.5_f64.atan().to_degrees()) - 0.75).abs() < 1e-12);
        assert!((scale.falling().share(0.5_f64.atan().to_degrees()) - 0.25).abs() < 1e-12);
        assert_eq!(texts(Scale::tangent(-45.0, 45.0), 5), ["-40", "-20", "0", "20", "40"]);
        assert_eq!(texts(Scale::tangent(-46.0, 46.0), 7), ["-45", "-30", "-15", "0", "15", "30", "45"]);
        assert_eq!(texts(Scale::degrees(-180.0, 180.0), 4), ["-180", "-90", "0", "90", "180"]);
        assert_eq!(texts(Scale::degrees(-0.3, 0.3), 3), ["-0.2", "0", "0.2"]);
        assert!(Scale::tangent(-90.0, 45.0).is_err() && Scale::tangent(0.0, 120.0).is_err());
        assert_eq!(Scale::linear(0.0, 4.0).unwrap().falling().share(1.0), 0.75);
    }

    #[test]
    fn ends_that_hold_no_axis_are_refused() {
        for (low, high) in
            [(0.0, f64::INFINITY), (f64::NAN, 1.0), (1.0, 1.0), (2.0, 1.0), (1e300, 1.000_000_000_1e300), (-1e15, 1e15)]
        {
            assert!(Scale::linear(low, high).unwrap_err().to_string().contains("cannot be drawn"), "{low} {high}");
        }
        for (low, high) in [(0.0, 1.0), (-1.0, 1.0), (1.0, f64::INFINITY), (f64::NAN, 1.0), (2.0, 1.0)] {
            assert!(Scale::logarithmic(low, high).is_err(), "{low} {high}");
        }
    }
}
