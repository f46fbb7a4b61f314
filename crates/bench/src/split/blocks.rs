//! Blocks of keyframes: a test block lies apart from all that trains, so that a lookup cannot copy what stands beside it.

use anyhow::{Result, bail, ensure};
use corf_scene::Rng;
use glam::DVec3;

/// Stage of the random numbers that clusters begin with; no reconstruction draws from it.
const STAGE: u64 = 0x626c_6f63_6b73;
/// Most rounds in which clusters move.
const MOST_ROUNDS: usize = 1000;

/// Blocks of keyframes, one of which is held out in each fold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Blocks {
    /// How keyframes are put into blocks.
    pub by: By,
    /// Number of blocks, and of folds.
    pub parts: usize,
    /// How far what trains is from what is evaluated.
    pub gap: Gap,
    /// The fold, counted from 1; none where all are meant.
    pub fold: Option<usize>,
    /// Whether the block behind the fold's is evaluated instead, and the fold's own is left out: what constants may be chosen on.
    pub validation: bool,
}

/// How keyframes are put into blocks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum By {
    /// Contiguous segments of the trajectory, of equally many keyframes.
    Trajectory,
    /// Slabs along an axis of the world (0, 1, 2: x, y, z), of equally many keyframes.
    Axis(usize),
    /// Clusters of positions (Lloyd's algorithm, begun as k-means++ does).
    KMeans {
        /// Seed of the first centres.
        seed: u64,
    },
}

/// How far what trains is from what is evaluated; keyframes that are nearer take no part in the fold.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Gap {
    /// Keyframes along the trajectory that lie between.
    Keyframes(usize),
    /// Metres between positions: a training keyframe is farther than this from every evaluated one.
    Metres(f64),
}

/// A fold: indices of keyframes, rising.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Fold {
    /// Those that train.
    pub train: Vec<usize>,
    /// Those that are evaluated.
    pub held_out: Vec<usize>,
}

impl Blocks {
    /// The fold that it names, of keyframes at these positions in metres, in the order of the trajectory.
    ///
    /// # Errors
    /// No fold named; fewer keyframes, or places, than blocks; a gap that leaves nothing to train with.
    pub fn fold_of(&self, positions: &[DVec3]) -> Result<Fold> {
        let Some(fold) = self.fold else {
            bail!("{self} has {} folds, and one is needed here\n  help: name it: {self},fold=1", self.parts);
        };
        let block_of = self.block_of(positions)?;
        let members = |block: usize| (0..positions.len()).filter(|i| block_of[*i] == block).collect::<Vec<_>>();
        let test = members(fold - 1);
        let held_out = if self.validation { members(fold % self.parts) } else { test.clone() };
        // Whatever may not be near what trains: of a validation block, the test block's surroundings stay out as well.
        let apart: Vec<usize> = if self.validation { [&test[..], &held_out[..]].concat() } else { held_out.clone() };
        let trains = |i: &usize| !apart.iter().any(|other| self.gap.holds(*i, *other, positions));
        let train: Vec<usize> = (0..positions.len()).filter(trains).collect();
        ensure!(!train.is_empty(), "{self}: no keyframe is left to train with\n  help: give a smaller gap, or more parts");
        Ok(Fold { train, held_out })
    }

    /// The block of every keyframe, counted from 0; none is empty.
    ///
    /// # Errors
    /// Fewer keyframes, or places, than blocks.
    pub fn block_of(&self, positions: &[DVec3]) -> Result<Vec<usize>> {
        let count = positions.len();
        ensure!(
            count >= self.parts,
            "{self}: {count} keyframes cannot be put into {} blocks\n  help: give fewer parts",
            self.parts
        );
        match self.by {
            By::Trajectory => Ok((0..count).map(|i| i * self.parts / count).collect()),
            By::Axis(axis) => {
                let mut order: Vec<usize> = (0..count).collect();
                order.sort_by(|a, b| positions[*a][axis].total_cmp(&positions[*b][axis]).then(a.cmp(b)));
                let mut block_of = vec![0; count];
                order.iter().enumerate().for_each(|(rank, i)| block_of[*i] = rank * self.parts / count);
                Ok(block_of)
            }
            By::KMeans { seed } => self.clusters(positions, seed),
        }
    }

    /// Clusters, numbered by the first keyframe of each.
    fn clusters(&self, positions: &[DVec3], seed: u64) -> Result<Vec<usize>> {
        let mut rng = Rng::keyed(seed, STAGE, 0);
        let mut centres = vec![positions[rng.below(positions.len())]];
        // k-means++: a next centre with the probability of its squared distance to the nearest one so far.
        let mut squared: Vec<f64> = vec![f64::INFINITY; positions.len()];
        while centres.len() < self.parts {
            let last = centres[centres.len() - 1];
            squared.iter_mut().zip(positions).for_each(|(least, p)| *least = least.min(p.distance_squared(last)));
            let total: f64 = squared.iter().sum();
            ensure!(
                total > 0.0,
                "{self}: the keyframes stand at {} places, too few for {} blocks\n  help: give fewer parts, or blocks of the trajectory",
                centres.len(),
                self.parts
            );
            let wanted = rng.uniform_f64() * total;
            let mut sum = 0.0;
            let reached = |least: &f64| {
                sum += least;
                *least > 0.0 && sum > wanted
            };
            // Rounding may leave the last one unreached.
            let at = squared.iter().position(reached).or_else(|| squared.iter().rposition(|least| *least > 0.0));
            centres.push(positions[at.unwrap_or(0)]);
        }
        let nearest = |p: &DVec3, centres: &[DVec3]| {
            let mut best = 0;
            for (i, centre) in centres.iter().enumerate() {
                if p.distance_squared(*centre) < p.distance_squared(centres[best]) {
                    best = i;
                }
            }
            best
        };
        let mut block_of: Vec<usize> = positions.iter().map(|p| nearest(p, &centres)).collect();
        for _ in 0..MOST_ROUNDS {
            for (block, centre) in centres.iter_mut().enumerate() {
                let members: Vec<DVec3> =
                    positions.iter().zip(&block_of).filter(|(_, b)| **b == block).map(|(p, _)| *p).collect();
                // A cluster that has lost all keeps its centre; it is refused below if it stays empty.
                if !members.is_empty() {
                    *centre = members.iter().sum::<DVec3>() / members.len() as f64;
                }
            }
            let moved: Vec<usize> = positions.iter().map(|p| nearest(p, &centres)).collect();
            if moved == block_of {
                break;
            }
            block_of = moved;
        }
        let mut number_of: Vec<Option<usize>> = vec![None; self.parts];
        let mut next = 0;
        for block in &mut block_of {
            *block = *number_of[*block].get_or_insert_with(|| {
                next += 1;
                next - 1
            });
        }
        ensure!(next == self.parts, "{self}: only {next} clusters have keyframes\n  help: give fewer parts, or another seed");
        Ok(block_of)
    }

    /// What has to be said of them under a table.
    pub fn note(&self) -> String {
        let parts = self.parts;
        let made = match self.by {
            By::Trajectory => format!("{parts} contiguous segments of the trajectory"),
            By::Axis(axis) => format!("{parts} slabs of equally many keyframes along {}", ["x", "y", "z"][axis]),
            By::KMeans { seed } => format!("{parts} clusters of positions (k-means, seed {seed})"),
        };
        let gap = match self.gap {
            Gap::Keyframes(0) => "without a gap".to_owned(),
            Gap::Keyframes(n) => format!("keyframes up to {n} beside the held-out ones took no part"),
            Gap::Metres(m) => format!("keyframes within {m} m of the held-out ones took no part"),
        };
        let folds = match self.fold {
            Some(fold) => format!("the block of fold {fold} was held out alone"),
            None => format!(
                "each was held out once; figures are over the keyframes of all {parts} folds, time and Gaussians means of a fold"
            ),
        };
        let evaluated = if self.validation { "; evaluated on the block behind, the held-out one left out" } else { "" };
        format!("Blocks: {made}, {folds}; {gap}{evaluated}.")
    }
}

impl Gap {
    /// Whether a keyframe may not train where another is evaluated.
    fn holds(self, i: usize, evaluated: usize, positions: &[DVec3]) -> bool {
        match self {
            Self::Keyframes(n) => i.abs_diff(evaluated) <= n,
            Self::Metres(m) => i == evaluated || positions[i].distance(positions[evaluated]) <= m,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn blocks(by: By, parts: usize, gap: Gap) -> Blocks {
        Blocks { by, parts, gap, fold: None, validation: false }
    }

    fn fold(blocks: Blocks, fold: usize, positions: &[DVec3]) -> Result<Fold> {
        Blocks { fold: Some(fold), ..blocks }.fold_of(positions)
    }

    proptest! {
        #[test]
        fn every_keyframe_is_held_out_once_and_nothing_that_trains_is_near(
            raw in prop::collection::vec((-3.0..3.0f64, -3.0..3.0f64, 0.0..2.0f64), 12..60),
            parts in 2usize..6,
            seed in 0u64..100,
            gap_m in 0.0..0.4f64,
            gap_keyframes in 0usize..3,
        ) {
            let positions: Vec<DVec3> = raw.into_iter().map(DVec3::from).collect();
            for (by, gap) in [
                (By::Trajectory, Gap::Keyframes(gap_keyframes)),
                (By::Trajectory, Gap::Metres(gap_m)),
                (By::Axis(1), Gap::Metres(gap_m)),
                (By::KMeans { seed }, Gap::Metres(gap_m)),
            ] {
                let all = blocks(by, parts, gap);
                let mut times = vec![0; positions.len()];
                for n in 1..=parts {
                    // A gap that leaves nothing is refused.
                    let Ok(split) = fold(all, n, &positions) else {
                        all.block_of(&positions).unwrap().iter().enumerate().filter(|(_, b)| **b == n - 1).for_each(|(i, _)| times[i] += 1);
                        continue;
                    };
                    prop_assert!(!split.held_out.is_empty() && split.held_out.is_sorted() && split.train.is_sorted());
                    split.held_out.iter().for_each(|i| times[*i] += 1);
                    for t in &split.train {
                        for h in &split.held_out {
                            prop_assert!(t != h);
                            match gap {
                                Gap::Keyframes(k) => prop_assert!(t.abs_diff(*h) > k),
                                Gap::Metres(m) => prop_assert!(positions[*t].distance(positions[*h]) > m),
                            }
                        }
                    }
                    // Whoever is neither is near.
                    for i in (0..positions.len()).filter(|i| !split.train.contains(i) && !split.held_out.contains(i)) {
                        prop_assert!(split.held_out.iter().any(|h| gap.holds(i, *h, &positions)));
                    }
                }
                prop_assert!(times.iter().all(|n| *n == 1), "{times:?}");
            }
        }

        #[test]
        fn what_is_chosen_on_never_meets_the_test_block(
            raw in prop::collection::vec((-3.0..3.0f64, -3.0..3.0f64), 20..50),
            gap_m in 0.0..0.2f64,
        ) {
            let positions: Vec<DVec3> = raw.into_iter().map(|(x, y)| DVec3::new(x, y, 1.0)).collect();
            for by in [By::Trajectory, By::Axis(0), By::KMeans { seed: 3 }] {
                let all = blocks(by, 4, Gap::Metres(gap_m));
                let mut evaluated = vec![0; positions.len()];
                for n in 1..=4 {
                    let test = all.block_of(&positions).unwrap();
                    let Ok(chosen) = fold(Blocks { validation: true, ..all }, n, &positions) else { return Ok(()) };
                    chosen.held_out.iter().for_each(|i| evaluated[*i] += 1);
                    for i in chosen.train.iter().chain(&chosen.held_out) {
                        prop_assert!(test[*i] != n - 1, "a test keyframe is looked at");
                    }
                    for t in &chosen.train {
                        prop_assert!((0..positions.len()).filter(|i| test[*i] == n - 1).all(|i| positions[i].distance(positions[*t]) > gap_m));
                    }
                }
                prop_assert!(evaluated.iter().all(|n| *n == 1));
            }
        }
    }

    #[test]
    fn blocks_are_what_their_names_say() {
        let along: Vec<DVec3> = (0..10).map(|i| DVec3::new(0.0, ((i * 7) % 10) as f64, 0.0)).collect();
        let whole = |by| blocks(by, 5, Gap::Metres(0.0)).block_of(&along).unwrap();
        assert_eq!(whole(By::Trajectory), [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]);
        assert!(whole(By::Axis(1)).iter().zip(&along).all(|(block, p)| *block == p.y as usize / 2));
        // Three heaps are three clusters, whatever the seed, numbered by who comes first.
        let heaps: Vec<DVec3> = (0..30).map(|i| DVec3::new((i % 3) as f64 * 10.0, (i / 3) as f64 * 0.01, 0.0)).collect();
        for seed in 0..20 {
            let found = blocks(By::KMeans { seed }, 3, Gap::Metres(0.0)).block_of(&heaps).unwrap();
            assert!(found.iter().enumerate().all(|(i, block)| *block == i % 3), "{seed}: {found:?}");
        }
    }

    #[test]
    fn who_stands_still_is_on_one_side() {
        // Keyframes 2 and 3 are at one place, in two blocks: without a gap, neither trains where the other is evaluated.
        let positions = [0.0, 1.0, 2.0, 2.0, 3.0, 4.0].map(|x| DVec3::new(x, 0.0, 0.0));
        let split = fold(blocks(By::Trajectory, 2, Gap::Metres(0.0)), 1, &positions).unwrap();
        assert_eq!((split.train, split.held_out), (vec![4, 5], vec![0, 1, 2]));
    }

    #[test]
    fn what_cannot_be_split_is_refused() {
        let positions = [DVec3::ZERO; 6];
        let said = |b: Blocks, n: usize| fold(b, n, &positions).unwrap_err().to_string();
        assert!(said(blocks(By::KMeans { seed: 0 }, 2, Gap::Metres(0.0)), 1).contains("1 places"));
        assert!(said(blocks(By::Trajectory, 2, Gap::Keyframes(9)), 1).contains("smaller gap"));
        assert!(said(blocks(By::Trajectory, 7, Gap::Keyframes(0)), 1).contains("fewer parts"));
        let unnamed = blocks(By::Trajectory, 2, Gap::Keyframes(0)).fold_of(&positions).unwrap_err().to_string();
        assert!(unnamed.contains("fold=1"), "{unnamed}");
    }
}
