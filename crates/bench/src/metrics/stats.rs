//! Means and confidence intervals over seeds, and quantiles.

use serde::Serialize;

/// Fewer values than this have no interval: of two, Student's t (12.7) makes one that is wider than whatever is measured.
const FEWEST_FOR_INTERVAL: usize = 3;

/// A mean over seeds with its 95 % confidence interval.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Number of values.
    pub n: usize,
    /// Their mean.
    pub mean: f64,
    /// Half width of the two-sided 95 % interval (Student's t); `None` for fewer than three values.
    pub half_width_95: Option<f64>,
}

/// Summarises values; `None` without any.
pub fn summarize(values: &[f64]) -> Option<Summary> {
    let n = values.len();
    if n == 0 {
        return None;
    }
    let mean = values.iter().sum::<f64>() / n as f64;
    let half_width_95 = (n >= FEWEST_FOR_INTERVAL).then(|| {
        let variance = values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / (n - 1) as f64;
        t_quantile_975(n - 1) * (variance / n as f64).sqrt()
    });
    Some(Summary { n, mean, half_width_95 })
}

impl Summary {
    /// Whether it is of two values: a mean that no interval can be given for, and that a reader might take for one with an interval.
    pub fn is_of_two(&self) -> bool {
        self.n == 2
    }

    /// Whether the interval lies on one side of zero; never without an interval.
    pub fn excludes_zero(&self) -> bool {
        self.half_width_95.is_some_and(|h| self.mean.abs() > h)
    }
}

/// The 97.5 % quantile of Student's t with `dof` degrees of freedom: exact to 3 digits up to 30, then by Cornish and Fisher's expansion.
fn t_quantile_975(dof: usize) -> f64 {
    const TABLE: [f64; 30] = [
        12.706, 4.303, 3.182, 2.776, 2.571, 2.447, 2.365, 2.306, 2.262, 2.228, 2.201, 2.179, 2.160, 2.145, 2.131, 2.120, 2.110,
        2.101, 2.093, 2.086, 2.080, 2.074, 2.069, 2.064, 2.060, 2.056, 2.052, 2.048, 2.045, 2.042,
    ];
    if let Some(&t) = TABLE.get(dof.wrapping_sub(1)) {
        return t;
    }
    let (z, v) = (1.959_964_f64, dof as f64);
    z + (z.powi(3) + z) / (4.0 * v) + (5.0 * z.powi(5) + 16.0 * z.powi(3) + 3.0 * z) / (96.0 * v * v)
}

/// A quantile of sorted values by linear interpolation; 0 without any.
pub fn quantile(sorted: &[f64], q: f64) -> f64 {
    let Some(last) = sorted.len().checked_sub(1) else { return 0.0 };
    let at = q * last as f64;
    let (low, high) = (at.floor() as usize, at.ceil() as usize);
    sorted[low] + (sorted[high] - sorted[low]) * (at - low as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_interpolate() {
        let values = [0.0, 1.0, 2.0, 3.0, 10.0];
        assert_eq!(quantile(&values, 0.5), 2.0);
        assert!((quantile(&values, 0.9) - 7.2).abs() < 1e-12);
        assert_eq!(quantile(&[], 0.5), 0.0);
    }

    #[test]
    fn an_interval_matches_a_worked_example() {
        // 1..5: mean 3, s = 1.5811, t(4) = 2.776, half width 2.776·1.5811/√5 = 1.963.
        let s = summarize(&[1.0, 2.0, 3.0, 4.0, 5.0]).unwrap();
        assert!((s.mean - 3.0).abs() < 1e-12 && (s.half_width_95.unwrap() - 1.963).abs() < 1e-3);
        assert!(s.excludes_zero());
    }

    #[test]
    fn one_value_has_no_interval_and_proves_nothing() {
        let s = summarize(&[4.0]).unwrap();
        assert_eq!(s.half_width_95, None);
        assert!(!s.excludes_zero() && !s.is_of_two());
        assert_eq!(summarize(&[]), None);
    }

    #[test]
    fn two_values_are_too_few_for_an_interval_and_three_are_not() {
        let two = summarize(&[1.0, 27.0]).unwrap();
        assert_eq!((two.mean, two.half_width_95, two.is_of_two()), (14.0, None, true), "it would be ± 165");
        assert!(!two.excludes_zero());
        // 1, 2, 3: s = 1, t(2) = 4.303, half width 4.303/√3 = 2.484.
        let three = summarize(&[1.0, 2.0, 3.0]).unwrap();
        assert!((three.half_width_95.unwrap() - 2.484).abs() < 1e-3 && !three.is_of_two());
    }

    #[test]
    fn the_expansion_joins_the_table() {
        assert!((t_quantile_975(31) - 2.0395).abs() < 1e-3 && (t_quantile_975(30) - 2.042).abs() < 1e-9);
        assert!((t_quantile_975(1_000_000) - 1.95997).abs() < 1e-4);
    }
}
