//! The physical bounds within which numbers are accepted, and the memory that work may take.
//!
//! A number beyond these is a slip of unit or of a finger; let in, it would come out as infinity, as no number, or not at all.

use crate::{Error, Result};
use glam::DVec3;
use std::ops::RangeInclusive;

/// The largest coordinate of anything, metres: at 1000 km single precision has steps of 6 cm.
pub const MAX_COORDINATE_M: f64 = 1e6;
/// Carrier frequencies, Hz.
pub const FREQUENCY_HZ: RangeInclusive<f64> = 1e6..=1e13;
/// Transmit powers, dBm.
pub const POWER_DBM: RangeInclusive<f64> = -300.0..=300.0;
/// Gains, dB.
pub const GAIN_DB: RangeInclusive<f64> = -1000.0..=1000.0;
/// Exposures, EV.
pub const EXPOSURE_EV: RangeInclusive<f64> = -64.0..=64.0;
/// Angles of orientations, degrees: a hundred turns.
pub const ANGLE_DEG: RangeInclusive<f64> = -36_000.0..=36_000.0;
/// Spacings of an array's elements, wavelengths.
pub const SPACING_WAVELENGTHS: RangeInclusive<f64> = 1e-6..=1e4;
/// The largest radiance, W/(m²·sr), or luminous intensity of a light: the sun's disc has 2e7.
pub const MAX_EMISSION: f32 = 1e9;
/// Threads.
pub const MAX_THREADS: u64 = 1024;
/// Keyframes of a dataset.
pub const MAX_KEYFRAMES: usize = 100_000;
/// Links between transmitters and receivers in one run.
pub const MAX_LINKS: usize = 1_000_000;
/// Rays or photons.
pub const MAX_RAYS: usize = 100_000_000;
/// Light paths a pixel.
pub const MAX_SAMPLES_PER_PIXEL: u32 = 65_536;
/// Bounces of a light path.
pub const MAX_BOUNCES: u32 = 1024;

/// Refuses a number outside of a range; `unit` is what one is to give.
///
/// # Errors
/// The number, at its place, with the range.
pub fn number(place: &str, value: f64, range: &RangeInclusive<f64>, unit: &str) -> Result<()> {
    if range.contains(&value) {
        return Ok(());
    }
    Err(Error::invalid(
        place,
        format!("{value:?} is out of range"),
        format!("give {:?} to {:?} {unit}", range.start(), range.end()),
    ))
}

/// Refuses a count above a limit.
///
/// # Errors
/// The count, at its place, with the limit.
pub fn count(place: &str, value: usize, most: usize, what: &str) -> Result<()> {
    if value <= most {
        return Ok(());
    }
    Err(Error::invalid(place, format!("{value} {what}"), format!("give at most {most}")))
}

/// Refuses a point that is not finite or further than [`MAX_COORDINATE_M`] from the origin along an axis.
///
/// # Errors
/// The point, at its place.
pub fn position(place: &str, point: DVec3) -> Result<()> {
    if !point.is_finite() {
        return Err(Error::invalid(place, format!("position is {point}"), "give three finite coordinates in metres"));
    }
    if point.abs().max_element() > MAX_COORDINATE_M {
        let [x, y, z] = point.to_array();
        let what = format!("position is [{x:?}, {y:?}, {z:?}]");
        return Err(Error::invalid(place, what, "coordinates are in metres, at most 1e6 from the origin"));
    }
    Ok(())
}

/// Refuses work that would take more memory than is available; `what` names the work in the message, `reduce` says how to need less.
///
/// # Errors
/// `bytes` exceeds the available memory; the message gives both.
pub fn memory(place: &str, what: &str, bytes: f64, reduce: &str) -> Result<()> {
    memory_within(place, what, bytes, available_bytes(), reduce)
}

fn memory_within(place: &str, what: &str, bytes: f64, limit: f64, reduce: &str) -> Result<()> {
    if bytes <= limit {
        return Ok(());
    }
    let gigabytes = |bytes: f64| if bytes < 1e13 { format!("{:.1} GB", bytes / 1e9) } else { format!("{:.1e} GB", bytes / 1e9) };
    let what = format!("{what} would take {}, more than the {} there are", gigabytes(bytes), gigabytes(limit));
    Err(Error::invalid(place, what, reduce))
}

/// Available memory assumed on systems that do not report it, bytes.
const UNKNOWN_BYTES: f64 = 8e9;

/// The memory that can still be taken, bytes: what Linux calls available, within the limit of the container.
pub fn available_bytes() -> f64 {
    let system = std::fs::read_to_string("/proc/meminfo").ok().and_then(|text| {
        let line = text.lines().find_map(|line| line.strip_prefix("MemAvailable:"))?;
        Some(1024.0 * line.split_whitespace().next()?.parse::<f64>().ok()?)
    });
    let number = |path: &str| std::fs::read_to_string(path).ok()?.trim().parse::<f64>().ok();
    let container = number("/sys/fs/cgroup/memory.max").map(|max| max - number("/sys/fs/cgroup/memory.current").unwrap_or(0.0));
    [system, container].into_iter().flatten().reduce(f64::min).unwrap_or(UNKNOWN_BYTES).max(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_out_of_bounds_is_said_with_the_bounds() {
        number("t: x", 1.0, &(0.0..=1.0), "dB").unwrap();
        for value in [f64::NAN, f64::INFINITY, -1e300] {
            let message = number("t: x", value, &(0.0..=1.0), "dB").unwrap_err().to_string();
            assert!(message.contains("t: x") && message.contains("0.0 to 1.0 dB"), "{message}");
        }
        // 1e300 in words, not in three hundred digits.
        let message = number("t: x", 1e300, &GAIN_DB, "dB").unwrap_err().to_string();
        assert!(message.contains("1e300 is out of range"), "{message}");
        position("rx", DVec3::splat(-1e6)).unwrap();
        assert!(position("rx", DVec3::new(0.0, 1e308, 0.0)).unwrap_err().to_string().contains("1e308"));
        assert!(position("rx", DVec3::new(0.0, f64::NAN, 0.0)).is_err());
        assert!(count("t: n", 5, 4, "rays").unwrap_err().to_string().contains("5 rays"));
    }

    #[test]
    fn memory_is_compared_and_put_into_words() {
        memory_within("t", "an image", 1e9, 2e9, "").unwrap();
        let message = memory_within("t", "an image", 3.44e9, 2e9, "make it smaller").unwrap_err().to_string();
        assert!(message.contains("an image would take 3.4 GB, more than the 2.0 GB there are"), "{message}");
        assert!(memory("t", "all", 1e30, "take less").unwrap_err().to_string().contains("1.0e21 GB"));
        assert!(available_bytes() > 1e6);
    }
}
