//! Outage: whether the link behind a beam reaches the rate that is asked of it, and whether the prediction knew.
//!
//! A link is in outage where its rate is below a target, and the outage probability is `P[R < R_target]` (Goldsmith, *Wireless Communications*,
//! sec. 4.2.3; Tse and Viswanath, *Fundamentals of Wireless Communication*, sec. 5.4.1), here with R = log2(1 + SNR) under the link budget of
//! [`rate`](super::rate) and with keyframes of the trajectory as the events. Of every keyframe three rates are kept, and outage follows from them
//! for any target: that of the best beam of the codebook (what the place allows), that of the beam which the prediction chooses (what its user
//! gets), both as observed, and that of the chosen beam as predicted (what its user expects).

use super::rate::{TARGET_RATE_BPS_HZ, spectral_efficiency_bps_hz};
use serde::{Deserialize, Serialize};

/// Beams and rates of one frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct LinkRates {
    /// Number of the beam of the codebook that is best as observed: 8p + q.
    pub best_beam: usize,
    /// Number of the beam that the prediction chooses.
    pub chosen_beam: usize,
    /// Spectral efficiency of the best beam as observed, bit/s/Hz.
    pub best_rate_bps_hz: f64,
    /// Spectral efficiency of the chosen beam as observed, bit/s/Hz.
    pub chosen_rate_bps_hz: f64,
    /// Spectral efficiency of the chosen beam as predicted, bit/s/Hz.
    pub predicted_rate_bps_hz: f64,
    /// Spectral efficiency of a beam steered at the transmitter if nothing but free space lay between, bit/s/Hz; where the transmitter is known.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub free_space_rate_bps_hz: Option<f64>,
}

/// Outage of one frame at a target rate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Outage {
    /// The best beam is in outage: no beam of the codebook serves the place.
    pub best: bool,
    /// … and would not be if nothing but free space lay between; `None` where that is not known.
    pub blocked: Option<bool>,
    /// The chosen beam is in outage.
    pub chosen: bool,
    /// The prediction says that the beam it chooses is in outage.
    pub predicted: bool,
}

impl LinkRates {
    /// The rates of beams of these gains, relative to 1 W transmitted, received by an array of so many elements.
    pub fn new([best_beam, chosen_beam]: [usize; 2], gains: BeamGains, elements: usize) -> Self {
        let rate = |gain: f64| spectral_efficiency_bps_hz(gain, elements);
        Self {
            best_beam,
            chosen_beam,
            best_rate_bps_hz: rate(gains.best),
            chosen_rate_bps_hz: rate(gains.chosen),
            predicted_rate_bps_hz: rate(gains.predicted),
            free_space_rate_bps_hz: gains.free_space.map(rate),
        }
    }

    /// What is in outage at a target rate, bit/s/Hz.
    pub fn outage_at(&self, target_bps_hz: f64) -> Outage {
        let below = |rate: f64| rate < target_bps_hz;
        let best = below(self.best_rate_bps_hz);
        Outage {
            best,
            blocked: self.free_space_rate_bps_hz.map(|free| best && !below(free)),
            chosen: below(self.chosen_rate_bps_hz),
            predicted: below(self.predicted_rate_bps_hz),
        }
    }

    /// What is in outage at the target of the tables.
    pub fn outage(&self) -> Outage {
        self.outage_at(TARGET_RATE_BPS_HZ)
    }
}

/// Gains that rates are made of, relative to 1 W transmitted.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BeamGains {
    /// Of the best beam, as observed.
    pub best: f64,
    /// Of the chosen beam, as observed.
    pub chosen: f64,
    /// Of the chosen beam, as predicted.
    pub predicted: f64,
    /// Of free space; where the transmitter is known.
    pub free_space: Option<f64>,
}

impl Outage {
    /// The best beam is in outage and the prediction says that its own is not.
    pub fn missed(&self) -> bool {
        self.best && !self.predicted
    }

    /// The prediction says that its beam is in outage and the best one is not.
    pub fn false_alarm(&self) -> bool {
        self.predicted && !self.best
    }
}

/// A share of keyframes in per cent, keyframe by keyframe.
pub fn percent(holds: bool) -> f64 {
    if holds { 100.0 } else { 0.0 }
}

/// Rates of two beams, the best one's and the chosen one's, to look at in tests.
#[cfg(test)]
pub(crate) fn rates(best: f64, chosen: f64, predicted: f64, free: Option<f64>) -> LinkRates {
    LinkRates {
        best_beam: 27,
        chosen_beam: 28,
        best_rate_bps_hz: best,
        chosen_rate_bps_hz: chosen,
        predicted_rate_bps_hz: predicted,
        free_space_rate_bps_hz: free,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_are_those_of_the_gains() {
        let gains = BeamGains { best: 4e-9, chosen: 1e-9, predicted: 0.0, free_space: Some(8e-9) };
        let rates = LinkRates::new([3, 5], gains, 64);
        let expected = |gain: f64| spectral_efficiency_bps_hz(gain, 64);
        assert_eq!((rates.best_beam, rates.chosen_beam), (3, 5));
        assert_eq!([rates.best_rate_bps_hz, rates.chosen_rate_bps_hz], [expected(4e-9), expected(1e-9)]);
        assert_eq!((rates.predicted_rate_bps_hz, rates.free_space_rate_bps_hz), (0.0, Some(expected(8e-9))));
    }

    #[test]
    fn nothing_is_ever_in_outage_that_nothing_is_asked_of() {
        let nothing = rates(0.0, 0.0, 0.0, Some(0.0)).outage_at(0.0);
        assert_eq!(nothing, Outage { best: false, blocked: Some(false), chosen: false, predicted: false });
        assert!(!nothing.missed() && !nothing.false_alarm());
    }

    #[test]
    fn a_higher_target_is_missed_wherever_a_lower_one_is() {
        let rates = rates(3.0, 2.0, 2.5, None);
        let at = |target: f64| rates.outage_at(target);
        let targets: Vec<f64> = (0..40).map(|i| 0.1 * f64::from(i)).collect();
        for pair in targets.windows(2) {
            let (low, high) = (at(pair[0]), at(pair[1]));
            assert!(low.best <= high.best && low.chosen <= high.chosen && low.predicted <= high.predicted);
            // The best beam is in outage only where every other is.
            assert!(low.best <= low.chosen);
        }
        // A rate that just reaches the target is enough.
        assert!(!at(2.0).chosen && at(2.0 + 1e-9).chosen && !at(3.0).best && at(3.1).best);
    }

    #[test]
    fn missed_and_false_are_the_two_ways_to_be_wrong_about_a_place() {
        for (best, predicted, missed, false_alarm) in
            [(5.0, 5.0, false, false), (5.0, 0.1, false, true), (0.1, 5.0, true, false), (0.1, 0.1, false, false)]
        {
            let outage = rates(best, best, predicted, None).outage();
            assert_eq!((outage.missed(), outage.false_alarm()), (missed, false_alarm), "{best}, {predicted}");
        }
        // A wrong beam where a right one would do: in outage, and no error about the place.
        let wrong_beam = rates(5.0, 0.1, 5.0, None).outage();
        assert!(wrong_beam.chosen && !wrong_beam.best && !wrong_beam.missed() && !wrong_beam.false_alarm());
    }

    #[test]
    fn an_outage_is_blockage_where_free_space_would_serve() {
        let blocked = |best: f64, free: Option<f64>| rates(best, best, best, free).outage_at(1.0).blocked;
        assert_eq!(blocked(0.5, Some(8.0)), Some(true));
        assert_eq!(blocked(0.5, Some(0.9)), Some(false), "too far for anything");
        assert_eq!(blocked(2.0, Some(8.0)), Some(false), "no outage");
        assert_eq!(blocked(0.5, None), None);
    }
}
