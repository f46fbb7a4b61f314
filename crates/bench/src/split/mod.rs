//! Which keyframes train and which are evaluated.

mod blocks;
mod protocol;

pub use blocks::{Blocks, By, Gap};
pub use protocol::{Holdout, Protocol};

use anyhow::{Context, Result, bail, ensure};
use corf_scene::dataset::Dataset;
use glam::DVec3;

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
    /// The part of a keyframe of which its index alone is known, where every `test_every`-th is a test one; none where the protocol needs to know
    /// of the others (segments, blocks, a spacing).
    pub fn role(self, index: usize, test_every: usize) -> Option<Role> {
        let is_test = index.is_multiple_of(test_every.max(1));
        let role = match self.holdout {
            _ if self.spacing.get() > 1 => return None,
            Holdout::Segment | Holdout::Blocks(_) => return None,
            Holdout::All => Role::Trains,
            Holdout::Test if is_test => Role::HeldOut,
            Holdout::Validation if is_test => Role::LeftOut,
            Holdout::Validation if is_validation(index, test_every) => Role::HeldOut,
            Holdout::Test | Holdout::Validation => Role::Trains,
        };
        Some(role)
    }
}

/// Whether a training keyframe is a validation one: half-way between two test ones.
fn is_validation(index: usize, test_every: usize) -> bool {
    test_every > 2 && index % test_every == test_every / 2
}

/// A dataset's keyframes under a protocol; indices from 0 along the trajectory, rising.
#[derive(Clone, Debug, PartialEq)]
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
        let (mut train, held_out): (Vec<usize>, Vec<usize>) = match protocol.holdout {
            Holdout::Test => (train.to_vec(), test.to_vec()),
            Holdout::Validation => train.iter().copied().partition(|i| !is_validation(*i, every)),
            Holdout::Segment => ((0..dataset.len()).filter(|i| !segment.contains(i)).collect(), segment.to_vec()),
            Holdout::All => ((0..dataset.len()).collect(), Vec::new()),
            Holdout::Blocks(blocks) => {
                let fold = blocks.fold_of(&positions(dataset)).with_context(|| dataset.dir().display().to_string())?;
                (fold.train, fold.held_out)
            }
        };
        if held_out.is_empty() && protocol.holdout != Holdout::All {
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
        if protocol.spacing.get() > 1 {
            let all = train.len();
            train = thinned(&train, &held_out, &positions(dataset), protocol.spacing.get());
            ensure!(
                train.len() < all,
                "{}: the protocol {protocol} leaves out none of its {all} training keyframes\n  help: give a larger spacing",
                dataset.dir().display()
            );
        }
        Ok(Self { protocol, train, held_out })
    }

    /// The keyframes of a dataset under a protocol, all of its folds taken together: those that are evaluated in any of them, and those that train
    /// in every one.
    ///
    /// # Errors
    /// Those of [`Self::of`].
    pub fn of_all_folds(dataset: &Dataset, protocol: Protocol) -> Result<Self> {
        let folds: Vec<Self> = protocol.folds().into_iter().map(|fold| Self::of(dataset, fold)).collect::<Result<_>>()?;
        let train = (0..dataset.len()).filter(|i| folds.iter().all(|fold| fold.train.contains(i))).collect();
        let held_out = (0..dataset.len()).filter(|i| folds.iter().any(|fold| fold.held_out.contains(i))).collect();
        Ok(Self { protocol, train, held_out })
    }

    /// Distance of every held-out keyframe to the nearest one that trains, metres, in their order.
    pub fn nearest_training_m(&self, dataset: &Dataset) -> Vec<f64> {
        let positions = positions(dataset);
        self.held_out.iter().map(|i| nearest_m(&positions, &self.train, *i)).collect()
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

/// Training keyframes at one spacing: of the keyframes whose indices leave the same remainder by `spacing`, those that are farthest from the held-out
/// ones (by the sum, over held-out keyframes, of the distance to the nearest of them), among the remainders that hold at least their share of the
/// training keyframes; of two that are equally far, the lower remainder. Along a trajectory they are evenly spaced.
fn thinned(train: &[usize], held_out: &[usize], positions: &[DVec3], spacing: usize) -> Vec<usize> {
    let share = train.len() / spacing;
    let of_remainder = |remainder: usize| -> Vec<usize> { train.iter().copied().filter(|i| i % spacing == remainder).collect() };
    let mut best: (f64, Vec<usize>) = (f64::NEG_INFINITY, Vec::new());
    for kept in (0..spacing).map(of_remainder).filter(|kept| !kept.is_empty() && kept.len() >= share) {
        let sum_m: f64 = held_out.iter().map(|i| nearest_m(positions, &kept, *i)).sum();
        // What is equally far but for rounding is equally far.
        if sum_m > best.0 * (1.0 + 1e-9) || best.1.is_empty() {
            best = (sum_m, kept);
        }
    }
    best.1
}

/// Distance of a keyframe to the nearest of others, metres; infinite if there are none.
fn nearest_m(positions: &[DVec3], others: &[usize], keyframe: usize) -> f64 {
    others.iter().map(|other| positions[*other].distance(positions[keyframe])).fold(f64::INFINITY, f64::min)
}

/// Positions of what moves, metres in the world frame, in the order of the keyframes.
fn positions(dataset: &Dataset) -> Vec<DVec3> {
    dataset.poses().iter().map(|pose| pose.world_from_camera.translation).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Keyframes on a line, a metre apart.
    fn on_a_line(n: u32) -> Vec<DVec3> {
        (0..n).map(|i| DVec3::new(f64::from(i), 0.0, 0.0)).collect()
    }

    #[test]
    fn thinning_keeps_what_is_farthest_from_the_held_out_ones() {
        // Every eighth held out: keyframes i with i mod spacing = spacing / 2 are left, spacing / 2 metres away.
        let (positions, (held_out, train)) = (on_a_line(64), (0..64).partition::<Vec<usize>, _>(|i| i % 8 == 0));
        assert_eq!(thinned(&train, &held_out, &positions, 1), train);
        for spacing in [2, 4, 8] {
            let kept = thinned(&train, &held_out, &positions, spacing);
            assert_eq!(kept, (spacing / 2..64).step_by(spacing).collect::<Vec<_>>(), "spacing {spacing}");
            let nearest = |i: &usize| nearest_m(&positions, &kept, *i);
            assert!(held_out.iter().map(nearest).all(|m| m == spacing as f64 / 2.0), "spacing {spacing}");
        }
    }

    #[test]
    fn thinning_leaves_a_share_of_the_keyframes_and_of_equals_the_first() {
        // Every sixth held out: the even ones are two metres away, and fewer than their share.
        let (positions, (held_out, train)) = (on_a_line(36), (0..36).partition::<Vec<usize>, _>(|i| i % 6 == 0));
        let odd: Vec<usize> = (1..36).step_by(2).collect();
        assert_eq!(thinned(&train, &held_out, &positions, 2), odd);
        assert!(train.len() / 2 > train.iter().filter(|i| *i % 2 == 0).count());
        // By three, the first and the second remainder are mirror images but for the end of the line; rounding decides nothing.
        let circle = |i: u32| {
            DVec3::new(
                (f64::from(i) / 36.0 * std::f64::consts::TAU).cos(),
                (f64::from(i) / 36.0 * std::f64::consts::TAU).sin(),
                0.0,
            )
        };
        let round: Vec<DVec3> = (0..36).map(circle).collect();
        assert_eq!(thinned(&train, &held_out, &round, 3), (1..36).step_by(3).collect::<Vec<_>>());
        assert_eq!(thinned(&[3, 7], &[5], &positions, 9), [3], "fewer keyframes than the spacing");
    }

    #[test]
    fn a_keyframes_role_is_what_the_split_of_the_whole_says() {
        let roles = |protocol: Protocol| -> Vec<Option<Role>> { (0..9).map(|i| protocol.role(i, 8)).collect() };
        let count = |protocol: Protocol, role: Role| roles(protocol).iter().filter(|r| **r == Some(role)).count();
        assert_eq!((count(Protocol::TEST, Role::HeldOut), count(Protocol::TEST, Role::Trains)), (2, 7));
        assert_eq!(roles(Protocol::VALIDATION)[4], Some(Role::HeldOut));
        assert_eq!((count(Protocol::VALIDATION, Role::LeftOut), count(Protocol::VALIDATION, Role::Trains)), (2, 6));
        assert_eq!(count(Protocol::ALL, Role::Trains), 9);
        assert!(roles(Protocol::SEGMENT).iter().all(Option::is_none));
    }
}
