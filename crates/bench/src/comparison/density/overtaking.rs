//! The distance from which on a learned row is ahead of copying.

use super::{DensityStep, StepRow};
use crate::metrics::Column;
use crate::metrics::stats::{Summary, summarize};
use serde::Serialize;

/// Name of the better of all lookups, at every step and seed anew.
const COPYING: &str = "copying";

/// A learned row against lookups in one metric.
#[derive(Debug, Serialize)]
pub struct Overtaking {
    /// Key of the metric.
    pub metric: &'static str,
    /// Label of the learned row.
    pub row: String,
    /// `copying`, the better of the lookups at each step, or one lookup's label.
    pub over: String,
    /// One a seed of the row.
    pub seeds: Vec<SeedPlace>,
    /// Mean of the seeds' places, where every seed has one; metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub distance_m: Option<f64>,
    /// Half width of its 95 % interval over three seeds or more; metres.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub half_width_95_m: Option<f64>,
    /// The same in words.
    pub said: String,
}

/// A seed's place.
#[derive(Debug, Serialize)]
pub struct SeedPlace {
    /// The seed.
    pub seed: u64,
    /// Where it overtakes.
    #[serde(flatten)]
    pub place: OvertakingPlace,
}

/// Where a row overtakes a lookup as keyframes get sparser.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(tag = "overtakes", rename_all = "kebab-case")]
pub enum OvertakingPlace {
    /// Ahead at every step.
    Always,
    /// Behind before, ahead at every step behind; between two steps it is interpolated linearly.
    At {
        /// Median distance to the nearest training pose, metres.
        distance_m: f64,
    },
    /// Behind at the sparsest step.
    Never,
    /// A step has no value.
    Unknown,
}

/// All learned rows against copying, and against every lookup where there are several.
pub(super) fn all(steps: &[DensityStep], metrics: &[&'static Column]) -> Vec<Overtaking> {
    let Some(first) = steps.first() else { return Vec::new() };
    let lookups: Vec<&str> = first.rows.iter().filter(|row| row.looks_up).map(|row| row.row.as_str()).collect();
    let mut against: Vec<(String, Vec<&str>)> = vec![(COPYING.to_owned(), lookups.clone())];
    if lookups.len() > 1 {
        against.extend(lookups.iter().map(|label| ((*label).to_owned(), vec![*label])));
    }
    let mut found = Vec::new();
    for metric in metrics {
        for row in first.rows.iter().filter(|row| !row.looks_up) {
            found.extend(against.iter().map(|(name, lookups)| one(steps, metric, row, name, lookups)));
        }
    }
    found
}

fn one(steps: &[DensityStep], metric: &'static Column, row: &StepRow, over: &str, lookups: &[&str]) -> Overtaking {
    let sign = if metric.higher_is_better() == Some(false) { -1.0 } else { 1.0 };
    let ahead = |step: &DensityStep, seed: u64| -> Option<f64> {
        let of = |label: &str| step.rows.iter().find(|r| r.row == label)?.value(metric.key, seed).map(|value| sign * value);
        let copied: Option<Vec<f64>> = lookups.iter().map(|label| of(label)).collect();
        Some(of(&row.row)? - copied?.into_iter().fold(f64::NEG_INFINITY, f64::max))
    };
    let of_seed = |seed: u64| {
        let points: Option<Vec<(f64, f64)>> =
            steps.iter().map(|step| Some((step.nearest_training_m, ahead(step, seed)?))).collect();
        SeedPlace { seed, place: points.map_or(OvertakingPlace::Unknown, |points| place(&points)) }
    };
    let seeds: Vec<SeedPlace> = row.seeds.iter().map(|s| of_seed(s.seed)).collect();
    let places: Option<Vec<f64>> =
        seeds.iter().map(|s| if let OvertakingPlace::At { distance_m } = s.place { Some(distance_m) } else { None }).collect();
    let summary = places.and_then(|places| summarize(&places));
    Overtaking {
        metric: metric.key,
        row: row.row.clone(),
        over: over.to_owned(),
        said: said(steps, &seeds, summary),
        seeds,
        distance_m: summary.map(|s| s.mean),
        half_width_95_m: summary.and_then(|s| s.half_width_95),
    }
}

/// The place in a row of distances with how far the row is ahead there.
fn place(points: &[(f64, f64)]) -> OvertakingPlace {
    let Some(behind) = points.iter().rposition(|(_, ahead)| *ahead <= 0.0) else { return OvertakingPlace::Always };
    match points.get(behind + 1) {
        None => OvertakingPlace::Never,
        Some((to_m, to)) => {
            let (from_m, from) = points[behind];
            OvertakingPlace::At { distance_m: from_m + (to_m - from_m) * from / (from - to) }
        }
    }
}

fn said(steps: &[DensityStep], seeds: &[SeedPlace], summary: Option<Summary>) -> String {
    let ends = [steps.first(), steps.last()].map(|step| step.map_or(0.0, |s| s.nearest_training_m));
    let range = format!("{:.3} to {:.3} m", ends[0], ends[1]);
    let count = |wanted: fn(&OvertakingPlace) -> bool| seeds.iter().filter(|s| wanted(&s.place)).count();
    let n = seeds.len();
    if let Some(Summary { mean, half_width_95, .. }) = summary {
        return match (half_width_95, n) {
            (Some(half), _) => format!("overtakes at {mean:.3} ± {half:.3} m ({n} seeds)"),
            (None, 1) => format!("overtakes at {mean:.3} m (one seed: no interval)"),
            (None, _) => format!("overtakes at {mean:.3} m ({n} seeds: too few for an interval)"),
        };
    }
    let [always, never, unknown] = [
        count(|p| *p == OvertakingPlace::Always),
        count(|p| *p == OvertakingPlace::Never),
        count(|p| *p == OvertakingPlace::Unknown),
    ];
    match n {
        _ if never == n => format!("does not overtake within {range}"),
        _ if always == n => format!("is ahead at every step, {range}"),
        _ => {
            let at: Vec<String> = seeds
                .iter()
                .filter_map(|s| {
                    if let OvertakingPlace::At { distance_m } = s.place { Some(format!("{distance_m:.3} m")) } else { None }
                })
                .collect();
            let mut parts = Vec::new();
            if !at.is_empty() {
                parts.push(format!("overtakes at {} in {} of {n} seeds", at.join(", "), at.len()));
            }
            for (count, what) in
                [(always, "is ahead at every step"), (never, "does not overtake"), (unknown, "lacks a finished step")]
            {
                if count > 0 {
                    parts.push(format!("{what} in {count} of {n} seeds"));
                }
            }
            format!("{}, within {range}", parts.join(", "))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::StepSeed;
    use super::*;
    use crate::metrics::COLUMNS;

    fn metric(key: &str) -> &'static Column {
        COLUMNS.iter().find(|c| c.key == key).unwrap()
    }

    /// Steps at 1, 2 and 4 m; a learned row and two lookups, by seed.
    fn steps(learned: [[Option<f64>; 3]; 3], near: [f64; 3], blend: [f64; 3]) -> Vec<DensityStep> {
        let row = |name: &str, looks_up: bool, of: &dyn Fn(usize) -> Option<f64>| StepRow {
            row: name.to_owned(),
            method: String::new(),
            looks_up,
            seeds: (0..3)
                .map(|seed| StepSeed {
                    seed: seed as u64,
                    values: of(seed).iter().flat_map(|value| [("psnr_opt", *value), ("rmse_db", *value)]).collect(),
                })
                .collect(),
        };
        (0..3)
            .map(|i| DensityStep {
                spacing: 1 << i,
                train_keyframes: 8.0,
                nearest_training_m: f64::from(1 << i),
                nearest_training_p10_p90_m: [0.0; 2],
                rows: vec![
                    row("field", false, &|seed| learned[seed][i]),
                    row("near", true, &|_| Some(near[i])),
                    row("blend", true, &|_| Some(blend[i])),
                ],
            })
            .collect()
    }

    #[test]
    fn the_place_is_interpolated_between_the_last_step_behind_and_the_next() {
        let row = [20.0, 20.0, 20.0].map(Some);
        let steps = steps([row; 3], [24.0, 21.0, 10.0], [25.0, 22.0, 16.0]);
        let found = all(&steps, &[metric("psnr_opt")]);
        let of = |over: &str| found.iter().find(|o| o.over == over).unwrap();
        // Behind the better one by 2 at 2 m, ahead by 4 at 4 m.
        let copying = of("copying").distance_m.unwrap();
        assert!((copying - (2.0 + 2.0 * 2.0 / 6.0)).abs() < 1e-12 && of("copying").half_width_95_m == Some(0.0));
        assert!(of("near").distance_m.unwrap() < copying, "{}", of("near").said);
        assert_eq!(found.len(), 3);
    }

    #[test]
    fn a_row_that_stays_behind_does_not_overtake_and_a_lower_error_is_ahead() {
        let flat = |v: f64| [Some(v); 3];
        let behind = steps([flat(9.0); 3], [10.0; 3], [9.5; 3]);
        let by = |key: &str| all(&behind, &[metric(key)]).remove(0);
        assert_eq!(by("psnr_opt").said, "does not overtake within 1.000 to 4.000 m");
        assert_eq!(by("rmse_db").said, "is ahead at every step, 1.000 to 4.000 m");
        assert!(by("psnr_opt").seeds.iter().all(|s| s.place == OvertakingPlace::Never) && by("psnr_opt").distance_m.is_none());
    }

    #[test]
    fn seeds_that_disagree_or_failed_are_counted_and_not_averaged() {
        let mixed = [[Some(9.0), Some(9.0), Some(11.0)], [Some(9.0); 3], [Some(9.0), None, Some(11.0)]];
        let found = all(&steps(mixed, [10.0; 3], [0.0; 3]), &[metric("psnr_opt")]).remove(0);
        assert!(found.distance_m.is_none());
        for part in ["overtakes at 3.000 m in 1 of 3", "does not overtake in 1 of 3", "lacks a finished step in 1 of 3"] {
            assert!(found.said.contains(part), "{}", found.said);
        }
        // Ahead, behind and ahead again: the last time counts.
        assert_eq!(place(&[(1.0, 5.0), (2.0, -1.0), (4.0, 1.0)]), OvertakingPlace::At { distance_m: 3.0 });
        // Even is not ahead.
        assert_eq!(place(&[(1.0, 0.0), (2.0, 0.0)]), OvertakingPlace::Never);
    }
}
