//! Which lobes an `mpc` spectrum may have.

use crate::{Error, Result};
use std::f64::consts::PI;

/// No lobe is narrower, degrees.
const MIN_DEG: f64 = 0.01;
/// No lobe is wider, degrees.
const MAX_DEG: f64 = 90.0;
/// … where diffuse power is shown: it is gathered at full density up to 6.1 degrees around the frame, which is where a lobe of 1 degree has
/// fallen by 80 dB.
const MAX_OF_DIFFUSE_DEG: f64 = 1.0;
/// Directions of diffuse power stand sqrt(4 pi / n) apart; a lobe whose standard deviation is less than this many spacings would show their
/// lattice as dots.
const SPACINGS: f64 = 1.5;
/// The most directions that may be asked for.
pub(super) const MAX_DIRECTIONS: usize = 50_000_000;

/// Checks the width of lobes, and, where they show diffuse power, against the directions in which it is gathered.
pub(super) fn check(lobe_deg: f64, directions: Option<usize>, place: &str) -> Result<()> {
    let fail = |what: String, help: String| Err(Error::invalid(format!("{place}: rf.lobe_width_deg"), what, help));
    if !(MIN_DEG..=MAX_DEG).contains(&lobe_deg) {
        return fail(format!("{lobe_deg}°"), format!("give {MIN_DEG} to {MAX_DEG} degrees; 1 is usual"));
    }
    let Some(directions) = directions else { return Ok(()) };
    if lobe_deg > MAX_OF_DIFFUSE_DEG {
        let what = format!("a lobe of {lobe_deg}° is wider than diffuse power is gathered for around the frame");
        return fail(what, format!("give at most {MAX_OF_DIFFUSE_DEG} degree, or leave diffuse power out"));
    }
    let spacing_deg = (4.0 * PI / directions as f64).sqrt().to_degrees();
    let narrowest_deg = SPACINGS * spacing_deg;
    if lobe_deg >= narrowest_deg {
        return Ok(());
    }
    let what = format!(
        "a lobe of {lobe_deg}° is narrower than {SPACINGS} times the {spacing_deg:.2}° between {directions} directions of diffuse power"
    );
    let mut help = Vec::new();
    let enough = directions_for(lobe_deg);
    if enough <= MAX_DIRECTIONS {
        help.push(format!("at least {enough} directions"));
    }
    if narrowest_deg <= MAX_OF_DIFFUSE_DEG {
        // Rounded up, so that what is offered is accepted.
        help.push(format!("a lobe of {:.3} to {MAX_OF_DIFFUSE_DEG} degree", (narrowest_deg * 1e3).ceil() / 1e3));
    } else if enough > MAX_DIRECTIONS {
        let for_widest = directions_for(MAX_OF_DIFFUSE_DEG);
        help.push(format!("a lobe of {MAX_OF_DIFFUSE_DEG} degree and at least {for_widest} directions"));
    }
    fail(what, format!("give {}", help.join(", or ")))
}

/// The directions that a lobe needs, rounded up to thousands.
fn directions_for(lobe_deg: f64) -> usize {
    (4.0 * PI / (lobe_deg / SPACINGS).to_radians().powi(2) / 1e3).ceil() as usize * 1000
}

#[cfg(test)]
mod tests {
    use super::*;

    fn checked(lobe_deg: f64, directions: usize, diffuse: bool) -> Result<(), String> {
        check(lobe_deg, diffuse.then_some(directions), "d.toml").map_err(|e| e.to_string())
    }

    #[test]
    fn what_the_help_offers_is_accepted() {
        // Too narrow for so many directions: more of them, or a wider lobe.
        let message = checked(0.5, 200_000, true).unwrap_err();
        assert!(message.contains("0.5° is narrower than 1.5 times the 0.45° between 200000 directions"), "{message}");
        assert!(message.contains("at least 372000 directions, or a lobe of 0.682 to 1 degree"), "{message}");
        checked(0.5, 372_000, true).unwrap();
        checked(0.682, 200_000, true).unwrap();
        // So few directions that no lobe fits: more of them alone.
        let message = checked(1.0, 10_000, true).unwrap_err();
        assert!(message.contains("give at least 93000 directions") && !message.contains("a lobe of 3"), "{message}");
        checked(1.0, 93_000, true).unwrap();
        // More directions than may be asked for: a wider lobe alone.
        let message = checked(0.02, 200_000, true).unwrap_err();
        assert!(message.contains("give a lobe of 0.682 to 1 degree") && !message.contains("at least"), "{message}");
    }

    #[test]
    fn a_lobe_too_wide_is_told_so() {
        let message = checked(2.0, 10_000_000, true).unwrap_err();
        assert!(message.contains("wider than") && message.contains("at most 1 degree"), "{message}");
        checked(2.0, 10_000, false).unwrap();
        for lobe_deg in [0.0, -1.0, 1e-9, 1e9, f64::NAN, f64::INFINITY] {
            let message = checked(lobe_deg, 200_000, false).unwrap_err();
            assert!(message.contains("0.01 to 90 degrees"), "{message}");
        }
    }
}
