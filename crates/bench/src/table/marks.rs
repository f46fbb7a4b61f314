//! Marks of the best of a column and of those that cannot be told from it.

use crate::metrics::stats::Summary;

/// Mark of a cell within its column.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mark {
    /// Neither of the others.
    #[default]
    None,
    /// The best mean.
    Best,
    /// Its confidence interval overlaps that of the best.
    Near,
}

/// Marks of a column's cells; a column in which fewer than two cells have a number has none, for there is nothing to be better than.
pub fn marks(column: &[Option<Summary>], higher_is_better: bool) -> Vec<Mark> {
    let better = |a: f64, b: f64| if higher_is_better { a > b } else { a < b };
    let best = column.iter().flatten().reduce(|a, b| if better(b.mean, a.mean) { b } else { a });
    let Some(best) = best.filter(|_| column.iter().flatten().count() > 1) else { return vec![Mark::None; column.len()] };
    let mark = |cell: &Option<Summary>| match cell {
        Some(cell) if cell.mean == best.mean => Mark::Best,
        Some(Summary { mean, half_width_95: Some(h), .. }) if overlaps(*mean, *h, best) => Mark::Near,
        _ => Mark::None,
    };
    column.iter().map(mark).collect()
}

fn overlaps(mean: f64, half_width: f64, best: &Summary) -> bool {
    best.half_width_95.is_some_and(|h| (mean - best.mean).abs() <= h + half_width)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(mean: f64, half_width_95: Option<f64>) -> Option<Summary> {
        Some(Summary { n: 3, mean, half_width_95 })
    }

    #[test]
    fn the_best_is_marked_and_what_overlaps_it_more_weakly() {
        let column = [cell(10.0, Some(0.5)), cell(12.0, Some(0.5)), None, cell(11.2, Some(0.4)), cell(12.0, Some(0.1))];
        assert_eq!(marks(&column, true), [Mark::None, Mark::Best, Mark::None, Mark::Near, Mark::Best]);
        assert_eq!(marks(&column, false), [Mark::Best, Mark::None, Mark::None, Mark::None, Mark::None]);
        assert_eq!(marks(&[cell(10.0, Some(0.5)), cell(10.8, Some(0.4))], false), [Mark::Best, Mark::Near]);
    }

    #[test]
    fn without_intervals_there_is_no_second_mark_and_without_rivals_none() {
        assert_eq!(marks(&[cell(1.0, None), cell(1.1, None)], true), [Mark::None, Mark::Best]);
        assert_eq!(marks(&[cell(1.0, None), None], true), [Mark::None, Mark::None]);
        assert!(marks(&[], true).is_empty());
    }
}
