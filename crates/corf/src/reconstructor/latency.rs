//! Latency of keyframes. Where keyframes are handed over as fast as they are taken, as from a dataset, a keyframe waits about as long as
//! the one before takes: a camera slower than that sees expansion and training alone.

use serde::{Deserialize, Serialize};

/// Breakdown of the time from a keyframe's arrival to the end of its optimisation, seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct KeyframeTiming {
    /// Index along the trajectory.
    pub index: usize,
    /// Time from a keyframe's arrival to its turn, seconds: it was being prepared, or the keyframes before it were being worked on.
    pub wait_s: f64,
    /// Time of the steps of its preparation, seconds; part of the wait where that happens ahead.
    #[serde(default)]
    pub prepare_s: f64,
    /// Time of matching it with its neighbours, seconds: a part of its preparation or, of what was not matched ahead, of its expansion. Where a
    /// GPU matches, the time that was waited for it.
    #[serde(default)]
    pub match_s: f64,
    /// Time of that by the GPU's own clock, seconds; 0 where the processor matches or the GPU keeps no time.
    #[serde(default)]
    pub match_device_s: f64,
    /// Time of its expansion (depths, new Gaussians, pruning), seconds.
    pub expand_s: f64,
    /// Time of its optimisation steps, seconds, without those of `late_s`.
    pub train_s: f64,
    /// Time from then to the end of those of its steps, seconds, that are taken while the next keyframe is expanded
    /// ([`overlapped_iterations`](crate::ReconstructionConfig)): it includes waiting for that keyframe, and is a part of its `expand_s`.
    #[serde(default)]
    pub late_s: f64,
    /// Steps taken, where a time was given for them ([`keyframe_budget_ms`](crate::ReconstructionConfig)).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub steps: Option<usize>,
}

impl KeyframeTiming {
    /// Time from arrival to the end of optimisation, seconds.
    pub fn total_s(&self) -> f64 {
        self.wait_s + self.expand_s + self.train_s + self.late_s
    }
}

/// A distribution of seconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Percentiles {
    /// Half are below.
    pub median_s: f64,
    /// Nine tenths are at or below.
    pub p90_s: f64,
    /// 99 of a hundred are at or below.
    pub p99_s: f64,
}

impl Percentiles {
    /// Percentiles by the nearest rank: each is one of the values.
    pub fn of(values: impl Iterator<Item = f64>) -> Self {
        let mut sorted: Vec<f64> = values.collect();
        sorted.sort_by(f64::total_cmp);
        let at = |share: f64| match sorted.len() {
            0 => 0.0,
            n => sorted[((share * n as f64).ceil() as usize).clamp(1, n) - 1],
        };
        Self { median_s: at(0.5), p90_s: at(0.9), p99_s: at(0.99) }
    }
}

/// Latency of keyframes and its parts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct LatencySummary {
    /// Keyframes counted.
    pub keyframes: usize,
    /// Keyframes through expansion and training per second of both together.
    pub keyframes_per_second: f64,
    /// Time from arrival to the end of optimisation, seconds.
    pub total: Percentiles,
    /// Time from arrival to its turn, seconds.
    pub wait: Percentiles,
    /// Preparation, within the wait.
    #[serde(default)]
    pub prepare: Percentiles,
    /// Matching, within the preparation or the expansion.
    #[serde(default, rename = "match")]
    pub matching: Percentiles,
    /// Matching by the GPU's own clock.
    #[serde(default)]
    pub match_device: Percentiles,
    /// Time of the expansion, seconds.
    pub expand: Percentiles,
    /// Time of the optimisation steps, seconds.
    pub train: Percentiles,
    /// The end of it, where that is within the next keyframe's expansion.
    #[serde(default)]
    pub late: Percentiles,
}

impl LatencySummary {
    /// Summarises the timings of some keyframes; `None` without any.
    pub fn of(timings: &[KeyframeTiming]) -> Option<Self> {
        let busy_s: f64 = timings.iter().map(|t| t.expand_s + t.train_s).sum();
        (!timings.is_empty()).then(|| Self {
            keyframes: timings.len(),
            keyframes_per_second: if busy_s > 0.0 { timings.len() as f64 / busy_s } else { 0.0 },
            total: Percentiles::of(timings.iter().map(KeyframeTiming::total_s)),
            wait: Percentiles::of(timings.iter().map(|t| t.wait_s)),
            prepare: Percentiles::of(timings.iter().map(|t| t.prepare_s)),
            matching: Percentiles::of(timings.iter().map(|t| t.match_s)),
            match_device: Percentiles::of(timings.iter().map(|t| t.match_device_s)),
            expand: Percentiles::of(timings.iter().map(|t| t.expand_s)),
            train: Percentiles::of(timings.iter().map(|t| t.train_s)),
            late: Percentiles::of(timings.iter().map(|t| t.late_s)),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentiles_are_values_that_occurred_and_parts_add_up() {
        let timings: Vec<KeyframeTiming> = (1..=200)
            .rev()
            .map(|i| KeyframeTiming {
                index: i,
                wait_s: 0.5,
                prepare_s: 0.25,
                match_s: 0.125,
                match_device_s: 0.0625,
                expand_s: 1.0,
                train_s: i as f64,
                late_s: 0.5,
                steps: None,
            })
            .collect();
        let s = LatencySummary::of(&timings).unwrap();
        assert_eq!((s.train.median_s, s.train.p90_s, s.train.p99_s), (100.0, 180.0, 198.0));
        assert_eq!((s.total.median_s, s.wait.p99_s, s.keyframes), (102.0, 0.5, 200));
        assert_eq!((s.prepare.p90_s, s.matching.median_s, s.match_device.p99_s), (0.25, 0.125, 0.0625));
        assert!((s.keyframes_per_second - 200.0 / (200.0 + 20_100.0)).abs() < 1e-12);
        assert_eq!(LatencySummary::of(&timings[..1]).unwrap().total.p99_s, 202.0);
        assert!(LatencySummary::of(&[]).is_none());
    }
}
