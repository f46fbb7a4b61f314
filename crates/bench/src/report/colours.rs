//! Colours of the pictures: spectra, errors, and the bars that say what the colours mean.

use crate::charts::{ERROR_DB, ERROR_LIGHT, diverging, heat};
use corf_scene::Raster;
use corf_scene::color::{jet, quantize8};
use corf_scene::keyframe::DbRange;

/// A scalar spectrum in Jet colours.
pub(super) fn jet_image(scalar: &Raster<f32>) -> Raster<[u8; 3]> {
    scalar.map(|&s| jet(s).map(quantize8))
}

/// A horizontal colour bar with what it is of; `ticks` from left to right.
fn bar(name: &str, stops: impl Iterator<Item = [u8; 3]>, ticks: &[String]) -> String {
    let colours: Vec<String> = stops.map(|[r, g, b]| format!("rgb({r},{g},{b})")).collect();
    let ticks: String = ticks.iter().map(|t| format!("<span>{t}</span>")).collect();
    format!(
        "<div class=\"bar\"><b>{name}</b><i style=\"background:linear-gradient(to right,{})\"></i><div>{ticks}</div></div>",
        colours.join(",")
    )
}

fn ramp() -> impl Iterator<Item = f32> {
    (0..=32).map(|i| i as f32 / 32.0)
}

/// The bar of spectra.
pub(super) fn jet_bar(range: &DbRange) -> String {
    let ticks: Vec<String> = (0..5).map(|i| format!("{:.0} dB", range.db(i as f32 / 4.0))).collect();
    bar("spectrum", ramp().map(|t| jet(t).map(quantize8)), &ticks)
}

/// The bars of spectra and of both errors.
pub(super) fn bars(range: &DbRange) -> String {
    let share = |t: f32| if t == 0.0 { "0 dB".to_owned() } else { format!("{:+.0} dB", t * ERROR_DB) };
    let decibels = [-1.0, -0.5, 0.0, 0.5, 1.0].map(share);
    let per_cent = [0.0, 0.5, 1.0].map(|t: f32| format!("{:.1} %", 100.0 * t * ERROR_LIGHT));
    format!(
        "<div class=\"bars\">{}{}{}</div>",
        jet_bar(range),
        bar("spectrum, predicted − observed", ramp().map(|t| diverging(2.0 * t - 1.0)), &decibels),
        bar("image, mean absolute error", ramp().map(heat), &per_cent)
    )
}
