//! Colours of the pictures: spectra, errors, and the bars that say what the colours mean.

use crate::record::predictions::{shrunk_image, shrunk_scalar};
use corf_scene::Raster;
use corf_scene::color::{jet, quantize8};
use corf_scene::keyframe::DbRange;

/// Full scale of the spectrum's error map, dB.
pub(crate) const ERROR_DB: f32 = 20.0;
/// Full scale of the image's error map, share of full scale.
pub(crate) const ERROR_LIGHT: f32 = 0.25;

/// A scalar spectrum in Jet colours.
pub(super) fn jet_image(scalar: &Raster<f32>) -> Raster<[u8; 3]> {
    scalar.map(|&s| jet(s).map(quantize8))
}

/// Blue (too low) – white – red (too high), `t` in `[−1, 1]`.
fn diverging(t: f32) -> [u8; 3] {
    let t = t.clamp(-1.0, 1.0);
    let end = if t < 0.0 { [0.13, 0.30, 0.75] } else { [0.78, 0.12, 0.14] };
    end.map(|e: f32| quantize8(1.0 + t.abs() * (e - 1.0)))
}

/// Black – violet – orange – white, `t` in `[0, 1]`.
pub(crate) fn heat(t: f32) -> [u8; 3] {
    let t = t.clamp(0.0, 1.0);
    [
        quantize8(1.8 * t),
        quantize8(1.6 * t * t),
        quantize8(if t < 0.4 { 1.4 * t } else { 0.56 - 0.93 * (t - 0.4) + 1.7 * (t - 0.4).powi(2) }),
    ]
}

/// Mean absolute error over the channels, in colours; both pictures are shrunk to the narrower one first.
pub(crate) fn image_error(observed: &Raster<[u8; 3]>, predicted: &Raster<[u8; 3]>) -> Raster<[u8; 3]> {
    let columns = observed.width().min(predicted.width());
    let (a, b) = (shrunk_image(observed, columns), shrunk_image(predicted, columns));
    Raster::from_fn(columns, a.height().min(b.height()), |x, y| {
        let (a, b) = (a[(x, y)], b[(x, y)]);
        let mean = (0..3).map(|c| (f32::from(a[c]) - f32::from(b[c])).abs()).sum::<f32>() / (3.0 * 255.0);
        heat(mean / ERROR_LIGHT)
    })
}

/// Predicted minus observed in decibels, in colours; both are shrunk to the narrower one first.
pub(super) fn spectrum_error(observed: &Raster<f32>, predicted: &Raster<f32>, range: &DbRange) -> Raster<[u8; 3]> {
    let span_db = (range.max_db - range.min_db) as f32;
    let columns = observed.width().min(predicted.width());
    let (a, b) = (shrunk_scalar(observed, columns), shrunk_scalar(predicted, columns));
    Raster::from_fn(columns, a.height().min(b.height()), |x, y| diverging((b[(x, y)] - a[(x, y)]) * span_db / ERROR_DB))
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
