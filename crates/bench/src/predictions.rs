//! Predictions kept beside a record, for the report: a few held-out frames of each row's first seed.

use crate::metrics::Prediction;
use anyhow::{Context, Result};
use corf_scene::color::quantize8;
use corf_scene::io::{encode_png, write_atomic};
use corf_scene::{Keyframe, Raster};
use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};
use std::path::{Path, PathBuf};

/// Number of held-out frames that a report shows.
pub const SHOWN: usize = 4;

/// The held-out frames that a report shows: evenly spread, first and last included.
pub fn shown(held_out: &[usize]) -> Vec<usize> {
    let n = held_out.len();
    if n <= SHOWN {
        return held_out.to_vec();
    }
    (0..SHOWN).map(|i| held_out[i * (n - 1) / (SHOWN - 1)]).collect()
}

fn optical_path(folder: &Path, index: usize) -> PathBuf {
    folder.join(format!("{:05}-optical.png", index + 1))
}

fn scalar_path(folder: &Path, index: usize) -> PathBuf {
    folder.join(format!("{:05}-spectrum.png", index + 1))
}

/// Encodes a grey 8-bit image as PNG.
fn encode_grey_png(image: &Raster<u8>) -> Result<Vec<u8>> {
    let mut out = Vec::new();
    PngEncoder::new(&mut out).write_image(image.pixels(), image.width() as u32, image.height() as u32, ExtendedColorType::L8)?;
    Ok(out)
}

/// Keeps one prediction in `folder`.
///
/// # Errors
/// When the folder cannot be written.
pub fn keep(folder: &Path, truth: &Keyframe, prediction: &Prediction) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("cannot create {}", folder.display()))?;
    let optical = optical_path(folder, truth.index);
    match &prediction.image {
        Some(image) => write_atomic(optical, &encode_png(&image.map(|p| p.map(quantize8)))?)?,
        // One of an earlier run would be taken for this one's.
        None if optical.exists() => {
            std::fs::remove_file(&optical).with_context(|| format!("cannot remove {}", optical.display()))?
        }
        None => {}
    }
    Ok(write_atomic(scalar_path(folder, truth.index), &encode_grey_png(&prediction.rf_scalar.map(|&s| quantize8(s)))?)?)
}

/// A kept prediction: the image, and the spectrum as a scalar in `[0, 1]` on the dataset's dB range.
pub struct Kept {
    /// 8-bit sRGB, if one was predicted.
    pub image: Option<Raster<[u8; 3]>>,
    /// Scalar spectrum.
    pub scalar: Raster<f32>,
}

/// Reads a kept prediction; `None` where none was kept.
pub fn load(folder: &Path, index: usize) -> Option<Kept> {
    let optical = image::open(optical_path(folder, index)).ok().map(|image| {
        let image = image.to_rgb8();
        Raster::from_vec(image.width() as usize, image.height() as usize, image.pixels().map(|p| p.0).collect())
    });
    let grey = image::open(scalar_path(folder, index)).ok()?.to_luma8();
    let scalar = grey.pixels().map(|p| f32::from(p.0[0]) / 255.0).collect();
    Some(Kept { image: optical, scalar: Raster::from_vec(grey.width() as usize, grey.height() as usize, scalar) })
}
