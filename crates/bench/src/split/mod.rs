//! Which keyframes train and which are evaluated.

mod blocks;
mod protocol;

pub use blocks::{Blocks, By, Gap};
pub use protocol::{Holdout, Protocol};

use anyhow::{Context, Result, bail};
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
    /// of the others.
    pub fn role(self, index: usize, test_every: usize) -> Option<Role> {
        let is_test = index.is_multiple_of(test_every.max(1));
        let role = match self.holdout {
            _ if self.train_every.get() > 1 => return None,
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
        let (train, held_out): (Vec<usize>, Vec<usize>) = match protocol.holdout {
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
        let train = thinned(train, &held_out, &positions(dataset), protocol.train_every.get());
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

/// Training keyframes at one spacing: of the keyframes whose indices leave the same remainder by `every`, those that are farthest from the held-out
/// ones (by the mean of a held-out keyframe's distance to the nearest of them), among the remainders that hold at least their share of the training
/// keyframes. Every other one of a list would keep a neighbour of most held-out keyframes however few are left.
fn thinned(train: Vec<usize>, held_out: &[usize], positions: &[DVec3], every: usize) -> Vec<usize> {
    let share = train.len() / every;
    let of_remainder = |remainder: usize| -> Vec<usize> { train.iter().copied().filter(|i| i % every == remainder).collect() };
    let distance_m = |kept: &[usize]| -> f64 { held_out.iter().map(|i| nearest_m(positions, kept, *i)).sum() };
    let mut best: Option<(f64, Vec<usize>)> = None;
    for kept in (0..every).map(of_remainder).filter(|kept| !kept.is_empty() && kept.len() >= share) {
        let far = distance_m(&kept);
        if best.as_ref().is_none_or(|(farthest, _)| far > *farthest) {
            best = Some((far, kept));
        }
    }
    best.map_or(train, |(_, kept)| kept)
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

    #[test]
    fn thinning_keeps_what_is_farthest_from_the_held_out_ones() {
        // On a line, a metre apart, every eighth held out: keyframes i with i mod every = every / 2 are left, every / 2 metres away.
        let positions: Vec<DVec3> = (0..64).map(|i| DVec3::new(f64::from(i), 0.0, 0.0)).collect();
        let (held_out, train): (Vec<usize>, Vec<usize>) = (0..64).partition(|i| i % 8 == 0);
        assert_eq!(thinned(train.clone(), &held_out, &positions, 1), train);
        for every in [2, 4, 8] {
            let kept = thinned(train.clone(), &held_out, &positions, every);
            assert_eq!(kept, (every / 2..64).step_by(every).collect::<Vec<_>>(), "one of every {every}");
            let nearest = |i: &usize| nearest_m(&positions, &kept, *i);
            assert!(held_out.iter().map(nearest).all(|m| m == every as f64 / 2.0), "one of every {every}");
        }
    }

    #[test]
    fn thinning_leaves_a_share_of_scattered_keyframes() {
        let positions: Vec<DVec3> = (0..40).map(|i| DVec3::new(f64::from(i * 17 % 40), f64::from(i * 7 % 11), 0.0)).collect();
        let (held_out, train): (Vec<usize>, Vec<usize>) = (0..40).partition(|i| i % 5 == 2);
        for every in 2..7 {
            let kept = thinned(train.clone(), &held_out, &positions, every);
            assert!(
                kept.len() >= train.len() / every && kept.len() <= 40_usize.div_ceil(every),
                "{} of every {every}",
                kept.len()
            );
            assert!(kept.iter().all(|i| train.contains(i)));
        }
        assert_eq!(thinned(vec![3, 7], &[5], &positions, 9).len(), 1, "fewer keyframes than the step");
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
