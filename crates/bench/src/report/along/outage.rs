//! Outage along the way: where the best beam is in outage, who says so, and how large the share is for any target.

use super::Way;
use super::canvas::{self, BAD, Cell, FAIR, GOOD, HEAD, INK, OUT, Sample, wrong};
use crate::metrics::outage::LinkRates;
use crate::metrics::rate::TARGET_RATE_BPS_HZ;
use anyhow::Result;
use plotters::prelude::*;

/// Height of the chart of shares.
const CHART: i32 = 280;
/// Outage that free space would not mend.
const FAR: RGBColor = RGBColor(150, 158, 172);

/// What the place allows.
fn place(link: &LinkRates) -> Cell {
    let outage = link.outage();
    let colour = match (outage.best, outage.blocked) {
        (false, _) => GOOD,
        (true, Some(false)) => FAR,
        (true, _) => OUT,
    };
    Cell { colour, word: None }
}

/// What the prediction says of the place, and a cross where the beam it chooses does not do what the best one would.
fn said(link: &LinkRates) -> Cell {
    let outage = link.outage();
    let (colour, ink) = match (outage.best, outage.predicted) {
        (false, false) => (GOOD, INK),
        (true, true) => (OUT, WHITE),
        (true, false) => (BAD, WHITE),
        (false, true) => (FAIR, INK),
    };
    Cell { colour, word: (outage.chosen && !outage.best).then(|| ("×".to_owned(), ink)) }
}

/// The figure.
///
/// # Errors
/// Rates that no axis holds.
pub(super) fn svg(way: &Way) -> Result<String> {
    let rows = way.tracks.len() as i32 + 1;
    let height = HEAD + canvas::ROW * (rows + 6) + canvas::AXIS + CHART + 20;
    let line = format!(
        "In outage: a rate below {TARGET_RATE_BPS_HZ} bit/s/Hz. First row: the best beam as observed; others: what the prediction says of the beam it chooses."
    );
    canvas::figure(height, "Outage at held-out keyframes", &line, |root| {
        let mut cells: Vec<Vec<Cell>> = vec![way.truth.iter().map(place).collect()];
        cells.extend(way.tracks.iter().map(|t| t.stops.iter().map(|stop| said(&stop.1)).collect()));
        let y = |row: i32| HEAD + canvas::ROW * (row + 1) + canvas::ROW / 2;
        canvas::name(root, y(0), "best beam, as observed", Sample::Line(INK))?;
        for (i, track) in way.tracks.iter().enumerate() {
            canvas::name(root, y(i as i32 + 1), &track.label, Sample::Line(canvas::colour(track)))?;
        }
        let end = canvas::strips(root, way, HEAD, &cells, Some(way.axis.name))?;
        let far = way.truth.iter().any(|link| link.outage().best && link.outage().blocked == Some(false));
        let mut entries = vec![
            (GOOD, "no outage, none predicted"),
            (OUT, "outage, predicted"),
            (BAD, "outage, missed"),
            (FAIR, "outage predicted, and none there"),
            (WHITE, "×  chosen beam in outage, the best is not"),
        ];
        if far {
            entries.insert(2, (FAR, "outage in free space as well"));
        }
        let end = canvas::key(root, end + 2, &entries)?;
        canvas::heading(root, end + 10, "share of keyframes at which the chosen beam is in outage, %, by target rate")?;
        shares(way, &canvas::part(root, end + 10 + canvas::ROW, CHART))
    })
}

/// Corners of the share of `rates` below a target, over the target: 0 at 0, 100 % behind the greatest rate.
fn steps(mut rates: Vec<f64>, most: f64) -> Vec<(f64, f64)> {
    rates.sort_by(f64::total_cmp);
    let share = |below: usize| 100.0 * below as f64 / rates.len() as f64;
    let corners = rates.iter().enumerate().flat_map(|(i, rate)| [(*rate, share(i)), (*rate, share(i + 1))]);
    std::iter::once((0.0, 0.0)).chain(corners).chain([(most, 100.0)]).collect()
}

fn shares(way: &Way, area: &canvas::Area<'_>) -> Result<()> {
    let best: Vec<f64> = way.truth.iter().map(|l| l.best_rate_bps_hz).collect();
    let most = 1.03 * best.iter().copied().fold(TARGET_RATE_BPS_HZ, f64::max);
    let mut chart = canvas::chart(area, 0.0..most, 0.0..103.0, Some("target rate, bit/s/Hz"), true)?;
    let target = [(TARGET_RATE_BPS_HZ, 0.0), (TARGET_RATE_BPS_HZ, 103.0)];
    chart.draw_series(DashedLineSeries::new(target, 2, 4, INK.stroke_width(1))).map_err(wrong)?;
    chart.draw_series(LineSeries::new(steps(best, most), INK.stroke_width(5))).map_err(wrong)?;
    for track in way.tracks.iter().rev() {
        let rates = track.stops.iter().map(|stop| stop.1.chosen_rate_bps_hz).collect();
        let style = canvas::colour(track).stroke_width(if track.row == 0 { 3 } else { 2 });
        chart.draw_series(LineSeries::new(steps(rates, most), style)).map_err(wrong)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shares_rise_from_nothing_to_all_and_jump_at_the_rates() {
        let corners = steps(vec![3.0, 1.0, 3.0, 8.0], 8.5);
        assert_eq!((corners[0], *corners.last().unwrap()), ((0.0, 0.0), (8.5, 100.0)));
        assert!(corners.windows(2).all(|pair| pair[0].0 <= pair[1].0 && pair[0].1 <= pair[1].1));
        // Behind each corner the share is that of P[R < target].
        for target in [0.5, 2.0, 5.0, 8.2] {
            let below = [3.0, 1.0, 3.0, 8.0].iter().filter(|rate| **rate < target).count();
            let read = corners.iter().rev().find(|corner| corner.0 <= target).unwrap().1;
            assert_eq!(read, 25.0 * below as f64, "at {target}");
        }
    }
}
