//! Pictures and numbers of one keyframe: observed, predicted, and how far apart.

use super::subject::{Run, Subject};
use crate::charts::{image_error, picture_uri};
use crate::metrics::peaks::{self, Peak};
use crate::metrics::{COLUMNS, Prediction};
use crate::record::predictions::{shrunk, shrunk_image, shrunk_scalar};
use anyhow::{Result, ensure};
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use corf_raytrace::spectrum::Grid;
use corf_scene::color::quantize8;
use corf_scene::keyframe::DbRange;
use corf_scene::{Keyframe, Pinhole, Raster};
use serde::Serialize;

/// Most columns of an image.
const IMAGE_COLUMNS: usize = 640;
/// Most columns of a spectrum.
const SPECTRUM_COLUMNS: usize = 320;
/// The metrics that are shown, by key.
const SHOWN: &[&str] =
    &["psnr_opt", "ssim_opt", "psnr_rf_scalar", "rmse_db_30", "codebook_loss_db", "peak_error_deg", "psnr_rf_jet"];

/// Why a reconstruction at work has no predictions at its keyframes.
const WHILE_AT_WORK: &str = "What is predicted here, and how wrong it is, corf view shows once the reconstruction has ended: it would take time from it now.";

/// The document of a keyframe.
#[derive(Serialize)]
pub(super) struct KeyframeDocument {
    image: Option<Images>,
    spectrum: Option<Spectra>,
    numbers: Vec<Number>,
    note: Option<String>,
}

/// Pictures as data URIs.
#[derive(Serialize)]
struct Images {
    observed: String,
    predicted: Option<String>,
    error: Option<String>,
}

/// Levels in `[0, 1]` on the data set's decibel range as base64 of 16 bits each, little endian, and their peaks.
#[derive(Serialize)]
struct Spectra {
    width: usize,
    height: usize,
    observed: String,
    predicted: Option<String>,
    peaks_observed: Vec<Peak>,
    peaks_predicted: Vec<Peak>,
}

/// A metric with its definition.
#[derive(Serialize)]
struct Number {
    /// Of the `image` or of the `spectrum`.
    half: &'static str,
    name: &'static str,
    title: String,
    value: String,
}

impl Subject {
    /// The document of keyframe `index`: what was observed and, of a run, what its field predicts there.
    ///
    /// # Errors
    /// A keyframe that cannot be read, a device that gives up, a field that has diverged.
    pub(super) fn keyframe(&mut self, index: usize) -> Result<KeyframeDocument> {
        let truth = self.dataset.keyframe(index)?;
        let has = truth.modalities();
        let predicted = self.run.as_mut().map(|run| predict(run, &truth)).transpose()?.map(|p| p.within(has));
        let numbers = match (&self.run, &predicted) {
            (Some(run), Some(predicted)) => numbers(run, predicted, &truth)?,
            _ => Vec::new(),
        };
        let image = truth.light.as_ref().map(|light| images(&light.image, predicted.as_ref())).transpose()?;
        let radio = truth.radio.as_ref().zip(self.dataset.db_range());
        let spectrum =
            radio.map(|(radio, range)| spectra(&radio.spectrum, predicted.as_ref(), &self.dataset.radio_camera(), &range));
        let lacks = |there: bool, half: &str| (self.run.is_some() && !there).then(|| format!("This method predicts no {half}."));
        let lacking = predicted.as_ref().and_then(|p| {
            lacks(p.image.is_some() || !has.light, "image").or_else(|| lacks(p.radio.is_some() || !has.radio, "spectrum"))
        });
        let note = lacking.or_else(|| self.work.is_some().then(|| WHILE_AT_WORK.to_owned()));
        Ok(KeyframeDocument { image, spectrum, numbers, note })
    }
}

/// As `corf render` does.
fn predict(run: &mut Run, truth: &Keyframe) -> Result<Prediction> {
    let predicted = run.predictor.render(&truth.world_from_camera)?;
    ensure!(
        predicted.is_finite(),
        "keyframe {}: a pixel of the prediction is not a finite number\n  help: the field has diverged; reconstruct it with smaller rates",
        truth.index + 1
    );
    Ok(predicted)
}

fn numbers(run: &Run, predicted: &Prediction, truth: &Keyframe) -> Result<Vec<Number>> {
    let frame = run.evaluator.compare(predicted.halves(), truth)?;
    let number = |key: &&str| {
        let column = COLUMNS.iter().find(|c| c.key == *key)?;
        let value = (column.of)(&frame)?;
        let half = if column.is_of_image() { "image" } else { "spectrum" };
        Some(Number {
            half,
            name: column.heading,
            title: column.definition_of_frame(),
            value: format!("{value:.*}", column.digits),
        })
    };
    Ok(SHOWN.iter().filter_map(number).collect())
}

fn images(truth: &Raster<[u8; 3]>, predicted: Option<&Prediction>) -> Result<Images> {
    let observed = shrunk_image(truth, IMAGE_COLUMNS);
    let predicted = predicted.and_then(|p| p.image.as_ref()).map(|image| shrunk(image, IMAGE_COLUMNS).map(|p| p.map(quantize8)));
    let error = predicted.as_ref().map(|predicted| image_error(&observed, predicted));
    let uri = |picture: &Option<Raster<[u8; 3]>>| picture.as_ref().map(picture_uri).transpose();
    Ok(Images { observed: picture_uri(&observed)?, predicted: uri(&predicted)?, error: uri(&error)? })
}

fn spectra(truth: &Raster<f32>, predicted: Option<&Prediction>, camera: &Pinhole, range: &DbRange) -> Spectra {
    let observed = truth.map(|&s| range.scalar(s));
    let predicted = predicted.and_then(|p| p.radio.as_ref()).map(|radio| &radio.scalar);
    let (small, grid) = (shrunk_scalar(&observed, SPECTRUM_COLUMNS), Grid::from(camera));
    Spectra {
        width: small.width(),
        height: small.height(),
        observed: levels(&small),
        predicted: predicted.map(|scalar| levels(&shrunk_scalar(scalar, SPECTRUM_COLUMNS))),
        peaks_observed: peaks::find(&observed, &grid, range),
        peaks_predicted: predicted.map(|scalar| peaks::find(scalar, &grid, range)).unwrap_or_default(),
    }
}

fn levels(scalar: &Raster<f32>) -> String {
    let level = |&s: &f32| ((s.clamp(0.0, 1.0) * f32::from(u16::MAX)).round() as u16).to_le_bytes();
    STANDARD.encode(scalar.pixels().iter().flat_map(level).collect::<Vec<u8>>())
}
