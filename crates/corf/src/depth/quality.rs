//! Errors of the depths of new Gaussians, where a dataset has ground truth. Nothing that is reconstructed depends on them.

use super::{PixelDepth, Reliability};
use corf_scene::Raster;
use serde::{Deserialize, Serialize};

/// Relative errors of depths, |z/z_true − 1|, of one kind.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DepthErrors {
    /// Share of the depths that are of this kind.
    pub share: f64,
    /// Median relative error.
    pub median: f64,
    /// 90th percentile of the relative error.
    pub p90: f64,
    /// Mean relative error.
    pub mean: f64,
}

/// Errors of the depths that new Gaussians were given, over all keyframes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DepthQuality {
    /// All of them; `share` is 1.
    pub all: DepthErrors,
    /// Accurate multi-view matches.
    pub accurate: DepthErrors,
    /// Depths of the aligned prior alone.
    pub prior: DepthErrors,
    /// Triangulated corners.
    pub triangulated: DepthErrors,
    /// Share of the sampled pixels that found no depth (no match, and no prior that is trusted there) and were dropped.
    pub dropped_without_depth: f64,
}

/// Collects errors keyframe by keyframe.
#[derive(Clone, Debug, Default)]
pub struct DepthTally {
    errors: [Vec<f32>; 3],
    sampled: usize,
    dropped: usize,
}

impl DepthTally {
    /// Adds a keyframe: how many pixels were sampled, how many of them found no depth, and the depths of the rest beside the true z-depth
    /// (metres; 0 where nothing was hit).
    pub fn add(&mut self, sampled: usize, dropped: usize, depths: &[PixelDepth], truth_m: &Raster<f32>) {
        (self.sampled, self.dropped) = (self.sampled + sampled, self.dropped + dropped);
        for d in depths {
            let truth = truth_m[(d.x, d.y)];
            if truth > 0.0 && truth.is_finite() {
                let kind = match d.reliability {
                    Reliability::Accurate => 0,
                    Reliability::Prior => 1,
                    Reliability::Triangulated => 2,
                };
                self.errors[kind].push((1.0 / (d.inverse_depth * truth) - 1.0).abs());
            }
        }
    }

    /// The errors so far; `None` before there are any.
    pub fn quality(&self) -> Option<DepthQuality> {
        let count: usize = self.errors.iter().map(Vec::len).sum();
        let of = |errors: Vec<f32>| summary(errors, count);
        let [accurate, prior, triangulated] = self.errors.clone().map(of);
        (count > 0).then(|| DepthQuality {
            all: of(self.errors.concat()),
            accurate,
            prior,
            triangulated,
            dropped_without_depth: self.dropped as f64 / self.sampled.max(1) as f64,
        })
    }
}

fn summary(mut errors: Vec<f32>, all: usize) -> DepthErrors {
    errors.sort_unstable_by(f32::total_cmp);
    let Some(last) = errors.len().checked_sub(1) else { return DepthErrors::default() };
    DepthErrors {
        share: errors.len() as f64 / all as f64,
        median: f64::from(errors[last / 2]),
        p90: f64::from(errors[last * 9 / 10]),
        mean: errors.iter().map(|e| f64::from(*e)).sum::<f64>() / errors.len() as f64,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_relative_to_the_truth_and_by_kind() {
        let truth = Raster::from_vec(3, 1, vec![2.0, 4.0, 0.0]);
        let depth = |x, z: f32, reliability| PixelDepth { x, y: 0, inverse_depth: 1.0 / z, reliability };
        let mut tally = DepthTally::default();
        assert_eq!(tally.quality(), None);
        let some = [depth(0, 2.2, Reliability::Accurate), depth(1, 3.0, Reliability::Prior), depth(2, 1.0, Reliability::Prior)];
        tally.add(8, 2, &some, &truth);
        let quality = tally.quality().unwrap();
        assert!((quality.accurate.median - 0.1).abs() < 1e-6 && (quality.prior.p90 - 0.25).abs() < 1e-6);
        assert_eq!((quality.accurate.share, quality.all.share, quality.dropped_without_depth), (0.5, 1.0, 0.25));
        assert_eq!(quality.triangulated, DepthErrors::default());
    }
}
