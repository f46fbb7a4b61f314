//! A keyframe as a reconstruction takes it: what it has to be, and what becomes of it as a training target.

use crate::depth::fill;
use crate::device::{InverseDepth, Planes, TrainingView};
use crate::{Error, FieldMeta, Result};
use corf_scene::{Keyframe, Light, Pinhole, Radio, Raster, Rigid3};
use rayon::prelude::*;
use std::borrow::Cow;

/// Refuses a keyframe with neither light nor radio, with a raster that is not its camera's, whose pose is not finite, or whose spectrum is no power.
pub fn check(keyframe: &Keyframe, meta: &FieldMeta) -> Result<()> {
    let place = format!("keyframe {}", keyframe.index);
    let Keyframe { light, radio, world_from_camera: pose, .. } = keyframe;
    if light.is_none() && radio.is_none() {
        return Err(nothing(keyframe));
    }
    if let Some(Light { image, depth_m, surface, mask }) = light {
        let rasters = [
            ("optical image", Some(size(image))),
            ("depth", depth_m.as_ref().map(size)),
            ("surface index", surface.as_ref().map(size)),
            ("mask", mask.as_ref().map(size)),
        ];
        for (what, got) in rasters {
            got.map_or(Ok(()), |got| check_size(&place, what, got, &meta.light_camera))?;
        }
    }
    if let Some(Radio { spectrum }) = radio {
        check_size(&place, "spectrum", size(spectrum), &meta.radio_camera)?;
    }
    if !pose.translation.is_finite() || !pose.rotation.is_finite() {
        return Err(Error::invalid(place, "the pose is not finite", "remove or repair this keyframe"));
    }
    if let Some(Radio { spectrum }) = radio
        && let Some(i) = spectrum.pixels().iter().position(|s| !s.is_finite() || *s < 0.0)
    {
        let (w, value) = (spectrum.width(), spectrum.pixels()[i]);
        let what = format!("the spectrum is {value} at row {}, column {}", i / w, i % w);
        return Err(Error::invalid(place, what, "linear power is finite and not negative"));
    }
    Ok(())
}

/// What growth is guided by and light is trained on: what the camera saw or, in a capture without light, the Jet picture of the spectrum, of which
/// all pixels count. This is the one place where the one stands for the other; whoever asks for an image elsewhere asks whether there is one.
///
/// # Errors
/// A keyframe with neither; a picture of a spectrum that is not of the optical camera's size.
pub fn guide<'k>(keyframe: &'k Keyframe, meta: &FieldMeta) -> Result<Cow<'k, Light>> {
    match (&keyframe.light, &keyframe.radio) {
        (Some(light), _) => Ok(Cow::Borrowed(light)),
        (None, Some(Radio { spectrum })) => {
            let place = format!("keyframe {}", keyframe.index);
            check_size(&place, "spectrum, which guides growth where there is no image,", size(spectrum), &meta.light_camera)?;
            Ok(Cow::Owned(Light::of_image(meta.db_range.jet_image(spectrum))))
        }
        (None, None) => Err(nothing(keyframe)),
    }
}

fn nothing(keyframe: &Keyframe) -> Error {
    let what = "it has neither light nor radio";
    Error::invalid(format!("keyframe {}", keyframe.index), what, "give it an image, a spectrum, or both")
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
pub fn light(light: &Light) -> Planes {
    let mut image = Cow::Borrowed(&light.image);
    if let Some(mask) = light.mask.as_ref().filter(|m| m.pixels().contains(&false)) {
        fill(image.to_mut(), &mask.map(|counts| !counts).into_vec());
    }
    let pixels = image.pixels().as_flattened().par_iter().with_min_len(1024).map(|v| f32::from(*v) / 255.0).collect();
    Planes { width: image.width(), height: image.height(), channels: 3, pixels }
}

/// A spectrum as the target in radio: as many channels as `meta`'s target has. Without radio it is that of no power anywhere, on which nothing is to
/// be trained: a device's view has both halves.
pub fn radio(radio: Option<&Radio>, meta: &FieldMeta) -> Planes {
    match radio {
        Some(Radio { spectrum }) => meta.radio_target.encode(spectrum, &meta.db_range),
        None => meta.radio_target.no_power(meta.radio_camera.width, meta.radio_camera.height),
    }
}

/// The training target of a pose.
pub fn training_view(
    world_from_camera: Rigid3,
    light: Planes,
    radio: Planes,
    inverse_depth: Option<InverseDepth>,
    mask: Option<Raster<bool>>,
    meta: &FieldMeta,
) -> TrainingView {
    let (light_camera, radio_camera) = (meta.light_camera, meta.radio_camera);
    TrainingView { world_from_camera, light_camera, light, radio_camera, radio, inverse_depth, mask }
}
