//! Intervals held against errors.

use super::NOMINAL;
use serde::Serialize;

/// A keyframe's errors with the standard deviations that were claimed.
pub struct Judged<'e> {
    /// Index of the keyframe.
    pub index: usize,
    /// Errors, dB.
    pub errors_db: &'e [f64],
    /// Standard deviations, dB.
    pub deviations_db: Vec<f64>,
    /// Half an interval in standard deviations.
    pub factor: f64,
}

/// What became of a keyframe's intervals.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FrameCoverage {
    /// Index of the keyframe.
    pub index: usize,
    /// Share of errors within their intervals.
    pub coverage: f64,
    /// Root mean square error, dB.
    pub rmse_db: f64,
    /// Root mean square of standard deviations, dB.
    pub deviation_db: f64,
}

/// What became of intervals over keyframes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Coverage {
    /// Share of errors within their intervals.
    pub coverage: f64,
    /// Mean of half an interval, dB.
    pub half_width_db: f64,
    /// Mean interval score, dB: width, and beside it 2/0.1 times what an error lies outside (Gneiting and Raftery 2007); less is better.
    pub score_db: f64,
    /// Spearman's rank correlation of standard deviations and absolute errors.
    pub rank_correlation: f64,
    /// Every keyframe.
    pub frames: Vec<FrameCoverage>,
}

impl Coverage {
    /// Over keyframes; nothing without pixels.
    pub fn of(judged: &[Judged<'_>]) -> Option<Self> {
        let pixels =
            || judged.iter().flat_map(|j| j.errors_db.iter().zip(&j.deviations_db).map(move |(e, d)| (e.abs(), *d, j.factor)));
        let count = pixels().count();
        if count == 0 {
            return None;
        }
        let mean = |of: &dyn Fn((f64, f64, f64)) -> f64| pixels().map(of).sum::<f64>() / count as f64;
        let frame = |j: &Judged<'_>| {
            let n = j.errors_db.len() as f64;
            let within = j.errors_db.iter().zip(&j.deviations_db).filter(|(e, d)| e.abs() <= j.factor * **d).count();
            FrameCoverage {
                index: j.index,
                coverage: within as f64 / n,
                rmse_db: (j.errors_db.iter().map(|e| e * e).sum::<f64>() / n).sqrt(),
                deviation_db: (j.deviations_db.iter().map(|d| d * d).sum::<f64>() / n).sqrt(),
            }
        };
        let (errors, deviations): (Vec<f64>, Vec<f64>) = pixels().map(|(e, d, _)| (e, d)).unzip();
        Some(Self {
            coverage: mean(&|(e, d, factor)| f64::from(u8::from(e <= factor * d))),
            half_width_db: mean(&|(_, d, factor)| factor * d),
            score_db: mean(&|(e, d, factor)| 2.0 * factor * d + 2.0 / (1.0 - NOMINAL) * (e - factor * d).max(0.0)),
            rank_correlation: correlation(&ranks(&errors), &ranks(&deviations)),
            frames: judged.iter().filter(|j| !j.errors_db.is_empty()).map(frame).collect(),
        })
    }
}

/// Ranks from 0; equal values share the mean of theirs.
fn ranks(values: &[f64]) -> Vec<f64> {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let (mut ranks, mut first) = (vec![0.0; values.len()], 0);
    for equal in order.chunk_by(|&a, &b| values[a] == values[b]) {
        let rank = first as f64 + 0.5 * (equal.len() - 1) as f64;
        equal.iter().for_each(|&i| ranks[i] = rank);
        first += equal.len();
    }
    ranks
}

/// Pearson's correlation; 0 where one does not vary.
fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let mean = |v: &[f64]| v.iter().sum::<f64>() / v.len().max(1) as f64;
    let (ma, mb) = (mean(a), mean(b));
    let sum = |of: &dyn Fn(f64, f64) -> f64| a.iter().zip(b).map(|(x, y)| of(x - ma, y - mb)).sum::<f64>();
    let (aa, bb) = (sum(&|x, _| x * x), sum(&|_, y| y * y));
    if aa > 0.0 && bb > 0.0 { sum(&|x, y| x * y) / (aa * bb).sqrt() } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coverage_width_and_score_are_those_of_a_worked_example() {
        let errors = [0.5, -1.0, 3.0, 0.0];
        let judged = [Judged { index: 7, errors_db: &errors, deviations_db: vec![1.0, 1.0, 1.0, 0.5], factor: 2.0 }];
        let of = Coverage::of(&judged).unwrap();
        assert_eq!((of.coverage, of.half_width_db), (0.75, 1.75));
        // Widths of 4, 4, 4 and 2, and 20 times the 1 dB that one error lies outside.
        assert!((of.score_db - (14.0 + 20.0) / 4.0).abs() < 1e-9, "{}", of.score_db);
        assert_eq!((of.frames[0].index, of.frames[0].rmse_db), (7, (10.25f64 / 4.0).sqrt()));
        assert!(Coverage::of(&[]).is_none());
    }

    #[test]
    fn ranks_of_equal_values_are_shared() {
        assert_eq!(ranks(&[3.0, 1.0, 3.0, 2.0]), [2.5, 0.0, 2.5, 1.0]);
        assert!(
            (correlation(&[1.0, 2.0, 3.0], &[5.0, 6.0, 7.0]) - 1.0).abs() < 1e-12 && correlation(&[1.0, 1.0], &[1.0, 2.0]) == 0.0
        );
    }
}
