//! Files: whole or not at all. PNG and EXR in and out; every write is on the disk before it has its name (`write.rs`).

#[cfg(test)]
mod bounds_tests;
mod image_header;
mod map;
mod regular;
mod text;
mod write;

use crate::guard::guarded;
use crate::{Error, Raster, Result};
use exr::prelude as ex;
pub use image_header::{MAX_EXR_BYTES, MAX_PIXELS};
pub use map::{DEPTH_UNIT_M, Map, MapOf, Stored, decode_map, read_map};
pub use regular::{MAX_CONFIG_BYTES, open, read, read_at_most, read_config_text, read_text};
use sha2::{Digest, Sha256};
use std::io::{Cursor, Write};
use std::path::Path;
pub use text::{GzipLines, LineBounds, MAX_GZIP_TEXT_BYTES, read_gzip_text, read_text_within};
pub use write::{ScratchFolder, is_temporary, remove_abandoned, remove_temporary_files, sync_folder, write_atomic};

/// Compresses as gzip; the same bytes give the same bytes.
///
/// # Errors
/// None that a buffer in memory can have.
pub fn gzip(bytes: &[u8]) -> Result<Vec<u8>> {
    let mut encoder = flate2::GzBuilder::new().mtime(0).write(Vec::new(), flate2::Compression::best());
    encoder.write_all(bytes).and_then(|()| encoder.finish()).map_err(Error::io("compress into", "memory"))
}

/// SHA-256 in lower-case hexadecimal.
pub fn sha256_hex(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().fold(String::with_capacity(64), |mut s, b| {
        use std::fmt::Write as _;
        // Writing to a String cannot fail.
        let _ = write!(s, "{b:02x}");
        s
    })
}

fn corrupt(path: &Path, kind: &str, e: impl std::fmt::Display) -> Error {
    Error::invalid(
        path.display().to_string(),
        format!("not a readable {kind}: {e}"),
        "the file is damaged or cut short; restore it, or delete it and generate it again",
    )
}

/// Encodes 8-bit RGB as PNG.
///
/// # Errors
/// An image without pixels.
pub fn encode_png(image: &Raster<[u8; 3]>) -> Result<Vec<u8>> {
    png_bytes(image.pixels().as_flattened(), image.width(), image.height(), image::ColorType::Rgb8)
}

/// Encodes 8-bit grey as PNG.
///
/// # Errors
/// An image without pixels.
pub fn encode_png8(image: &Raster<u8>) -> Result<Vec<u8>> {
    png_bytes(image.pixels(), image.width(), image.height(), image::ColorType::L8)
}

/// Encodes 16-bit grey as PNG.
///
/// # Errors
/// An image without pixels.
pub fn encode_png16(image: &Raster<u16>) -> Result<Vec<u8>> {
    let samples: Vec<u8> = image.pixels().iter().flat_map(|v| v.to_ne_bytes()).collect();
    png_bytes(&samples, image.width(), image.height(), image::ColorType::L16)
}

/// A PNG of samples in the machine's byte order.
fn png_bytes(samples: &[u8], width: usize, height: usize, color: image::ColorType) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    let format = image::ImageFormat::Png;
    image::write_buffer_with_format(&mut Cursor::new(&mut bytes), samples, width as u32, height as u32, color, format)
        .map_err(|e| Error::invalid("PNG", format!("cannot encode {width}x{height}: {e}"), "give an image with pixels"))?;
    Ok(bytes)
}

/// Writes 8-bit RGB as PNG, atomically.
///
/// # Errors
/// The file cannot be written.
pub fn write_png(path: impl AsRef<Path>, image: &Raster<[u8; 3]>) -> Result<()> {
    write_atomic(path, &encode_png(image)?)
}

/// Decodes an image file's bytes (PNG or JPEG) to 8-bit RGBA; `path` names it in messages.
///
/// # Errors
/// The bytes are no complete image, or one of more than [`MAX_PIXELS`], which the header is asked for before memory is taken.
pub fn decode_rgba(bytes: &[u8], path: impl AsRef<Path>) -> Result<Raster<[u8; 4]>> {
    let rgba = decode_image(bytes, path.as_ref(), image::DynamicImage::into_rgba8)?;
    let (width, height) = (rgba.width() as usize, rgba.height() as usize);
    Ok(Raster::from_vec(width, height, rgba.pixels().map(|p| p.0).collect()))
}

/// Decodes a PNG or JPEG of up to [`MAX_PIXELS`], and what is made of it under the same guard.
fn decode_image<T>(bytes: &[u8], path: &Path, convert: fn(image::DynamicImage) -> T) -> Result<T> {
    image_header::check_png_or_jpeg(bytes, path)?;
    let mut reader =
        image::ImageReader::new(Cursor::new(bytes)).with_guessed_format().map_err(|e| corrupt(path, "PNG or JPEG", e))?;
    let mut limits = image::Limits::default();
    // 16 bits a sample is the most a decoder writes.
    limits.max_alloc = Some(8 * MAX_PIXELS + (1 << 24));
    reader.limits(limits);
    let decoded = guarded(|| reader.decode().map(convert));
    decoded.map_err(|e| corrupt(path, "PNG or JPEG", e))?.map_err(|e| corrupt(path, "PNG or JPEG", e))
}

/// Width and height of a PNG or JPEG, by its header alone.
///
/// # Errors
/// The file cannot be read, is no image, or one of more than [`MAX_PIXELS`].
pub fn image_size(path: impl AsRef<Path>) -> Result<(usize, usize)> {
    let (path, bytes) = (path.as_ref(), read(path.as_ref())?);
    image_header::check_png_or_jpeg(&bytes, path)?;
    let reader =
        image::ImageReader::new(Cursor::new(&bytes)).with_guessed_format().map_err(|e| corrupt(path, "PNG or JPEG", e))?;
    let (width, height) = guarded(|| reader.into_dimensions())
        .map_err(|e| corrupt(path, "PNG or JPEG", e))?
        .map_err(|e| corrupt(path, "PNG or JPEG", e))?;
    Ok((width as usize, height as usize))
}

/// Reads a PNG (or JPEG) as 8-bit RGB; of transparent pixels the colour below, so that whoever reads pictures of others asks
/// [`read_png_and_opacity`].
///
/// # Errors
/// The file cannot be read or is no complete image.
pub fn read_png(path: impl AsRef<Path>) -> Result<Raster<[u8; 3]>> {
    let bytes = read(path.as_ref())?;
    Ok(decode_rgba(&bytes, path)?.map(|p| [p[0], p[1], p[2]]))
}

/// An image, and which of its pixels are wholly opaque; none where all are.
pub type WithOpacity = (Raster<[u8; 3]>, Option<Raster<bool>>);

/// Reads a PNG (or JPEG) as 8-bit RGB, and which of its pixels are wholly opaque; none where all are. Alpha may be a channel of 8 or 16 bits, or that
/// of a palette's or a colour's entry; what rounds to 255 of 255 is opaque.
///
/// # Errors
/// The file cannot be read or is no complete image.
pub fn read_png_and_opacity(path: impl AsRef<Path>) -> Result<WithOpacity> {
    decode_rgb_and_opacity(&read(path.as_ref())?, path)
}

/// What [`read_png_and_opacity`] reads, of bytes; `place` names them in errors.
///
/// # Errors
/// The bytes are no complete image.
pub fn decode_rgb_and_opacity(bytes: &[u8], place: impl AsRef<Path>) -> Result<WithOpacity> {
    let (rgb, opaque) = decode_image(bytes, place.as_ref(), |image| {
        // Before sixteen bits become eight, of which the largest is also what is not quite opaque.
        let opaque: Vec<bool> = match &image {
            image::DynamicImage::ImageRgba16(p) => p.pixels().map(|p| p.0[3] == u16::MAX).collect(),
            image::DynamicImage::ImageLumaA16(p) => p.pixels().map(|p| p.0[1] == u16::MAX).collect(),
            other => other.to_rgba8().pixels().map(|p| p.0[3] == u8::MAX).collect(),
        };
        (image.into_rgb8(), opaque)
    })?;
    let (width, height) = (rgb.width() as usize, rgb.height() as usize);
    let opaque = opaque.contains(&false).then(|| Raster::from_vec(width, height, opaque));
    Ok((Raster::from_vec(width, height, rgb.pixels().map(|p| p.0).collect()), opaque))
}

/// Whether the bytes of a PNG or JPEG can have transparent pixels, by their header; [`read_png_and_opacity`] says whether they do.
pub fn may_be_transparent(bytes: &[u8]) -> bool {
    image_header::has_alpha(bytes)
}

/// Encodes 8-bit RGB as PNG with an alpha channel: transparent where `counts` says no.
///
/// # Errors
/// An image without pixels.
///
/// # Panics
/// The two have different sizes.
pub fn encode_cut_out(image: &Raster<[u8; 3]>, counts: &Raster<bool>) -> Result<Vec<u8>> {
    assert_eq!((image.width(), image.height()), (counts.width(), counts.height()), "one value a pixel");
    let pixels = image.pixels().iter().zip(counts.pixels());
    let samples: Vec<u8> = pixels.flat_map(|([r, g, b], counts)| [*r, *g, *b, if *counts { u8::MAX } else { 0 }]).collect();
    png_bytes(&samples, image.width(), image.height(), image::ColorType::Rgba8)
}

/// Encodes a mask as an 8-bit grey PNG: white where a pixel counts, black where it does not.
///
/// # Errors
/// An image without pixels.
pub fn encode_mask(mask: &Raster<bool>) -> Result<Vec<u8>> {
    encode_png8(&mask.map(|counts| if *counts { u8::MAX } else { 0 }))
}

/// Reads a mask: a pixel counts where it is neither black nor wholly transparent.
///
/// # Errors
/// The file cannot be read or is no complete image; it is a JPEG, whose black is not quite black; or it has transparent pixels and no pixel that
/// counts, so that nothing says what it means.
pub fn read_mask(path: impl AsRef<Path>) -> Result<Raster<bool>> {
    let path = path.as_ref();
    let bytes = read(path)?;
    if image::guess_format(&bytes).ok() == Some(image::ImageFormat::Jpeg) {
        return Err(Error::invalid(
            path.display().to_string(),
            "a mask as a JPEG, whose black is not quite black",
            "write masks as PNG",
        ));
    }
    let rgba = decode_image(&bytes, path, image::DynamicImage::into_rgba16)?;
    let (width, height) = (rgba.width() as usize, rgba.height() as usize);
    let counts = Raster::from_vec(width, height, rgba.pixels().map(|p| p.0[..3] != [0; 3] && p.0[3] != 0).collect());
    // Black paint on a transparent sheet leaves out what is painted, or what is not: it does not say.
    if !counts.pixels().contains(&true) && rgba.pixels().any(|p| p.0[3] != u16::MAX) {
        return Err(Error::invalid(
            path.display().to_string(),
            "every pixel of this mask is black or transparent, so that none counts",
            "write white where a pixel counts and black where it does not, without transparency",
        ));
    }
    Ok(counts)
}

/// Reads a PNG of 8 or 16 bits as 16-bit RGB: 8-bit values times 257, which is the same share of full scale; grey is three equal channels.
///
/// # Errors
/// The file cannot be read or is no complete image, or a pixel is transparent.
pub fn read_png16(path: impl AsRef<Path>) -> Result<Raster<[u16; 3]>> {
    let path = path.as_ref();
    let bytes = read(path)?;
    let (width, height, pixels) = if may_be_transparent(&bytes) {
        let rgba = decode_image(&bytes, path, image::DynamicImage::into_rgba16)?;
        let (width, height) = (rgba.width() as usize, rgba.height() as usize);
        if let Some(i) = rgba.pixels().position(|p| p.0[3] != u16::MAX) {
            return Err(Error::invalid(
                path.display().to_string(),
                format!("pixel ({}, {}) is transparent, and what it shows is not known", i % width, i / width),
                "write the picture without an alpha channel",
            ));
        }
        (width, height, rgba.pixels().map(|p| [p.0[0], p.0[1], p.0[2]]).collect())
    } else {
        let rgb = decode_image(&bytes, path, image::DynamicImage::into_rgb16)?;
        (rgb.width() as usize, rgb.height() as usize, rgb.pixels().map(|p| p.0).collect())
    };
    Ok(Raster::from_vec(width, height, pixels))
}

/// Encodes named channels as a losslessly compressed EXR of one layer.
fn encode_exr(width: usize, height: usize, channels: Vec<(&str, ex::FlatSamples)>, unit: Option<&str>) -> Result<Vec<u8>> {
    let list = channels.into_iter().map(|(name, samples)| ex::AnyChannel::new(name, samples)).collect();
    // Blocks are compressed in file order on this thread: the same pixels give the same bytes.
    let encoding = ex::Encoding {
        compression: ex::Compression::ZIP16,
        blocks: ex::Blocks::ScanLines,
        line_order: ex::LineOrder::Increasing,
    };
    let mut attributes = ex::LayerAttributes::default();
    if let Some(unit) = unit {
        attributes.other.insert(ex::Text::from("unit"), ex::AttributeValue::Text(ex::Text::from(unit)));
    }
    let layer = ex::Layer::new((width, height), attributes, encoding, ex::AnyChannels::sort(list));
    let mut bytes = Cursor::new(Vec::new());
    use ex::WritableImage as _;
    ex::Image::from_layer(layer)
        .write()
        .non_parallel()
        .to_buffered(&mut bytes)
        .map_err(|e| Error::invalid("EXR", format!("cannot encode {width}x{height}: {e}"), "give an image with pixels"))?;
    Ok(bytes.into_inner())
}

/// Encodes one float channel (`name`: `Y` for power, `Z` for depth) as EXR.
///
/// # Errors
/// An image without pixels.
pub fn encode_exr_f32(image: &Raster<f32>, name: &str) -> Result<Vec<u8>> {
    encode_exr(image.width(), image.height(), vec![(name, ex::FlatSamples::F32(image.pixels().to_vec()))], None)
}

/// Encodes one float channel as [`encode_exr_f32`] does, with the values' unit as the file's attribute `unit`.
///
/// # Errors
/// An image without pixels.
pub fn encode_exr_f32_in(image: &Raster<f32>, name: &str, unit: &str) -> Result<Vec<u8>> {
    let channels = vec![(name, ex::FlatSamples::F32(image.pixels().to_vec()))];
    encode_exr(image.width(), image.height(), channels, Some(unit))
}

/// Encodes one unsigned integer channel `id` as EXR.
///
/// # Errors
/// An image without pixels.
pub fn encode_exr_u32(image: &Raster<u32>) -> Result<Vec<u8>> {
    encode_exr(image.width(), image.height(), vec![("id", ex::FlatSamples::U32(image.pixels().to_vec()))], None)
}

/// Encodes linear RGB as EXR (float32).
///
/// # Errors
/// An image without pixels.
pub fn encode_exr_rgb(image: &Raster<[f32; 3]>) -> Result<Vec<u8>> {
    let channel = |c: usize| ex::FlatSamples::F32(image.pixels().iter().map(|p| p[c]).collect());
    encode_exr(image.width(), image.height(), vec![("R", channel(0)), ("G", channel(1)), ("B", channel(2))], None)
}

type Channels = Vec<(String, ex::FlatSamples)>;

/// Compression of an EXR and all channels of its first layer, with its width and height.
fn decode_exr(bytes: &[u8], path: &Path) -> Result<(ex::Compression, (usize, usize, Channels))> {
    use ex::{ReadChannels as _, ReadLayers as _};
    let pixels = || {
        image_header::check_exr(bytes, path)?;
        ex::read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .first_valid_layer()
            .all_attributes()
            .non_parallel()
            .from_buffered(Cursor::new(bytes))
            .map_err(|e| corrupt(path, "EXR", e))
    };
    let image = guarded(pixels).map_err(|e| corrupt(path, "EXR", e))??;
    let (window, layer) = (image.attributes.display_window, image.layer_data);
    if (window.position, window.size) != (layer.attributes.layer_position, layer.size) {
        let (at, size) = (layer.attributes.layer_position - window.position, layer.size);
        let what = format!(
            "it holds {}x{} pixels from ({}, {}) of a display window of {}x{}",
            size.width(),
            size.height(),
            at.x(),
            at.y(),
            window.size.width(),
            window.size.height()
        );
        return Err(Error::invalid(
            path.display().to_string(),
            what,
            "write the whole picture: data window and display window alike",
        ));
    }
    let channels: Channels = layer.channel_data.list.into_iter().map(|c| (c.name.to_string(), c.sample_data)).collect();
    let (width, height) = (layer.size.width(), layer.size.height());
    if channels.iter().any(|(_, s)| s.len() != width * height) {
        return Err(corrupt(path, "EXR", "a subsampled channel"));
    }
    Ok((layer.encoding.compression, (width, height, channels)))
}

fn floats(samples: &ex::FlatSamples) -> Vec<f32> {
    samples.values_as_f32().collect()
}

/// Reads a one-channel EXR as float32.
///
/// # Errors
/// The image is larger than [`MAX_PIXELS`] or [`MAX_EXR_BYTES`], or the file cannot be read, is no complete EXR, or has not exactly one channel.
pub fn read_exr_f32(path: impl AsRef<Path>) -> Result<Raster<f32>> {
    let path = path.as_ref();
    let (_, (width, height, channels)) = decode_exr(&read(path)?, path)?;
    match channels.as_slice() {
        [(_, samples)] => Ok(Raster::from_vec(width, height, floats(samples))),
        _ => Err(wrong_channels(path, &channels, "one float channel")),
    }
}

/// Reads a one-channel EXR of unsigned integers.
///
/// # Errors
/// Those of [`read_exr_f32`], or the channel is not of unsigned integers.
pub fn read_exr_u32(path: impl AsRef<Path>) -> Result<Raster<u32>> {
    let path = path.as_ref();
    let (_, (width, height, mut channels)) = decode_exr(&read(path)?, path)?;
    match (channels.len(), channels.pop()) {
        (1, Some((_, ex::FlatSamples::U32(ids)))) => Ok(Raster::from_vec(width, height, ids)),
        (_, last) => {
            channels.extend(last);
            Err(wrong_channels(path, &channels, "one unsigned integer channel"))
        }
    }
}

/// Reads an EXR's channels R, G, B as float32.
///
/// # Errors
/// Those of [`read_exr_f32`], or a channel is missing.
pub fn read_exr_rgb(path: impl AsRef<Path>) -> Result<Raster<[f32; 3]>> {
    let path = path.as_ref();
    let (_, (width, height, channels)) = decode_exr(&read(path)?, path)?;
    let find = |name: &str| channels.iter().find(|(n, _)| n == name).map(|(_, s)| floats(s));
    let (Some(r), Some(g), Some(b)) = (find("R"), find("G"), find("B")) else {
        return Err(wrong_channels(path, &channels, "channels R, G and B"));
    };
    Ok(Raster::from_vec(width, height, (0..width * height).map(|i| [r[i], g[i], b[i]]).collect()))
}

fn wrong_channels(path: &Path, channels: &Channels, wanted: &str) -> Error {
    let names: Vec<&str> = channels.iter().map(|(n, _)| n.as_str()).collect();
    Error::invalid(path.display().to_string(), format!("has channels [{}]", names.join(", ")), format!("expected {wanted}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_round_trip_bit_by_bit() {
        let dir = tempfile::tempdir().unwrap();
        let rgb = Raster::from_fn(7, 5, |x, y| [x as u8 * 30, y as u8 * 50, (x * y) as u8]);
        write_png(dir.path().join("a/b.png"), &rgb).unwrap();
        assert_eq!(read_png(dir.path().join("a/b.png")).unwrap(), rgb);
        let power = Raster::from_fn(9, 4, |x, y| 1e-12_f32.powf(1.0 + x as f32 / 3.0) * (y as f32));
        let path = dir.path().join("p.exr");
        write_atomic(&path, &encode_exr_f32(&power, "Y").unwrap()).unwrap();
        assert_eq!(read_exr_f32(&path).unwrap(), power);
        let ids = Raster::from_fn(9, 4, |x, y| if x == 0 { u32::MAX } else { (x * 70_000 + y) as u32 });
        write_atomic(&path, &encode_exr_u32(&ids).unwrap()).unwrap();
        assert_eq!(read_exr_u32(&path).unwrap(), ids);
        assert!(read_exr_rgb(&path).unwrap_err().to_string().contains("channels R, G and B"));
        let linear = Raster::from_fn(3, 2, |x, y| [x as f32, y as f32 + 0.25, 1e6]);
        write_atomic(&path, &encode_exr_rgb(&linear).unwrap()).unwrap();
        assert_eq!(read_exr_rgb(&path).unwrap(), linear);
        assert!(read_exr_f32(&path).is_err());
    }

    #[test]
    fn files_cut_short_are_errors_that_name_the_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("cut.bin");
        let png = encode_png(&Raster::from_fn(40, 30, |x, y| [x as u8, y as u8, (x ^ y) as u8])).unwrap();
        let exr = encode_exr_f32(&Raster::from_fn(40, 30, |x, y| (x * y) as f32), "Y").unwrap();
        for cut in [0, 1, 8, 30, png.len() / 2, png.len() - 20] {
            std::fs::write(&path, &png[..cut]).unwrap();
            assert!(read_png(&path).unwrap_err().to_string().contains("cut.bin"), "{cut}");
        }
        for cut in [0, 4, 100, exr.len() / 2, exr.len() - 3] {
            std::fs::write(&path, &exr[..cut]).unwrap();
            assert!(read_exr_f32(&path).unwrap_err().to_string().contains("cut.bin"), "{cut}");
        }
    }

    #[test]
    fn pngs_of_either_depth_are_read_as_16_bits() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("x.png");
        let rgb = Raster::from_fn(7, 5, |x, y| [x as u8 * 30, y as u8 * 50, 255]);
        write_png(&path, &rgb).unwrap();
        assert_eq!(read_png16(&path).unwrap(), rgb.map(|p| p.map(|v| u16::from(v) * 257)));
        let grey = Raster::from_fn(7, 5, |x, y| (9000 * x + y) as u16);
        write_atomic(&path, &encode_png16(&grey).unwrap()).unwrap();
        assert_eq!(read_png16(&path).unwrap(), grey.map(|&v| [v; 3]));
    }

    /// A PNG of samples in a colour type, 8 or 16 bits.
    fn png(samples: &[u8], width: usize, color: image::ColorType) -> Vec<u8> {
        png_bytes(samples, width, samples.len() / width / usize::from(color.bytes_per_pixel()), color).unwrap()
    }

    #[test]
    fn transparency_of_every_kind_is_seen() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.png");
        let wide = |values: [u16; 4]| values.into_iter().flat_map(u16::to_ne_bytes).collect::<Vec<u8>>();
        // Two pixels: one opaque, one transparent or half so. The last is a palette of two colours, the second with alpha 0, written by hand:
        // the encoder at hand writes none.
        for (samples, color, second) in [
            (vec![9, 9, 9, 255, 200, 100, 50, 0], image::ColorType::Rgba8, [200, 100, 50]),
            (vec![9, 9, 9, 255, 200, 100, 50, 128], image::ColorType::Rgba8, [200, 100, 50]),
            (vec![9, 255, 70, 0], image::ColorType::La8, [70; 3]),
            (wide([9 * 257, u16::MAX, 70 * 257, 300]), image::ColorType::La16, [70; 3]),
        ] {
            std::fs::write(&path, png(&samples, 2, color)).unwrap();
            let (rgb, opaque) = read_png_and_opacity(&path).unwrap();
            assert_eq!((rgb.pixels(), opaque.unwrap().pixels()), (&[[9; 3], second][..], &[true, false][..]), "{color:?}");
            assert!(may_be_transparent(&read(&path).unwrap()));
            assert_eq!(image_size(&path).unwrap(), (2, 1));
            assert!(read_png16(&path).unwrap_err().to_string().contains("pixel (1, 0) is transparent"));
        }
        // A channel that is opaque everywhere says nothing.
        std::fs::write(&path, png(&[9, 9, 9, 255], 1, image::ColorType::Rgba8)).unwrap();
        assert!(read_png_and_opacity(&path).unwrap().1.is_none());
        assert_eq!(read_png16(&path).unwrap().pixels(), [[9 * 257; 3]]);
        std::fs::write(&path, png(&[9, 9, 9], 1, image::ColorType::Rgb8)).unwrap();
        assert!(!may_be_transparent(&read(&path).unwrap()) && read_png_and_opacity(&path).unwrap().1.is_none());
        let cut = encode_cut_out(&Raster::filled(2, 1, [1, 2, 3]), &Raster::from_fn(2, 1, |x, _| x == 0)).unwrap();
        std::fs::write(&path, cut).unwrap();
        assert_eq!(read_png_and_opacity(&path).unwrap().1.unwrap().pixels(), [true, false]);
    }

    #[test]
    fn a_palette_with_transparent_entries_is_seen() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("p.png");
        // Two pixels of 8 bits, of entries 0 and 1, of which the second is transparent.
        let chunk = |kind: &[u8; 4], data: &[u8]| {
            let body = [&kind[..], data].concat();
            let mut crc = flate2::Crc::new();
            crc.update(&body);
            [&(data.len() as u32).to_be_bytes()[..], &body, &crc.sum().to_be_bytes()].concat()
        };
        let mut rows = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
        rows.write_all(&[0, 0, 1]).unwrap();
        let bytes = [
            b"\x89PNG\r\n\x1a\n".to_vec(),
            chunk(b"IHDR", &[0, 0, 0, 2, 0, 0, 0, 1, 8, 3, 0, 0, 0]),
            chunk(b"PLTE", &[10, 20, 30, 40, 50, 60]),
            chunk(b"tRNS", &[255, 0]),
            chunk(b"IDAT", &rows.finish().unwrap()),
            chunk(b"IEND", &[]),
        ];
        std::fs::write(&path, bytes.concat()).unwrap();
        let (rgb, opaque) = read_png_and_opacity(&path).unwrap();
        assert_eq!((rgb.pixels(), opaque.unwrap().pixels()), (&[[10, 20, 30], [40, 50, 60]][..], &[true, false][..]));
        assert!(may_be_transparent(&read(&path).unwrap()));
    }

    #[test]
    fn a_mask_says_so_by_colour_or_by_transparency() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("m.png");
        let mask = |samples: &[u8], color| {
            std::fs::write(&path, png(samples, 2, color)).unwrap();
            read_mask(&path).map(|m| m.pixels().to_vec()).map_err(|e| e.to_string())
        };
        let (rgba, la) = (image::ColorType::Rgba8, image::ColorType::La8);
        assert_eq!(mask(&[0, 1], image::ColorType::L8).unwrap(), [false, true]);
        assert_eq!(mask(&[255, 255, 255, 0, 255, 255, 255, 255], rgba).unwrap(), [false, true], "white everywhere");
        assert_eq!(mask(&[255, 1, 0, 255], la).unwrap(), [true, false], "black, and almost transparent");
        assert_eq!(mask(&[0, 255, 0, 255], la).unwrap(), [false, false], "black and opaque leaves all out");
        for ambiguous in [[0, 0, 0, 255], [255, 0, 0, 255], [0, 0, 0, 0]] {
            assert!(mask(&ambiguous, la).unwrap_err().contains("black or transparent"), "{ambiguous:?}");
        }
    }

    #[test]
    fn sha256_of_abc() {
        assert_eq!(sha256_hex(b"abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }
}
