//! Which keyframes train and which are evaluated.

use anyhow::{Result, bail};
use corf_scene::dataset::Dataset;
use serde::{Deserialize, Serialize};

/// Part of the keyframes that an evaluation may look at. Constants are chosen under `validation`; what is published is under `test` and `segment`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Protocol {
    /// Every `test_every`-th keyframe is left out altogether; of the rest, those half-way between two of them are evaluated and the others train.
    Validation,
    /// Every `test_every`-th keyframe is evaluated, all others train.
    #[default]
    Test,
    /// A contiguous segment of the trajectory is evaluated, all others train: what extrapolation costs.
    Segment,
}

impl Protocol {
    /// The protocol's name in plans and records.
    pub fn name(self) -> &'static str {
        match self {
            Self::Validation => "validation",
            Self::Test => "test",
            Self::Segment => "segment",
        }
    }
}

/// A dataset's keyframes under a protocol; indices from 0 along the trajectory, rising.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Split {
    /// The protocol.
    pub protocol: Protocol,
    /// Indices of the keyframes that a method is given.
    pub train: Vec<usize>,
    /// Indices of the keyframes that it is evaluated on.
    pub held_out: Vec<usize>,
}

impl Split {
    /// The keyframes of a dataset under a protocol.
    ///
    /// # Errors
    /// A dataset that leaves nothing to evaluate, or nothing to train with.
    pub fn of(dataset: &Dataset, protocol: Protocol) -> Result<Self> {
        let (train, test, segment) = (dataset.train_indices(), dataset.test_indices(), dataset.held_out_segment());
        let every = dataset.header().split.test_every;
        let is_validation = |i: usize| every > 2 && i % every == every / 2;
        let (train, held_out): (Vec<usize>, Vec<usize>) = match protocol {
            Protocol::Test => (train.to_vec(), test.to_vec()),
            Protocol::Validation => train.iter().copied().partition(|i| !is_validation(*i)),
            Protocol::Segment => ((0..dataset.len()).filter(|i| !segment.contains(i)).collect(), segment.to_vec()),
        };
        if held_out.is_empty() {
            bail!(
                "{}: the {} protocol leaves no keyframe to evaluate (test_every = {every}, {} keyframes)\n  help: validation needs test_every \
                 of 3 or more; otherwise generate more keyframes",
                dataset.dir().display(),
                protocol.name(),
                dataset.len()
            );
        }
        if train.is_empty() {
            bail!("{}: the dataset has no training keyframes\n  help: test_every must be 2 or more", dataset.dir().display());
        }
        Ok(Self { protocol, train, held_out })
    }
}
