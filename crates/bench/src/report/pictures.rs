//! Truth, prediction and error beside each other, with one shared colour bar.

use super::{Report, kept, row_folder};
use crate::escape::html as escape;
use crate::predictions::{self, Kept};
use anyhow::Result;
use base64::Engine;
use corf_scene::color::{jet, quantize8};
use corf_scene::io::encode_png;
use corf_scene::keyframe::DbRange;
use corf_scene::{Keyframe, Raster};
use std::fmt::Write;

/// Full scale of the spectrum's error map, dB.
const ERROR_DB: f32 = 20.0;
/// Full scale of the image's error map, share of full scale.
const ERROR_OPTICAL: f32 = 0.25;

/// An image as a data URI.
pub(super) fn data_uri(image: &Raster<[u8; 3]>) -> Result<String> {
    Ok(format!("data:image/png;base64,{}", base64::engine::general_purpose::STANDARD.encode(encode_png(image)?)))
}

fn figure(image: &Raster<[u8; 3]>, caption: &str) -> Result<String> {
    Ok(format!("<figure><img alt=\"{0}\" src=\"{1}\"><figcaption>{0}</figcaption></figure>", escape(caption), data_uri(image)?))
}

fn jet_image(scalar: &Raster<f32>) -> Raster<[u8; 3]> {
    scalar.map(|&s| jet(s).map(quantize8))
}

/// Blue (too low) – white – red (too high), `t` in `[−1, 1]`.
fn diverging(t: f32) -> [u8; 3] {
    let t = t.clamp(-1.0, 1.0);
    let end = if t < 0.0 { [0.13, 0.30, 0.75] } else { [0.78, 0.12, 0.14] };
    end.map(|e: f32| quantize8(1.0 + t.abs() * (e - 1.0)))
}

/// Black – violet – orange – white, `t` in `[0, 1]`.
fn heat(t: f32) -> [u8; 3] {
    let t = t.clamp(0.0, 1.0);
    [
        quantize8(1.8 * t),
        quantize8(1.6 * t * t),
        quantize8(if t < 0.4 { 1.4 * t } else { 0.56 - 0.93 * (t - 0.4) + 1.7 * (t - 0.4).powi(2) }),
    ]
}

/// A vertical colour bar; `ticks` from top to bottom.
fn bar(stops: impl Iterator<Item = [u8; 3]>, ticks: &[String]) -> String {
    let colours: Vec<String> = stops.map(|[r, g, b]| format!("rgb({r},{g},{b})")).collect();
    let ticks: String = ticks.iter().map(|t| format!("<b style=\"font-weight:400\">{t}</b>")).collect();
    format!(
        "<div class=\"bar\"><i style=\"background:linear-gradient(to top,{})\"></i><span>{ticks}</span></div>",
        colours.join(",")
    )
}

fn ramp() -> impl Iterator<Item = f32> {
    (0..=32).map(|i| i as f32 / 32.0)
}

fn jet_bar(range: &DbRange) -> String {
    let ticks: Vec<String> = (0..5).rev().map(|i| format!("{:.0} dB", range.db(i as f32 / 4.0))).collect();
    bar(ramp().map(|t| jet(t).map(quantize8)), &ticks)
}

fn error_bar() -> String {
    let ticks: Vec<String> = [1.0, 0.5, 0.0, -0.5, -1.0].iter().map(|t| format!("{:+.0} dB", t * ERROR_DB)).collect();
    bar(ramp().map(|t| diverging(2.0 * t - 1.0)), &ticks)
}

fn scalar_truth(truth: &Keyframe, range: &DbRange) -> Raster<f32> {
    truth.spectrum.map(|&s| range.scalar(s))
}

fn optical_error(truth: &Keyframe, prediction: &Raster<[u8; 3]>) -> Raster<[u8; 3]> {
    Raster::from_fn(truth.image.width(), truth.image.height(), |x, y| {
        let (a, b) = (truth.image[(x, y)], prediction[(x, y)]);
        let mean = (0..3).map(|c| (f32::from(a[c]) - f32::from(b[c])).abs()).sum::<f32>() / (3.0 * 255.0);
        heat(mean / ERROR_OPTICAL)
    })
}

fn spectrum_error(truth: &Raster<f32>, prediction: &Kept, range: &DbRange) -> Raster<[u8; 3]> {
    let span_db = (range.max_db - range.min_db) as f32;
    Raster::from_fn(truth.width(), truth.height(), |x, y| {
        diverging((prediction.scalar[(x, y)] - truth[(x, y)]) * span_db / ERROR_DB)
    })
}

/// Truth / prediction / error of image and spectrum, on the shown frames of one row.
pub(super) fn triptychs(report: &Report<'_>, label: &str) -> Result<String> {
    let range = report.dataset.db_range();
    let folder = row_folder(report.predictions, label);
    let mut out = format!("<p class=\"note\">{}, first seed, held-out keyframes. Spectra share one dB range.</p>", escape(label));
    for index in predictions::shown(&report.split.held_out) {
        let Some(prediction) = predictions::load(&folder, index) else { continue };
        let truth = report.dataset.keyframe(index)?;
        let scalar = scalar_truth(&truth, &range);
        write!(out, "<h3>keyframe {}</h3>", index + 1)?;
        if let Some(image) = &prediction.image {
            out.push_str("<div class=\"row three\">");
            out.push_str(&figure(&truth.image, "image, observed")?);
            out.push_str(&figure(image, "image, predicted")?);
            out.push_str(&figure(&optical_error(&truth, image), "mean absolute error")?);
            let percent = |t: f32| format!("{:.0} %", 100.0 * t * ERROR_OPTICAL);
            out.push_str(&bar(ramp().map(heat), &[percent(1.0), percent(0.5), percent(0.0)]));
            out.push_str("</div>");
        }
        out.push_str("<div class=\"row three\">");
        out.push_str(&figure(&jet_image(&scalar), "spectrum, observed")?);
        out.push_str(&figure(&jet_image(&prediction.scalar), "spectrum, predicted")?);
        out.push_str(&figure(&spectrum_error(&scalar, &prediction, &range), "predicted − observed")?);
        write!(out, "<div>{}<div style=\"height:12px\"></div>{}</div></div>", jet_bar(&range), error_bar())?;
    }
    Ok(out)
}

/// One held-out keyframe as every row predicts its spectrum.
pub(super) fn gallery(report: &Report<'_>) -> Result<String> {
    let shown = predictions::shown(&report.split.held_out);
    let keyframes = shown.into_iter().map(|index| report.dataset.keyframe(index)).collect::<corf_scene::Result<Vec<_>>>()?;
    // The one that receives the most: there is the most to get wrong.
    let power = |k: &Keyframe| k.spectrum.pixels().iter().map(|&s| f64::from(s)).sum::<f64>();
    let Some(truth) = keyframes.into_iter().max_by(|a, b| power(a).total_cmp(&power(b))) else { return Ok(String::new()) };
    let (range, index) = (report.dataset.db_range(), truth.index);
    let mut out = format!("<p class=\"note\">Keyframe {}.</p><div class=\"row gallery\">", index + 1);
    out.push_str(&figure(&jet_image(&scalar_truth(&truth, &range)), "observed")?);
    for (label, prediction) in kept(report, index) {
        out.push_str(&figure(&jet_image(&prediction.scalar), label)?);
    }
    write!(out, "</div><div style=\"width:90px;height:130px\">{}</div>", jet_bar(&range))?;
    Ok(out)
}
