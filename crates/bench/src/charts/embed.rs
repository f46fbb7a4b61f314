//! Pictures as a part of a figure or a page.

use super::Colour;
use crate::record::predictions::encode_jpeg;
use anyhow::Result;
use base64::Engine;
use corf_scene::Raster;
use corf_scene::io::encode_png;

/// Quality of a page's JPEGs, of 100.
const QUALITY: u8 = 82;

/// A file of an image as a data URI; `kind` is png or jpeg.
fn data_uri(kind: &str, bytes: &[u8]) -> String {
    format!("data:image/{kind};base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
}

/// A picture as a data URI, without loss.
///
/// # Errors
/// A picture without pixels.
pub fn png_uri(picture: &Raster<Colour>) -> Result<String> {
    Ok(data_uri("png", &encode_png(picture)?))
}

/// A picture as a data URI: PNG or JPEG, whichever is shorter.
///
/// # Errors
/// A picture without pixels.
pub fn picture_uri(picture: &Raster<Colour>) -> Result<String> {
    let (png, jpeg) = (encode_png(picture)?, encode_jpeg(picture, QUALITY)?);
    Ok(if png.len() <= jpeg.len() { data_uri("png", &png) } else { data_uri("jpeg", &jpeg) })
}
