//! Errors of predicted pictures, in colours.

use super::{Colour, diverging, heat};
use crate::record::predictions::{shrunk_image, shrunk_scalar};
use corf_scene::Raster;
use corf_scene::keyframe::DbRange;

/// Full scale of the spectrum's error map, dB.
pub const ERROR_DB: f32 = 20.0;
/// Full scale of the image's error map, share of full scale.
pub const ERROR_LIGHT: f32 = 0.25;

/// Mean absolute error over the channels, in colours; both pictures are shrunk to the narrower one first.
pub fn image_error(observed: &Raster<Colour>, predicted: &Raster<Colour>) -> Raster<Colour> {
    let columns = observed.width().min(predicted.width());
    let (a, b) = (shrunk_image(observed, columns), shrunk_image(predicted, columns));
    Raster::from_fn(columns, a.height().min(b.height()), |x, y| {
        let (a, b) = (a[(x, y)], b[(x, y)]);
        let mean = (0..3).map(|c| (f32::from(a[c]) - f32::from(b[c])).abs()).sum::<f32>() / (3.0 * 255.0);
        heat(mean / ERROR_LIGHT)
    })
}

/// Predicted minus observed in decibels, in colours; both are shrunk to the narrower one first.
pub fn spectrum_error(observed: &Raster<f32>, predicted: &Raster<f32>, range: &DbRange) -> Raster<Colour> {
    let span_db = (range.max_db - range.min_db) as f32;
    let columns = observed.width().min(predicted.width());
    let (a, b) = (shrunk_scalar(observed, columns), shrunk_scalar(predicted, columns));
    Raster::from_fn(columns, a.height().min(b.height()), |x, y| diverging((b[(x, y)] - a[(x, y)]) * span_db / ERROR_DB))
}
