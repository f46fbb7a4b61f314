//! The figure of a run's quality over time.

use super::{AxesFrame, INK, PALETTE, Plot, Scale, Stroke, Svg, extent};
use crate::record::CurvePoint;
use anyhow::{Context, Result};

/// Width of the figure, pixels.
const WIDTH: f64 = 760.0;
/// Height of a part with its title, pixels.
const PART: f64 = 230.0;
/// Height of the title and of the axis of time together, pixels.
const ENDS: f64 = 62.0;
/// Radius of a point.
const RADIUS: f64 = 3.5;

/// A quantity over time: what it is, the name of its axis, and how it is read off a point.
type Part = (&'static str, &'static str, fn(&CurvePoint) -> Option<f64>);

/// The parts, from top to bottom.
const PARTS: [Part; 3] = [
    ("held-out PSNR of the spectrum (dB)", "dB", |p| p.held_out?.psnr_rf_scalar),
    ("held-out PSNR of the image", "dB", |p| p.held_out?.psnr_opt),
    ("Gaussians", "count", |p| p.gaussians.map(|g| g as f64)),
];

/// Held-out quality and Gaussians of one run over its seconds, one under the other; parts without a point are left out. `None` without any quality.
///
/// # Errors
/// Values that no axis holds.
pub fn quality(title: &str, curve: &[CurvePoint]) -> Result<Option<String>> {
    let points = |of: fn(&CurvePoint) -> Option<f64>| -> Vec<(f64, f64)> {
        curve.iter().filter_map(|p| Some((p.seconds, of(p)?))).collect()
    };
    let parts: Vec<_> =
        PARTS.iter().map(|(name, axis, of)| (name, axis, points(*of))).filter(|part| !part.2.is_empty()).collect();
    if curve.iter().all(|point| point.held_out.is_none()) {
        return Ok(None);
    }
    let last = curve.last().map_or(0.0, |point| point.seconds);
    let x = Scale::linear(0.0, 1.02 * last.max(1e-3)).context("cannot draw quality over time")?;
    let mut svg = Svg::new(WIDTH as u32, (PART * parts.len() as f64 + ENDS) as u32);
    svg.text((14.0, 20.0), title, 17.0, INK, super::Anchor::Start);
    for (number, (name, axis, points)) in parts.iter().enumerate() {
        let top = 14.0 + PART * number as f64;
        let frame = AxesFrame { left: 84.0, top: top + 56.0, right: WIDTH - 20.0, bottom: top + PART };
        let (low, high) = extent(points.iter().map(|p| p.1));
        let pad = (0.08 * (high - low)).max(1e-3 * high.abs()).max(1e-3);
        let y = Scale::linear(if low >= 0.0 { (low - pad).max(0.0) } else { low - pad }, high + pad)
            .with_context(|| format!("cannot draw {name}"))?;
        let mut plot = Plot::new(&mut svg, frame, x, y);
        plot.title(name);
        plot.y_axis(axis, true);
        plot.x_axis(if number + 1 == parts.len() { "time, s" } else { "" }, true);
        plot.line(points.iter().copied(), Stroke::of(PALETTE[number], 2.0));
        if points.len() < 60 {
            plot.points(points.iter().copied(), RADIUS, PALETTE[number], true);
        }
    }
    Ok(Some(svg.finish()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::HeldOutQuality;

    #[test]
    fn what_was_evaluated_is_drawn_and_without_any_there_is_no_figure() {
        let point = |seconds: f64, psnr: Option<f64>| CurvePoint {
            seconds,
            progress: 0.5,
            gaussians: Some(100),
            held_out: psnr.map(|psnr| HeldOutQuality { psnr_opt: None, psnr_rf_scalar: Some(psnr) }),
        };
        let svg = quality("corf-gs <a>", &[point(1.0, Some(20.0)), point(2.0, None), point(3.0, Some(22.0))]).unwrap().unwrap();
        // Two of quality, three of Gaussians; without light there is no part of it.
        assert_eq!(svg.matches("<circle").count(), 5, "{svg}");
        assert!(svg.contains("corf-gs &lt;a&gt;") && svg.contains(">time, s</text>") && !svg.contains("of the image"), "{svg}");
        assert_eq!(quality("t", &[point(1.0, None)]).unwrap(), None);
        assert!(quality("t", &[point(0.0, Some(20.0))]).unwrap().is_some(), "one point at once is a figure");
    }
}
