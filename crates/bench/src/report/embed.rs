//! Pictures as a part of a page.

use crate::record::predictions::encode_jpeg;
use anyhow::Result;
use base64::Engine;
use corf_scene::Raster;
use corf_scene::io::encode_png;

/// Quality of a page's JPEGs, of 100.
const QUALITY: u8 = 82;

fn uri(kind: &str, bytes: &[u8]) -> String {
    format!("data:image/{kind};base64,{}", base64::engine::general_purpose::STANDARD.encode(bytes))
}

/// A picture as a data URI, without loss.
///
/// # Errors
/// A picture without pixels.
pub(super) fn png_uri(picture: &Raster<[u8; 3]>) -> Result<String> {
    Ok(uri("png", &encode_png(picture)?))
}

/// A picture as a data URI: PNG or JPEG, whichever is shorter.
///
/// # Errors
/// A picture without pixels.
pub(crate) fn picture_uri(picture: &Raster<[u8; 3]>) -> Result<String> {
    let (png, jpeg) = (encode_png(picture)?, encode_jpeg(picture, QUALITY)?);
    Ok(if png.len() <= jpeg.len() { uri("png", &png) } else { uri("jpeg", &jpeg) })
}
