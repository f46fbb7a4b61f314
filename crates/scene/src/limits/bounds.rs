//! The physical bounds within which numbers are accepted, and the memory that work may take.
//!
//! A number beyond these is a slip of unit or of a finger; let in, it would come out as infinity, as no number, or not at all.

use crate::keyframe::DbRange;
use crate::{Error, Pinhole, Result};
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
/// Levels of spectra, dB of linear power: single precision holds them with all its bits, and nothing that is received is outside.
pub const LEVEL_DB: RangeInclusive<f64> = -300.0..=300.0;
/// Widths of the decibel range of spectra, dB.
pub const DYNAMIC_RANGE_DB: RangeInclusive<f64> = 1.0..=300.0;
/// Full fields of view of pinholes, degrees: nothing narrower is told apart in an image, and nothing wider fits a plane.
pub const FIELD_OF_VIEW_DEG: RangeInclusive<f64> = 0.01..=179.0;
/// Largest field of view of a side of an image, degrees: that of the long side of one that is a few pixels wide and thousands high.
pub const MOST_OF_A_SIDE_DEG: f64 = 179.99;
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
/// Pixels of an image: 16 384 × 8 192.
pub const MAX_PIXELS: usize = 1 << 27;
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

/// Refuses a decibel range whose ends are outside of [`LEVEL_DB`], or that is not as wide as [`DYNAMIC_RANGE_DB`] says.
///
/// # Errors
/// The end or the width, at its place.
pub fn db_range(place: &str, range: &DbRange) -> Result<()> {
    number(place, range.min_db, &LEVEL_DB, "dB for the lower end")?;
    number(place, range.max_db, &LEVEL_DB, "dB for the upper end")?;
    let DbRange { min_db, max_db } = *range;
    if DYNAMIC_RANGE_DB.contains(&(max_db - min_db)) {
        return Ok(());
    }
    let (least, most) = (DYNAMIC_RANGE_DB.start(), DYNAMIC_RANGE_DB.end());
    Err(Error::invalid(
        place,
        format!("{min_db:?} to {max_db:?} dB is no range"),
        format!("give a lower and an upper end, the one {least} to {most} dB under the other"),
    ))
}

/// Refuses a pinhole without pixels, with a field of view under the least of [`FIELD_OF_VIEW_DEG`] or over [`MOST_OF_A_SIDE_DEG`], or whose axis is
/// further than ten images from its image.
///
/// # Errors
/// The number that is out of range, at its place.
pub fn pinhole(place: &str, camera: &Pinhole) -> Result<()> {
    let pixels = camera.width.checked_mul(camera.height).filter(|n| (1..=MAX_PIXELS).contains(n));
    if pixels.is_none() {
        let what = format!("{}x{} pixels: no camera", camera.width, camera.height);
        return Err(Error::invalid(place, what, format!("give a width and a height, up to {MAX_PIXELS} pixels altogether")));
    }
    let axes = [("fx", camera.fx, "cx", camera.cx, camera.width), ("fy", camera.fy, "cy", camera.cy, camera.height)];
    for (f_name, focal, c_name, centre, side) in axes {
        let side = side as f64;
        // The focal length at which an image as wide as this has a field of view.
        let at = |degrees: f64| 0.5 * side / (0.5 * degrees.to_radians()).tan();
        let range = at(MOST_OF_A_SIDE_DEG)..=at(*FIELD_OF_VIEW_DEG.start());
        let unit = format!(
            "pixels for {f_name}, fields of view of {MOST_OF_A_SIDE_DEG} to {} degrees over the image",
            FIELD_OF_VIEW_DEG.start()
        );
        number(place, focal, &range, &unit)?;
        number(place, centre, &(-10.0 * side..=11.0 * side), &format!("pixels for {c_name}, at most ten images from the image"))?;
    }
    Ok(())
}

/// Focal lengths below which no image of [`WHOLE_IMAGE_PX`] and more has both, pixels: its field of view would be above 150 degrees either way.
const LEAST_FOCAL_PX: f64 = 3.0;
/// Shorter side from which on an image is none of a few pixels, of which everything is small.
const WHOLE_IMAGE_PX: usize = 24;

/// Refuses a principal point that is written in shares of the image's size: both coordinates would be within the first pixel.
///
/// # Errors
/// The principal point, at its place.
pub fn centre_in_pixels(place: &str, camera: &Pinhole) -> Result<()> {
    let Pinhole { width, height, cx, cy, .. } = *camera;
    if !((0.0..=1.0).contains(&cx) && (0.0..=1.0).contains(&cy)) || width.min(height) < WHOLE_IMAGE_PX {
        return Ok(());
    }
    let what =
        format!("its principal point is ({cx}, {cy}) pixels where the image has {width}x{height}, the corner of the image");
    Err(Error::invalid(place, what, IN_PIXELS))
}

const IN_PIXELS: &str = "intrinsics are in pixels: where they are shares of the image's size, multiply fx and cx by the width, fy and cy by the height";

/// Refuses intrinsics that are written as shares of the image's size, as some programs do: both focal lengths would be of some pixel, or the
/// principal point within the first.
///
/// # Errors
/// The focal lengths, at their place.
pub fn in_pixels(place: &str, camera: &Pinhole) -> Result<()> {
    let Pinhole { width, height, fx, fy, .. } = *camera;
    if fx.max(fy) >= LEAST_FOCAL_PX || width.min(height) < WHOLE_IMAGE_PX {
        return centre_in_pixels(place, camera);
    }
    let what = format!("its focal lengths are {fx} and {fy} pixels where the image has {width}x{height}, which no camera has");
    Err(Error::invalid(place, what, IN_PIXELS))
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

/// Depths that a room has in the middle of what a camera sees of it, metres: no camera indoors looks at things that are mostly nearer than a
/// centimetre, or mostly further than the length of a large hall. Metres that were taken for millimetres are below, millimetres and centimetres that
/// were taken for metres above: a room of 2 m to 10 m is 200 to 10 000 there.
pub const MEDIAN_DEPTH_M: RangeInclusive<f32> = 0.01..=100.0;
/// The largest depth that a room has, metres: no building is longer than a kilometre, and no depth sensor sees as far.
pub const MAX_DEPTH_M: f32 = 1000.0;

/// Refuses a depth map that no room has: one whose median is outside of [`MEDIAN_DEPTH_M`], or that has a depth above [`MAX_DEPTH_M`]. Depths that
/// are 0 or not finite are none, and do not count.
///
/// # Errors
/// The median or the largest depth, at its place.
pub fn room_depth(place: &str, depths_m: impl IntoIterator<Item = f32>, help: &str) -> Result<()> {
    let mut depths: Vec<f32> = depths_m.into_iter().filter(|d| d.is_finite() && *d > 0.0).collect();
    if depths.is_empty() {
        return Ok(());
    }
    let middle = depths.len() / 2;
    let (_, median, further) = depths.select_nth_unstable_by(middle, f32::total_cmp);
    let (median, largest) = (*median, further.iter().copied().fold(*median, f32::max));
    let what = if !MEDIAN_DEPTH_M.contains(&median) {
        let (low, high) = (MEDIAN_DEPTH_M.start(), MEDIAN_DEPTH_M.end());
        format!("its median depth is {median} m, which no room has ({low} to {high} m)")
    } else if largest > MAX_DEPTH_M {
        format!("its largest depth is {largest} m, which no room has (up to {MAX_DEPTH_M} m)")
    } else {
        return Ok(());
    };
    Err(Error::invalid(place, what, help))
}

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
    fn ranges_and_cameras_that_nothing_has_are_refused() {
        let range = |min_db, max_db| db_range("r", &DbRange { min_db, max_db }).is_ok();
        assert!(range(-110.0, -40.0) && range(0.0, 1.0) && range(-300.0, 0.0));
        let bad = [
            (-1e300, 0.0),
            (-5000.0, -40.0),
            (f64::NAN, 0.0),
            (0.0, f64::INFINITY),
            (-40.0, -110.0),
            (0.0, 1e-3),
            (-300.0, 300.0),
        ];
        assert!(bad.iter().all(|(min, max)| !range(*min, *max)));
        let fine = Pinhole::from_horizontal_fov(64, 48, 90.0);
        for camera in [
            fine,
            Pinhole { cx: -100.0, ..fine },
            Pinhole::from_horizontal_fov(64, 1, 179.0),
            Pinhole::from_horizontal_fov(8, 8, 0.01),
        ] {
            pinhole("c", &camera).unwrap();
        }
        for (camera, word) in [
            (Pinhole { width: 0, ..fine }, "0x48 pixels"),
            (Pinhole { width: 1 << 20, height: 1 << 20, ..fine }, "pixels: no camera"),
            (Pinhole { fx: 1e300, ..fine }, "1e300 is out of range"),
            (Pinhole { fy: 1e-300, ..fine }, "1e-300 is out of range"),
            (Pinhole { fx: -32.0, ..fine }, "for fx"),
            (Pinhole { cx: f64::NAN, ..fine }, "for cx"),
            (Pinhole { cy: 1e300, ..fine }, "for cy"),
        ] {
            let message = pinhole("c", &camera).unwrap_err().to_string();
            assert!(message.contains(word), "{message}");
        }
    }

    #[test]
    fn intrinsics_in_shares_of_the_image_are_refused() {
        let camera = |fx, fy, width, height| Pinhole { width, height, fx, fy, cx: 0.5, cy: 0.5 };
        for (fx, fy) in [(0.78, 1.04), (1.2, 1.2), (2.5, 2.9)] {
            let message = in_pixels("c", &camera(fx, fy, 640, 480)).unwrap_err().to_string();
            assert!(message.contains("640x480") && message.contains("multiply fx and cx by the width"), "{message}");
        }
        let message = in_pixels("c", &camera(500.0, 500.0, 640, 480)).unwrap_err().to_string();
        assert!(message.contains("principal point is (0.5, 0.5)"), "{message}");
        let in_the_middle = |fx, fy, width, height| Pinhole { cx: 12.0, cy: 12.0, ..camera(fx, fy, width, height) };
        for fine in [in_the_middle(500.0, 500.0, 640, 480), camera(2.0, 2.0, 4, 4), in_the_middle(3.0, 2.0, 24, 24)] {
            in_pixels("c", &fine).unwrap();
        }
    }

    #[test]
    fn depths_that_no_room_has_are_refused() {
        let check = |depths: &[f32]| room_depth("d", depths.iter().copied(), "see").map_err(|e| e.to_string());
        for fine in [[4.0, 0.0, 7.5].as_slice(), &[], &[0.0, f32::NAN, f32::INFINITY], &[0.3, 0.4, 900.0]] {
            assert_eq!(check(fine), Ok(()));
        }
        for (depths, word) in [
            ([0.0, 4000.0, 4000.0].as_slice(), "median depth is 4000 m"),
            (&[150.0, 400.0, 300.0, 0.0], "median depth is 300 m"),
            (&[0.004; 3], "median depth is 0.004 m"),
            (&[4.0, 4.0, 4000.0], "largest depth is 4000 m"),
        ] {
            assert!(check(depths).unwrap_err().contains(word), "{:?}", check(depths));
        }
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
