//! What plans share: ticks of their axes, and lines cut at their frame.

use super::{Canvas, Rgb, TextAnchor, text};
use glam::DVec2;

/// Frame, ticks and names of a plan's axes in metres. `frame` is left, top, right and bottom in pixels, `from` the lower left corner's coordinates, `cap` the
/// height of capitals in pixels.
pub fn metre_axes(canvas: &mut Canvas, frame: [f32; 4], from: DVec2, per_metre: f64, names: [&str; 2], (cap, ink): (f32, Rgb)) {
    let [left, top, right, bottom] = frame;
    for (a, b) in [
        ([left, top], [right, top]),
        ([left, bottom], [right, bottom]),
        ([left, top], [left, bottom]),
        ([right, top], [right, bottom]),
    ] {
        canvas.line(a, b, 1.2, ink);
    }
    let sides_m = [right - left, bottom - top].map(|pixels| f64::from(pixels) / per_metre);
    let step = tick_step(sides_m[0].max(sides_m[1]));
    for (axis, length_m) in sides_m.into_iter().enumerate() {
        for i in (from[axis] / step).ceil() as i64..=((from[axis] + length_m) / step).floor() as i64 {
            let value = i as f64 * step;
            let along = ((value - from[axis]) * per_metre) as f32;
            let label = format!("{}", (value * 1000.0).round() / 1000.0);
            if axis == 0 {
                canvas.line([left + along, bottom], [left + along, bottom + 5.0], 1.2, ink);
                text(canvas, &label, [left + along, bottom + 21.0], TextAnchor::Middle, cap, ink);
            } else {
                canvas.line([left - 5.0, bottom - along], [left, bottom - along], 1.2, ink);
                text(canvas, &label, [left - 10.0, bottom - along + 0.5 * cap], TextAnchor::Right, cap, ink);
            }
        }
    }
    text(canvas, names[0], [0.5 * (left + right), bottom + 44.0], TextAnchor::Middle, cap, ink);
    text(canvas, names[1], [left - 10.0, top - 12.0], TextAnchor::Right, cap, ink);
}

/// 1, 2 or 5 times a power of ten that gives about eight ticks over a length.
fn tick_step(length_m: f64) -> f64 {
    let rough = length_m / 8.0;
    let decade = 10f64.powf(rough.log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * decade).find(|s| *s >= rough).unwrap_or(10.0 * decade)
}

/// The part of a segment inside `[0, size]` (Liang and Barsky 1984).
pub fn clip(a: DVec2, b: DVec2, size: DVec2) -> Option<[DVec2; 2]> {
    let d = b - a;
    let (mut from, mut to) = (0.0f64, 1.0f64);
    for axis in 0..2 {
        for (along, room) in [(-d[axis], a[axis]), (d[axis], size[axis] - a[axis])] {
            if along == 0.0 {
                if room < 0.0 {
                    return None;
                }
            } else if along < 0.0 {
                from = from.max(room / along);
            } else {
                to = to.min(room / along);
            }
        }
    }
    (from <= to).then(|| [a + d * from, a + d * to])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_few() {
        for (length, step) in [(14.0, 2.0), (15.2, 2.0), (100.0, 20.0), (3.0, 0.5), (0.8, 0.1)] {
            assert!((tick_step(length) - step).abs() < 1e-12, "{length}: {}", tick_step(length));
        }
    }

    #[test]
    fn segments_are_cut_at_the_frame() {
        let size = DVec2::new(4.0, 2.0);
        assert_eq!(clip(DVec2::new(-1.0, 1.0), DVec2::new(5.0, 1.0), size), Some([DVec2::new(0.0, 1.0), DVec2::new(4.0, 1.0)]));
        assert_eq!(clip(DVec2::new(-1.0, 3.0), DVec2::new(5.0, 3.0), size), None);
        assert_eq!(clip(DVec2::new(1.0, 1.0), DVec2::new(2.0, 0.5), size), Some([DVec2::new(1.0, 1.0), DVec2::new(2.0, 0.5)]));
    }
}
