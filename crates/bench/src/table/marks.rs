//! Marks of the best of a column and of those that cannot be told from it.

use crate::metrics::stats::Summary;

/// Mark of a cell within its column.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Mark {
    /// Neither of the others.
    #[default]
    None,
    /// The best mean, or printed as the best is.
    Best,
    /// Its confidence interval overlaps that of the best.
    Near,
}

/// Marks of a column's cells, as their means are printed with so many digits: what reads the same is equally good. A column has none where nothing can
/// be said of the best: where fewer than two cells have a number, where a mean is of two seeds, and where some means have intervals and others are
/// single runs. Single runs alone have a best, as tables of the literature do.
pub fn marks(column: &[Option<Summary>], digits: usize, higher_is_better: bool) -> Vec<Mark> {
    let cells: Vec<&Summary> = column.iter().flatten().collect();
    let has_interval = |cell: &Summary| cell.half_width_95.is_some();
    let alike = cells.iter().all(|cell| !cell.is_of_two() && has_interval(cell) == has_interval(cells[0]));
    if cells.len() < 2 || !alike {
        return vec![Mark::None; column.len()];
    }
    let best = cells.iter().map(|cell| printed(cell.mean, digits)).reduce(if higher_is_better { f64::max } else { f64::min });
    let is_best = |cell: &Summary| best == Some(printed(cell.mean, digits));
    let mark = |cell: &Option<Summary>| match cell {
        Some(cell) if is_best(cell) => Mark::Best,
        Some(cell) if cells.iter().any(|best| is_best(best) && overlaps(cell, best)) => Mark::Near,
        _ => Mark::None,
    };
    column.iter().map(mark).collect()
}

/// A number as a reader has it from a table.
fn printed(value: f64, digits: usize) -> f64 {
    format!("{value:.digits$}").parse().unwrap_or(value)
}

fn overlaps(a: &Summary, b: &Summary) -> bool {
    a.half_width_95.zip(b.half_width_95).is_some_and(|(h, other)| (a.mean - b.mean).abs() <= h + other)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cell(mean: f64, half_width_95: Option<f64>) -> Option<Summary> {
        Some(Summary { n: if half_width_95.is_some() { 3 } else { 1 }, mean, half_width_95 })
    }

    #[test]
    fn the_best_is_marked_and_what_overlaps_it_more_weakly() {
        let column = [cell(10.0, Some(0.5)), cell(12.0, Some(0.5)), None, cell(11.2, Some(0.4)), cell(12.0, Some(0.1))];
        assert_eq!(marks(&column, 1, true), [Mark::None, Mark::Best, Mark::None, Mark::Near, Mark::Best]);
        assert_eq!(marks(&column, 1, false), [Mark::Best, Mark::None, Mark::None, Mark::None, Mark::None]);
        assert_eq!(marks(&[cell(10.0, Some(0.5)), cell(10.8, Some(0.4))], 1, false), [Mark::Best, Mark::Near]);
    }

    #[test]
    fn what_is_printed_alike_is_marked_alike() {
        let column = [cell(0.01, Some(0.001)), cell(-0.04, Some(0.001)), cell(0.3, Some(0.001))];
        // 0.0, -0.0 and 0.3.
        assert_eq!(marks(&column, 1, false), [Mark::Best, Mark::Best, Mark::None]);
        assert_eq!(marks(&column, 2, false), [Mark::None, Mark::Best, Mark::None]);
        // It overlaps the first of the two that are printed alike alone.
        let column = [cell(1.04, Some(0.05)), cell(0.96, Some(0.0)), cell(1.1, Some(0.02))];
        assert_eq!(marks(&column, 1, false), [Mark::Best, Mark::Best, Mark::Near]);
    }

    #[test]
    fn nothing_is_best_where_means_cannot_be_told_apart_by_the_same_measure() {
        let two = Some(Summary { n: 2, mean: 23.5, half_width_95: None });
        assert_eq!(marks(&[cell(18.2, Some(0.2)), two], 2, true), [Mark::None, Mark::None]);
        assert_eq!(marks(&[two, two], 2, true), [Mark::None, Mark::None]);
        assert_eq!(marks(&[cell(18.2, Some(0.2)), cell(19.0, None)], 2, true), [Mark::None, Mark::None]);
    }

    #[test]
    fn without_intervals_there_is_no_second_mark_and_without_rivals_none() {
        assert_eq!(marks(&[cell(1.0, None), cell(1.1, None)], 1, true), [Mark::None, Mark::Best]);
        assert_eq!(marks(&[cell(1.0, None), None], 1, true), [Mark::None, Mark::None]);
        assert!(marks(&[], 1, true).is_empty());
    }
}
