//! Maps of one number a pixel, as networks and other tools leave them.

use super::{decode_exr, decode_image, floats, read, wrong_channels};
use crate::{Error, Raster, Result, npz};
use image::DynamicImage;
use std::path::Path;

/// Reads a map of one number a pixel, as it is in the file: an EXR's channel `Z` or `Y` or its only one; a 16-bit grey PNG; or a `.npy` of
/// `<f2`, `<f4`, `<f8` or `<u2` in C order with two axes (rows, columns) or a third of length 1 at either end. The file's extension says which.
///
/// # Errors
/// Another extension; a file that cannot be read, is damaged, larger than [`super::MAX_PIXELS`], or holds more than one number a pixel.
pub fn read_map(path: impl AsRef<Path>) -> Result<Raster<f32>> {
    decode_map(&read(path.as_ref())?, path)
}

/// The map in a file's bytes, as [`read_map`] reads it; `path` says by its extension what they are, and names them in messages.
///
/// # Errors
/// Those of [`read_map`], but for the reading.
pub fn decode_map(bytes: &[u8], path: impl AsRef<Path>) -> Result<Raster<f32>> {
    let path = path.as_ref();
    match path.extension().and_then(|e| e.to_str()) {
        Some("exr") => exr(bytes, path),
        Some("npy") => npy(bytes, path),
        Some("png") => png(bytes, path),
        _ => Err(Error::invalid(path.display().to_string(), "not named as a map is", "give an .exr, .npy or .png file")),
    }
}

fn exr(bytes: &[u8], path: &Path) -> Result<Raster<f32>> {
    let (width, height, channels) = decode_exr(bytes, path)?;
    let named = |name: &str| channels.iter().find(|(n, _)| n == name);
    let only = || channels.first().filter(|_| channels.len() == 1);
    match named("Z").or_else(|| named("Y")).or_else(only) {
        Some((_, samples)) => Ok(Raster::from_vec(width, height, floats(samples))),
        None => Err(wrong_channels(path, &channels, "a channel Z or Y, or a single one")),
    }
}

fn npy(bytes: &[u8], path: &Path) -> Result<Raster<f32>> {
    let place = path.display().to_string();
    let (shape, values) = npz::decode_npy(bytes, &place)?;
    let (height, width) = match *shape.as_slice() {
        [height, width] | [height, width, 1] | [1, height, width] => (height, width),
        _ => return Err(Error::invalid(place, format!("its shape is {shape:?}"), "save an array of shape (rows, columns)")),
    };
    if values.is_empty() {
        return Err(Error::invalid(place, format!("its shape is {shape:?}: a map without pixels"), "save it again"));
    }
    Ok(Raster::from_vec(width, height, values.into_iter().map(|v| v as f32).collect()))
}

fn png(bytes: &[u8], path: &Path) -> Result<Raster<f32>> {
    match decode_image(bytes, path, |image| image)? {
        DynamicImage::ImageLuma16(grey) => {
            let (width, height) = (grey.width() as usize, grey.height() as usize);
            Ok(Raster::from_vec(width, height, grey.into_raw().into_iter().map(f32::from).collect()))
        }
        other => Err(Error::invalid(
            path.display().to_string(),
            format!("its pixels are {:?}, not 16-bit grey", other.color()),
            "save one number a pixel as 16-bit grey, or as .npy or .exr",
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::{encode_exr_f32, encode_png, encode_png16, write_atomic};
    use crate::npz::{Array, Values};

    #[test]
    fn every_kind_of_file_gives_the_same_map() {
        let dir = tempfile::tempdir().unwrap();
        let map = Raster::from_fn(5, 3, |x, y| (100 * y + x) as f32);
        let write = |name: &str, bytes: Vec<u8>| {
            let path = dir.path().join(name);
            write_atomic(&path, &bytes).unwrap();
            path
        };
        let npy = |shape: &[usize]| Array::new("x", shape, Values::F32(map.pixels().to_vec())).to_npy();
        for path in [
            write("z.exr", encode_exr_f32(&map, "Z").unwrap()),
            write("v.exr", encode_exr_f32(&map, "V").unwrap()),
            write("two.npy", npy(&[3, 5])),
            write("last.npy", npy(&[3, 5, 1])),
            write("first.npy", npy(&[1, 3, 5])),
            write("grey.png", encode_png16(&map.map(|v| *v as u16)).unwrap()),
        ] {
            assert_eq!(read_map(&path).unwrap(), map, "{}", path.display());
        }
        let rgb = write("rgb.png", encode_png(&Raster::filled(5, 3, [0; 3])).unwrap());
        for (path, word) in [
            (write("one.npy", npy(&[15])), "[15]"),
            (write("none.npy", Array::new("x", &[0, 4], Values::F32(vec![])).to_npy()), "without pixels"),
            (rgb, "16-bit grey"),
            (write("a.tiff", vec![]), ".exr"),
            (dir.path().join("absent.exr"), "absent.exr"),
        ] {
            let error = read_map(&path).unwrap_err().to_string();
            assert!(error.contains(word), "{error}");
        }
    }
}
