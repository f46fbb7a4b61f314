//! Outage along the way: where the best beam is in outage, who says so, and how large the share is for any target.

use super::Way;
use super::canvas::{self, BAD, Cell, FAIR, GOOD, HEAD, OUT, Sample};
use crate::charts::{Colour, INK, Stroke, Svg, WHITE};
use crate::metrics::outage::LinkRates;
use crate::metrics::rate::TARGET_RATE_BPS_HZ;
use anyhow::Result;

/// Height of the chart of shares.
const CHART: f64 = 280.0;
/// Outage that free space would not mend.
const FAR: Colour = [150, 158, 172];

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
    let line = format!(
        "In outage: a rate below {TARGET_RATE_BPS_HZ} bit/s/Hz. First row: the best beam as observed; others: what the prediction says of the beam it chooses."
    );
    canvas::figure("Outage at held-out keyframes", &line, |svg| {
        let mut cells: Vec<Vec<Cell>> = vec![way.truth.iter().map(place).collect()];
        cells.extend(way.tracks.iter().map(|t| t.stops.iter().map(|stop| said(&stop.1)).collect()));
        let observed = Sample::Line(Stroke::of(INK, 4.0));
        canvas::name(svg, HEAD + 1.5 * canvas::ROW, "best beam, as observed", observed);
        canvas::names(svg, way, HEAD + 2.0 * canvas::ROW);
        let end = canvas::strips(svg, way, HEAD, &cells, Some(way.axis.name))?;
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
        let end = canvas::key(svg, end + 2.0, &entries);
        canvas::heading(svg, end + 10.0, "share of keyframes at which the chosen beam is in outage, %, by target rate");
        let top = end + 10.0 + canvas::ROW;
        shares(way, svg, top)?;
        Ok(top + CHART)
    })
}

/// Corners of the share of `rates` below a target, over the target: 0 at 0, 100 % behind the greatest rate.
fn steps(mut rates: Vec<f64>, most: f64) -> Vec<(f64, f64)> {
    rates.sort_by(f64::total_cmp);
    let share = |below: usize| 100.0 * below as f64 / rates.len() as f64;
    let corners = rates.iter().enumerate().flat_map(|(i, rate)| [(*rate, share(i)), (*rate, share(i + 1))]);
    std::iter::once((0.0, 0.0)).chain(corners).chain([(most, 100.0)]).collect()
}

fn shares(way: &Way, svg: &mut Svg, top: f64) -> Result<()> {
    let best: Vec<f64> = way.truth.iter().map(|l| l.best_rate_bps_hz).collect();
    let most = 1.03 * best.iter().copied().fold(TARGET_RATE_BPS_HZ, f64::max);
    let mut plot = canvas::chart(svg, (top, CHART), 0.0..most, 0.0..103.0, "target rate, bit/s/Hz")?;
    let target = Stroke { colour: INK, width: 1.0, dash: Some(3.0) };
    plot.line([(TARGET_RATE_BPS_HZ, 0.0), (TARGET_RATE_BPS_HZ, 103.0)], target);
    plot.line(steps(best, most), Stroke::of(INK, 5.0));
    for track in way.tracks.iter().rev() {
        let rates = track.stops.iter().map(|stop| stop.1.chosen_rate_bps_hz).collect();
        plot.line(steps(rates, most), Stroke::of(canvas::colour(track), canvas::width(track)));
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
