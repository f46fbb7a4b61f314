//! Predictions kept beside a record, for the report: every held-out keyframe of each row's first seed, at the report's resolution.
//!
//! ```text
//! PREDICTIONS/ROW/00001-optical.jpg     image, at most 480 columns, JPEG: some 30 kB
//! PREDICTIONS/ROW/00001-spectrum.png    spectrum on the dataset's decibel range, at most 320 columns, 8-bit grey: some 20 kB
//! ```
//!
//! Folders of earlier versions hold four keyframes a row and images as PNG in full size; they are read as they are.

use crate::metrics::Halves;
use anyhow::{Context, Result};
use corf_scene::color::quantize8;
use corf_scene::io::write_atomic;
use corf_scene::{Keyframe, Raster};
use image::codecs::jpeg::JpegEncoder;
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use std::path::{Path, PathBuf};

/// Most columns of an image in a report.
pub const IMAGE_COLUMNS: usize = 480;
/// Most columns of a spectrum in a report.
pub const SPECTRUM_COLUMNS: usize = 320;
/// Quality of a kept JPEG, of 100.
const QUALITY: u8 = 90;

fn light_path(folder: &Path, index: usize, ending: &str) -> PathBuf {
    folder.join(format!("{:05}-optical.{ending}", index + 1))
}

fn scalar_path(folder: &Path, index: usize) -> PathBuf {
    folder.join(format!("{:05}-spectrum.png", index + 1))
}

/// A raster with at most `columns` columns: every value is the mean over the area that its pixel covers.
pub fn shrunk<const N: usize>(raster: &Raster<[f32; N]>, columns: usize) -> Raster<[f32; N]> {
    let (width, height) = (raster.width(), raster.height());
    if width <= columns || columns == 0 {
        return raster.clone();
    }
    let rows = (height * columns).div_ceil(width).max(1);
    // First along rows, then along columns.
    let (across, down) = (spans(width, columns), spans(height, rows));
    let narrow = Raster::from_fn(columns, height, |x, y| mean(&across[x], |at| raster[(at, y)]));
    Raster::from_fn(columns, rows, |x, y| mean(&down[y], |at| narrow[(x, at)]))
}

/// The pixels of `from` that each of `to` covers, with the shares that it covers.
fn spans(from: usize, to: usize) -> Vec<Vec<(usize, f32)>> {
    let scale = from as f64 / to as f64;
    let span = |i: usize| {
        let (begin, end) = (i as f64 * scale, ((i + 1) as f64 * scale).min(from as f64));
        let share = |at: usize| (end.min((at + 1) as f64) - begin.max(at as f64)) as f32;
        (begin as usize..from).take_while(|at| (*at as f64) < end).map(|at| (at, share(at))).collect()
    };
    (0..to).map(span).collect()
}

fn mean<const N: usize>(span: &[(usize, f32)], value: impl Fn(usize) -> [f32; N]) -> [f32; N] {
    let (mut sum, mut weight) = ([0.0; N], 0.0);
    for &(at, share) in span {
        sum.iter_mut().zip(value(at)).for_each(|(s, v)| *s += share * v);
        weight += share;
    }
    sum.map(|s| s / weight)
}

/// An 8-bit image with at most `columns` columns.
pub fn shrunk_image(image: &Raster<[u8; 3]>, columns: usize) -> Raster<[u8; 3]> {
    if image.width() <= columns {
        return image.clone();
    }
    shrunk(&image.map(|p| p.map(f32::from)), columns).map(|p| p.map(|v| v.round() as u8))
}

/// A scalar raster with at most `columns` columns.
pub fn shrunk_scalar(scalar: &Raster<f32>, columns: usize) -> Raster<f32> {
    if scalar.width() <= columns { scalar.clone() } else { shrunk(&scalar.map(|&s| [s]), columns).map(|[s]| *s) }
}

/// Encodes an image as JPEG.
///
/// # Errors
/// An image without pixels, or one too large for the format.
pub fn encode_jpeg(image: &Raster<[u8; 3]>, quality: u8) -> Result<Vec<u8>> {
    let mut out = Vec::new();
    let bytes = image.pixels().as_flattened();
    JpegEncoder::new_with_quality(&mut out, quality).write_image(
        bytes,
        image.width() as u32,
        image.height() as u32,
        ExtendedColorType::Rgb8,
    )?;
    Ok(out)
}

/// Encodes a grey 8-bit image as PNG.
fn encode_grey_png(image: &Raster<u8>) -> Result<Vec<u8>> {
    let mut out = Vec::new();
    PngEncoder::new(&mut out).write_image(image.pixels(), image.width() as u32, image.height() as u32, ExtendedColorType::L8)?;
    Ok(out)
}

/// Keeps one prediction in `folder`, as far as there is one; of a half that is missing nothing of an earlier run stays.
///
/// # Errors
/// When the folder cannot be written.
pub fn keep(folder: &Path, truth: &Keyframe, prediction: Halves<'_>) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let index = truth.index;
    for path in [light_path(folder, index, "jpg"), light_path(folder, index, "png"), scalar_path(folder, index)] {
        if path.exists() {
            std::fs::remove_file(&path).with_context(|| format!("cannot remove {}", path.display()))?;
        }
    }
    if let Some(image) = prediction.image {
        let small = shrunk(image, IMAGE_COLUMNS).map(|p| p.map(quantize8));
        write_atomic(light_path(folder, index, "jpg"), &encode_jpeg(&small, QUALITY)?)?;
    }
    if let Some(spectrum) = prediction.spectrum {
        let small = shrunk_scalar(spectrum.scalar, SPECTRUM_COLUMNS).map(|&s| quantize8(s));
        write_atomic(scalar_path(folder, index), &encode_grey_png(&small)?)?;
    }
    Ok(())
}

/// A kept prediction: the image, and the spectrum as a scalar in `[0, 1]` on the dataset's dB range; one of the two at least.
pub struct Kept {
    /// 8-bit sRGB, at most [`IMAGE_COLUMNS`] wide.
    pub image: Option<Raster<[u8; 3]>>,
    /// Scalar spectrum, at most [`SPECTRUM_COLUMNS`] wide.
    pub scalar: Option<Raster<f32>>,
}

/// Reads a kept prediction; `None` where none was kept.
pub fn load(folder: &Path, index: usize) -> Option<Kept> {
    // Opening a pipe would wait.
    let open = |path: PathBuf| path.is_file().then(|| image::open(&path).ok()).flatten();
    let light = |ending| open(light_path(folder, index, ending));
    let image = light("jpg").or_else(|| light("png")).map(|image| {
        let image = image.to_rgb8();
        let pixels = image.pixels().map(|p| p.0).collect();
        shrunk_image(&Raster::from_vec(image.width() as usize, image.height() as usize, pixels), IMAGE_COLUMNS)
    });
    let scalar = open(scalar_path(folder, index)).map(|grey| {
        let grey = grey.to_luma8();
        let scalar = grey.pixels().map(|p| f32::from(p.0[0]) / 255.0).collect();
        shrunk_scalar(&Raster::from_vec(grey.width() as usize, grey.height() as usize, scalar), SPECTRUM_COLUMNS)
    });
    (image.is_some() || scalar.is_some()).then_some(Kept { image, scalar })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metrics::PredictedSpectrum;
    use corf_scene::io::encode_png;
    use corf_scene::{Light, Radio, Rigid3};

    #[test]
    fn a_smaller_raster_has_the_means_of_the_areas() {
        let raster = Raster::from_fn(6, 3, |x, y| [(x + 10 * y) as f32]);
        let small = shrunk(&raster, 2);
        assert_eq!((small.width(), small.height()), (2, 1));
        assert_eq!(small.pixels(), [[11.0], [14.0]]);
        // A pixel that is covered in part counts in part: (1·0 + ½·1) / 1.5.
        let uneven = shrunk(&Raster::from_fn(3, 1, |x, _| [x as f32]), 2);
        assert!((uneven[(0, 0)][0] - 1.0 / 3.0).abs() < 1e-6 && (uneven[(1, 0)][0] - 5.0 / 3.0).abs() < 1e-6);
        assert_eq!(shrunk(&raster, 6), raster);
    }

    #[test]
    fn what_is_kept_is_small_and_comes_back_and_old_folders_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let image = Raster::from_fn(1600, 900, |x, y| [x as f32 / 1600.0, y as f32 / 900.0, 0.5]);
        let scalar = Raster::from_fn(300, 200, |x, _| x as f32 / 300.0);
        let jet = scalar.map(|&s| corf_scene::color::jet(s));
        let truth = Keyframe {
            index: 8,
            time_s: 0.0,
            world_from_camera: Rigid3::IDENTITY,
            light: Some(Light::of_image(image.map(|p| p.map(quantize8)))),
            radio: Some(Radio { spectrum: scalar.clone() }),
        };
        let halves = Halves { image: Some(&image), spectrum: Some(PredictedSpectrum { jet: &jet, scalar: &scalar }) };
        keep(folder.path(), &truth, halves).unwrap();
        let bytes: u64 = std::fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().metadata().unwrap().len()).sum();
        assert!(bytes < 100_000, "{bytes}");
        let kept = load(folder.path(), 8).unwrap();
        let (back, spectrum) = (kept.image.unwrap(), kept.scalar.unwrap());
        assert_eq!((back.width(), back.height(), spectrum.width(), spectrum.height()), (480, 270, 300, 200));
        assert!(spectrum.pixels().iter().zip(scalar.pixels()).all(|(a, b)| (a - b).abs() < 0.51 / 255.0));
        let near =
            |p: [u8; 3], x: f32, y: f32| (f32::from(p[0]) - 255.0 * x).abs() < 6.0 && (f32::from(p[1]) - 255.0 * y).abs() < 6.0;
        assert!(near(back[(240, 135)], 0.5, 0.5) && near(back[(470, 10)], 0.98, 0.04), "{:?}", back[(240, 135)]);
        assert!(load(folder.path(), 7).is_none());
        // As earlier versions kept it.
        std::fs::write(folder.path().join("00001-optical.png"), encode_png(&truth.light.unwrap().image).unwrap()).unwrap();
        let old = load(folder.path(), 0).unwrap();
        assert!(old.scalar.is_none() && old.image.unwrap().width() == IMAGE_COLUMNS);
    }
}
