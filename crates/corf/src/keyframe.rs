//! A keyframe as a reconstruction takes it: what it has to be, and what becomes of it as a training target.

use crate::depth::fill;
use crate::device::{InverseDepth, Planes, TrainingView};
use crate::{Error, FieldMeta, Result};
use corf_scene::{Keyframe, Pinhole, Raster, Rigid3};
use rayon::prelude::*;
use std::borrow::Cow;

/// Refuses a keyframe whose images are not the cameras', whose pose is not finite, or whose spectrum is no power.
pub fn check(keyframe: &Keyframe, meta: &FieldMeta) -> Result<()> {
    let place = format!("keyframe {}", keyframe.index);
    check_size(&place, "optical image", size(&keyframe.image), &meta.optical_camera)?;
    check_size(&place, "spectrum", size(&keyframe.spectrum), &meta.rf_camera)?;
    if let Some(depth) = &keyframe.depth_m {
        check_size(&place, "depth", size(depth), &meta.optical_camera)?;
    }
    if let Some(surface) = &keyframe.surface {
        check_size(&place, "surface index", size(surface), &meta.optical_camera)?;
    }
    if let Some(mask) = &keyframe.mask {
        check_size(&place, "mask", size(mask), &meta.optical_camera)?;
    }
    let pose = &keyframe.world_from_camera;
    if !pose.translation.is_finite() || !pose.rotation.is_finite() {
        return Err(Error::invalid(place, "the pose is not finite", "remove or repair this keyframe"));
    }
    if let Some(i) = keyframe.spectrum.pixels().iter().position(|s| !s.is_finite() || *s < 0.0) {
        let (w, value) = (keyframe.spectrum.width(), keyframe.spectrum.pixels()[i]);
        let what = format!("the spectrum is {value} at row {}, column {}", i / w, i % w);
        return Err(Error::invalid(place, what, "linear power per steradian is finite and not negative"));
    }
    Ok(())
}

fn size<T>(raster: &Raster<T>) -> (usize, usize) {
    (raster.width(), raster.height())
}

fn check_size(place: &str, what: &str, got: (usize, usize), camera: &Pinhole) -> Result<()> {
    if got == (camera.width, camera.height) {
        return Ok(());
    }
    Err(Error::invalid(
        place,
        format!("the {what} is {}x{} and the camera says {}x{}", got.0, got.1, camera.width, camera.height),
        "all keyframes of a sequence share the cameras it was opened with",
    ))
}

/// An 8-bit image as the target in light: 3 channels, sRGB-encoded `[0, 1]`. Where its mask leaves pixels out, it continues with the nearest
/// that count: what is in their place there leaves no edge around it, where Gaussians would grow, nor contrast in the windows of SSIM.
pub fn optical(keyframe: &Keyframe) -> Planes {
    let mut image = Cow::Borrowed(&keyframe.image);
    if let Some(mask) = keyframe.mask.as_ref().filter(|m| m.pixels().contains(&false)) {
        fill(image.to_mut(), &mask.map(|counts| !counts).into_vec());
    }
    let pixels = image.pixels().as_flattened().par_iter().with_min_len(1024).map(|v| f32::from(*v) / 255.0).collect();
    Planes { width: image.width(), height: image.height(), channels: 3, pixels }
}

/// The training target of a pose.
pub fn training_view(
    world_from_camera: Rigid3,
    optical: Planes,
    rf: Planes,
    inverse_depth: Option<InverseDepth>,
    mask: Option<Raster<bool>>,
    meta: &FieldMeta,
) -> TrainingView {
    let (optical_camera, rf_camera) = (meta.optical_camera, meta.rf_camera);
    TrainingView { world_from_camera, optical_camera, optical, rf_camera, rf, inverse_depth, mask }
}
