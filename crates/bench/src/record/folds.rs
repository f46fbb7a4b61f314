//! Folds of blocks taken together: of one row and seed, the held-out keyframes of all folds as one set.

use super::{Numbers, Outcome, Record};
use crate::split::Protocol;
use std::borrow::Cow;

/// The records of one cell: one, or one for each fold.
pub struct Cells<'a> {
    /// In order of the folds; never empty.
    pub of: Vec<&'a Record>,
}

/// What became of them.
#[expect(clippy::large_enum_variant, reason = "one for each row of a table")]
pub enum Together<'a> {
    /// All are finished: the held-out keyframes of all, in the order of the trajectory; seconds and Gaussians are means over the folds, memory is the
    /// largest, and the curve is that of the first.
    Done(Cow<'a, Numbers>),
    /// One has failed or is missing.
    Failed(Cow<'a, str>),
}

/// Records by cell, in order of appearance; records of one and the same fold stand for themselves.
pub fn cells(records: &[Record]) -> Vec<Cells<'_>> {
    let alone = records.iter().all(|record| record.split == records[0].split);
    let mut cells: Vec<Cells<'_>> = Vec::new();
    for record in records {
        let is_same = |other: &Record| {
            !alone
                && record.split.fold().is_some()
                && (&other.row, other.seed, other.split.of_all_folds()) == (&record.row, record.seed, record.split.of_all_folds())
        };
        match cells.iter_mut().find(|cell| is_same(cell.of[0])) {
            Some(cell) => cell.of.push(record),
            None => cells.push(Cells { of: vec![record] }),
        }
    }
    cells.iter_mut().for_each(|cell| cell.of.sort_by_key(|record| record.split.fold()));
    cells
}

/// The records with those of folds taken together.
pub fn together(records: &[Record]) -> Cow<'_, [Record]> {
    let cells = cells(records);
    if cells.iter().all(|cell| !cell.is_of_folds(records)) {
        return Cow::Borrowed(records);
    }
    let one = |cell: &Cells<'_>| {
        let outcome = match cell.outcome(records) {
            Together::Done(numbers) => Outcome::Done(Box::new(numbers.into_owned())),
            Together::Failed(error) => Outcome::Failed { error: error.into_owned() },
        };
        Record { split: cell.split(records), outcome, cell: None, ..cell.of[0].clone() }
    };
    Cow::Owned(cells.iter().map(one).collect())
}

impl<'a> Cells<'a> {
    /// Whether all folds of a protocol are meant, some of `records`, the table's.
    fn is_of_folds(&self, records: &[Record]) -> bool {
        self.of[0].split.fold().is_some() && records.iter().any(|record| record.split != self.of[0].split)
    }

    /// The protocol: of all folds where they are taken together.
    pub fn split(&self, records: &[Record]) -> Protocol {
        let split = self.of[0].split;
        if self.is_of_folds(records) { split.of_all_folds() } else { split }
    }

    /// What became of the cell, one of those of `records`.
    pub fn outcome(&self, records: &[Record]) -> Together<'a> {
        let first = self.of[0];
        if !self.is_of_folds(records) {
            return match &first.outcome {
                Outcome::Done(numbers) => Together::Done(Cow::Borrowed(numbers)),
                Outcome::Failed { error } => Together::Failed(Cow::Borrowed(error)),
            };
        }
        let there = |fold: &Protocol| self.of.iter().any(|record| record.split == *fold);
        let missing: Vec<String> = first.split.of_all_folds().folds().iter().filter(|fold| !there(fold)).map(number).collect();
        if !missing.is_empty() {
            return Together::Failed(format!("no record of fold {}", missing.join(", ")).into());
        }
        if let Some(other) = self.of.iter().find(|record| record.device != first.device) {
            return Together::Failed(format!("its folds ran on {} and on {}", first.device, other.device).into());
        }
        let mut finished: Vec<&Numbers> = Vec::new();
        for record in &self.of {
            match &record.outcome {
                Outcome::Done(numbers) => finished.push(numbers),
                Outcome::Failed { error } => return Together::Failed(format!("fold {}: {error}", number(&record.split)).into()),
            }
        }
        Together::Done(Cow::Owned(joined(&finished)))
    }
}

fn number(fold: &Protocol) -> String {
    fold.fold().unwrap_or_default().to_string()
}

fn joined(folds: &[&Numbers]) -> Numbers {
    let mean = |of: &dyn Fn(&Numbers) -> Option<f64>| -> Option<f64> {
        let values: Option<Vec<f64>> = folds.iter().map(|numbers| of(numbers)).collect();
        values.map(|values| values.iter().sum::<f64>() / values.len() as f64)
    };
    let mut frames: Vec<_> = folds.iter().flat_map(|numbers| numbers.frames.iter().cloned()).collect();
    frames.sort_by_key(|frame| frame.index);
    Numbers::of(
        frames,
        mean(&|numbers| numbers.seconds),
        mean(&|numbers| numbers.gaussians.map(|count| count as f64)).map(|count| count.round() as usize),
        folds.iter().filter_map(|numbers| numbers.peak_memory_bytes).max(),
        folds[0].curve.clone(),
        None,
    )
    .with_device_memory(folds.iter().filter_map(|numbers| numbers.peak_device_memory_bytes).max())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::tests::done;

    fn of_fold(row: &str, seed: u64, fold: usize, index: usize, psnr_opt: f64) -> Record {
        let mut record = done(row, seed);
        record.split = format!("trajectory:parts=3,gap_keyframes=1,fold={fold}").parse().unwrap();
        let Outcome::Done(numbers) = &mut record.outcome else { unreachable!() };
        let mut frame = numbers.frames[0].clone();
        frame.index = index;
        frame.light.as_mut().unwrap().psnr_opt = psnr_opt;
        **numbers = Numbers::of(vec![frame], Some(10.0 * fold as f64), Some(fold), None, Vec::new(), None);
        record
    }

    #[test]
    fn folds_of_a_seed_are_one_cell_over_all_their_keyframes() {
        let mut records: Vec<Record> =
            [3, 1, 2].iter().map(|fold| of_fold("a", 1, *fold, 3 - fold, 10.0 * *fold as f64)).collect();
        records.extend((1..=3).map(|fold| of_fold("a", 2, fold, 3 - fold, 50.0)));
        let whole = together(&records);
        assert_eq!(whole.len(), 2);
        let Outcome::Done(numbers) = &whole[0].outcome else { panic!("{:?}", whole[0]) };
        assert_eq!(numbers.frames.iter().map(|frame| frame.index).collect::<Vec<_>>(), [0, 1, 2]);
        assert_eq!((numbers.value_of("psnr_opt"), numbers.seconds, numbers.gaussians), (Some(20.0), Some(20.0), Some(2)));
        assert_eq!((whole[0].split.fold(), whole[0].seed, whole[1].seed), (None, 1, 2));
        // Taken together once more they are the same.
        assert!(matches!(together(&whole), Cow::Borrowed(_)));
    }

    #[test]
    fn part_of_the_folds_is_no_mean() {
        let mut records = vec![of_fold("a", 1, 1, 0, 20.0), of_fold("a", 1, 3, 2, 20.0)];
        let error = |records: &[Record]| match &together(records)[0].outcome {
            Outcome::Failed { error } => error.clone(),
            Outcome::Done(_) => panic!("numbers of some folds"),
        };
        assert!(error(&records).contains("no record of fold 2"));
        records.push(of_fold("a", 1, 2, 1, 20.0));
        records[2].outcome = Outcome::Failed { error: "out of memory".to_owned() };
        assert_eq!(error(&records), "fold 2: out of memory");
        // A fold by itself is what it is.
        assert!(matches!(together(&records[..1]), Cow::Borrowed(_)));
    }
}
