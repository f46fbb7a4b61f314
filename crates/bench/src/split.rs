//! Which keyframes train and which are evaluated.

use anyhow::{Result, bail};
use corf_scene::dataset::Dataset;
use corf_scene::words::counted;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Part of the keyframes that an evaluation may look at. Constants are chosen under `validation`; what is published is under `test` and `segment`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, JsonSchema, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Protocol {
    /// Every `test_every`-th keyframe is left out altogether; of the rest, those half-way between two of them are evaluated and the others train.
    Validation,
    /// Every `test_every`-th keyframe is evaluated, all others train.
    #[default]
    Test,
    /// A contiguous segment of the trajectory is evaluated, all others train: what extrapolation costs.
    Segment,
    /// All keyframes train, and none is left to evaluate.
    All,
}

/// Part that a keyframe plays under a protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Role {
    /// A method is given it.
    Trains,
    /// It is evaluated.
    HeldOut,
    /// Neither.
    LeftOut,
}

impl Protocol {
    /// The protocol's name in plans and records.
    pub fn name(self) -> &'static str {
        match self {
            Self::Validation => "validation",
            Self::Test => "test",
            Self::Segment => "segment",
            Self::All => "all",
        }
    }

    /// The part of a keyframe of which its index alone is known, where every `test_every`-th is a test one; none where the protocol needs to know
    /// how many there are.
    pub fn role(self, index: usize, test_every: usize) -> Option<Role> {
        let is_test = index.is_multiple_of(test_every.max(1));
        let role = match self {
            Self::Segment => return None,
            Self::All => Role::Trains,
            Self::Test if is_test => Role::HeldOut,
            Self::Validation if is_test => Role::LeftOut,
            Self::Validation if is_validation(index, test_every) => Role::HeldOut,
            Self::Test | Self::Validation => Role::Trains,
        };
        Some(role)
    }
}

/// Whether a training keyframe is a validation one: half-way between two test ones.
fn is_validation(index: usize, test_every: usize) -> bool {
    test_every > 2 && index % test_every == test_every / 2
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
        let (train, held_out): (Vec<usize>, Vec<usize>) = match protocol {
            Protocol::Test => (train.to_vec(), test.to_vec()),
            Protocol::Validation => train.iter().copied().partition(|i| !is_validation(*i, every)),
            Protocol::Segment => ((0..dataset.len()).filter(|i| !segment.contains(i)).collect(), segment.to_vec()),
            Protocol::All => ((0..dataset.len()).collect(), Vec::new()),
        };
        if held_out.is_empty() && protocol != Protocol::All {
            bail!(
                "{}: the {} protocol leaves no keyframe to evaluate (test_every = {every}, {})\n  help: validation needs test_every \
                 of 3 or more; otherwise generate more keyframes",
                dataset.dir().display(),
                protocol.name(),
                counted(dataset.len(), "keyframe")
            );
        }
        if train.is_empty() {
            bail!("{}: the dataset has no training keyframes\n  help: test_every must be 2 or more", dataset.dir().display());
        }
        Ok(Self { protocol, train, held_out })
    }

    /// Refuses a split that leaves nothing to evaluate.
    ///
    /// # Errors
    /// All keyframes train.
    pub fn check_held_out(&self) -> Result<()> {
        if self.held_out.is_empty() {
            bail!(
                "under the protocol \"{}\" all keyframes train, and none is left to evaluate\n  help: reconstruct with --protocol test, which holds \
                 every eighth out",
                self.protocol.name()
            );
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_keyframes_role_is_what_the_split_of_the_whole_says() {
        let roles = |protocol: Protocol| -> Vec<Option<Role>> { (0..9).map(|i| protocol.role(i, 8)).collect() };
        let count = |protocol: Protocol, role: Role| roles(protocol).iter().filter(|r| **r == Some(role)).count();
        assert_eq!((count(Protocol::Test, Role::HeldOut), count(Protocol::Test, Role::Trains)), (2, 7));
        assert_eq!(roles(Protocol::Validation)[4], Some(Role::HeldOut));
        assert_eq!((count(Protocol::Validation, Role::LeftOut), count(Protocol::Validation, Role::Trains)), (2, 6));
        assert_eq!(count(Protocol::All, Role::Trains), 9);
        assert!(roles(Protocol::Segment).iter().all(Option::is_none));
    }
}
