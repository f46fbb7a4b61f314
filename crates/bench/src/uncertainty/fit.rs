//! Weights of signs: ln σ = Σ wₖ·sₖ, with the weights that make errors most likely as normal ones of that standard deviation.

use anyhow::{Result, ensure};

/// Most steps of Newton's method.
const STEPS: usize = 100;
/// Longest step of a weight.
const LONGEST: f64 = 0.5;
/// Step at which it has arrived.
const ARRIVED: f64 = 1e-9;
/// Pull of weights to zero, in units of one example: signs that do not vary stay where they are.
const RIDGE: f64 = 1e-2;
/// Added to squared errors, dB²: errors of zero (both at the floor) are no proof of certainty.
const LEAST_ERROR_DB2: f64 = 1e-4;

/// ln σ of an example.
pub fn log_deviation<const N: usize>(weights: &[f64; N], signs: &[f64; N]) -> f64 {
    weights.iter().zip(signs).map(|(w, s)| w * s).sum()
}

/// The weights of examples of signs and errors. The first sign is 1. Σ (ln σ + e²/2σ²) is convex in them, so that Newton's method finds its one minimum.
///
/// # Errors
/// No example; signs or errors of which no minimum follows.
pub fn weights<const N: usize>(examples: &[([f64; N], f64)]) -> Result<[f64; N]> {
    ensure!(!examples.is_empty(), "there is no error to learn from");
    let mean_square = examples.iter().map(|(_, e)| e * e + LEAST_ERROR_DB2).sum::<f64>() / examples.len() as f64;
    let mut weights = [0.0; N];
    weights[0] = 0.5 * mean_square.ln();
    for _ in 0..STEPS {
        let (mut gradient, mut hessian) = (weights.map(|w| RIDGE * w), [[0.0; N]; N]);
        (0..N).for_each(|i| hessian[i][i] = RIDGE);
        for (signs, error) in examples {
            let q = (error * error + LEAST_ERROR_DB2) * (-2.0 * log_deviation(&weights, signs)).exp();
            for ((sum, row), sign) in gradient.iter_mut().zip(&mut hessian).zip(signs) {
                *sum += (1.0 - q) * sign;
                row.iter_mut().zip(signs).for_each(|(sum, other)| *sum += 2.0 * q * sign * other);
            }
        }
        let step = solved(hessian, gradient).map(|s| s.clamp(-LONGEST, LONGEST));
        ensure!(
            step.iter().all(|s| s.is_finite()),
            "errors of these keyframes do not depend on what is around them in any way that can be told"
        );
        weights.iter_mut().zip(&step).for_each(|(weight, step)| *weight -= step);
        if step.iter().all(|s| s.abs() < ARRIVED) {
            break;
        }
    }
    Ok(weights)
}

/// The solution of a symmetric positive definite system, by Gauss's elimination.
fn solved<const N: usize>(mut a: [[f64; N]; N], mut b: [f64; N]) -> [f64; N] {
    for k in 0..N {
        let (pivot, of_b) = (a[k], b[k]);
        for (row, b) in a.iter_mut().zip(&mut b).skip(k + 1) {
            let factor = row[k] / pivot[k];
            row.iter_mut().zip(&pivot).for_each(|(x, p)| *x -= factor * p);
            *b -= factor * of_b;
        }
    }
    for k in (0..N).rev() {
        b[k] = (b[k] - (k + 1..N).map(|j| a[k][j] * b[j]).sum::<f64>()) / a[k][k];
    }
    b
}

/// The ratio of error to standard deviation that a share of examples does not exceed.
pub fn factor(ratios: &mut [f64], share: f64) -> f64 {
    ratios.sort_by(f64::total_cmp);
    crate::metrics::stats::quantile(ratios, share)
}

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::Rng;

    #[test]
    fn weights_of_made_errors_are_found_again() {
        let (truth, mut rng) = ([0.4, 1.1, -0.6], Rng::keyed(1, 2, 3));
        let mut example = |_| {
            let signs = [1.0, rng.normal(), 0.3 * rng.normal()];
            (signs, rng.normal() * log_deviation(&truth, &signs).exp())
        };
        let examples: Vec<_> = (0..20_000).map(&mut example).collect();
        let found = weights(&examples).unwrap();
        // The standard error of a weight of a sign of deviation s is 1 / (s·√2n): 0.005, and 0.017 of the last.
        assert!(found.iter().zip(truth).zip([0.02, 0.02, 0.06]).all(|((a, b), most)| (a - b).abs() < most), "{found:?}");
        let mut ratios: Vec<f64> = examples.iter().map(|(s, e)| e.abs() / log_deviation(&found, s).exp()).collect();
        // The 90th percentile of |N(0, 1)|.
        assert!((factor(&mut ratios, 0.9) - 1.645).abs() < 0.04);
        assert!(weights::<2>(&[]).is_err());
    }

    #[test]
    fn a_sign_that_never_changes_does_no_harm() {
        let mut rng = Rng::keyed(1, 2, 4);
        let examples: Vec<_> = (0..2000).map(|_| ([1.0, 3.0], 2.0 * rng.normal())).collect();
        let found = weights(&examples).unwrap();
        assert!((log_deviation(&found, &[1.0, 3.0]) - 2.0_f64.ln()).abs() < 0.06, "{found:?}");
    }
}
