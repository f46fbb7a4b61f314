//! Files: whole or not at all. PNG and EXR in and out; every write goes to a temporary name beside the target, onto the disk, and is
//! renamed then.

#[cfg(test)]
mod bounds_tests;
mod image_header;
mod map;
mod regular;

use crate::guard::guarded;
use crate::{Error, Raster, Result};
use exr::prelude as ex;
pub use image_header::{MAX_EXR_BYTES, MAX_PIXELS};
pub use map::{DEPTH_UNIT_M, Map, Stored, read_map};
pub use regular::{MAX_CONFIG_BYTES, open, read, read_config_text, read_text};
use sha2::{Digest, Sha256};
use std::io::{Cursor, Write};
use std::path::Path;

/// Prefix and suffix of the names of temporary files.
const TEMPORARY: [&str; 2] = [".corf-", ".tmp"];

/// Whether a file's name is one that [`write_atomic`] gives while it writes.
pub fn is_temporary(name: &std::ffi::OsStr) -> bool {
    name.to_str().is_some_and(|n| n.starts_with(TEMPORARY[0]) && n.ends_with(TEMPORARY[1]))
}

/// Removes the temporary files that a process which was killed while it wrote left below `dir`; links are not followed.
///
/// # Errors
/// A folder that cannot be read, or a file that cannot be removed.
pub fn remove_temporary_files(dir: &Path) -> Result<()> {
    for entry in std::fs::read_dir(dir).map_err(Error::io("read", dir))? {
        let entry = entry.map_err(Error::io("read", dir))?;
        let kind = entry.file_type().map_err(Error::io("read", entry.path()))?;
        if kind.is_dir() {
            remove_temporary_files(&entry.path())?;
        } else if kind.is_file() && is_temporary(&entry.file_name()) {
            std::fs::remove_file(entry.path()).map_err(Error::io("remove", entry.path()))?;
        }
    }
    Ok(())
}

/// Writes `bytes` to `path` (its folder is created): a reader sees the old file or the whole new one, never a part, even after a power
/// failure, for the bytes are on the disk before the file has its name.
///
/// # Errors
/// The folder or the file cannot be written.
pub fn write_atomic(path: impl AsRef<Path>, bytes: &[u8]) -> Result<()> {
    let path = path.as_ref();
    let dir = match path.parent() {
        Some(parent) if parent != Path::new("") => parent,
        _ => Path::new("."),
    };
    std::fs::create_dir_all(dir).map_err(Error::io("create", dir))?;
    let mut file = tempfile::Builder::new()
        .prefix(TEMPORARY[0])
        .suffix(TEMPORARY[1])
        .permissions_if_unix()
        .tempfile_in(dir)
        .map_err(Error::io("create a file in", dir))?;
    file.write_all(bytes).and_then(|()| file.as_file().sync_all()).map_err(Error::io("write", path))?;
    file.persist(path).map_err(|e| Error::io("write", path)(e.error))?;
    sync_folder(dir);
    Ok(())
}

/// Brings a folder's names onto the disk. Not every file system can; the file is there all the same.
fn sync_folder(dir: &Path) {
    #[cfg(unix)]
    let _ = std::fs::File::open(dir).and_then(|folder| folder.sync_all());
    #[cfg(not(unix))]
    let _ = dir;
}

/// Temporary files are private by default; what is published follows the umask like any other file.
trait PublicPermissions {
    fn permissions_if_unix(&mut self) -> &mut Self;
}

impl PublicPermissions for tempfile::Builder<'_, '_> {
    #[cfg(unix)]
    fn permissions_if_unix(&mut self) -> &mut Self {
        use std::os::unix::fs::PermissionsExt;
        self.permissions(std::fs::Permissions::from_mode(0o666))
    }
    #[cfg(not(unix))]
    fn permissions_if_unix(&mut self) -> &mut Self {
        self
    }
}

/// Compresses as gzip; the same bytes give the same bytes.
///
/// # Errors
/// None that a buffer in memory can have.
pub fn gzip(bytes: &[u8]) -> Result<Vec<u8>> {
    let mut encoder = flate2::GzBuilder::new().mtime(0).write(Vec::new(), flate2::Compression::best());
    encoder.write_all(bytes).and_then(|()| encoder.finish()).map_err(Error::io("compress into", "memory"))
}

/// Most bytes of text that a gzip file may hold: a few hundred thousand paths of a keyframe.
pub const MAX_GZIP_TEXT_BYTES: u64 = 1 << 28;

/// Reads a gzip-compressed text file, all of its members.
///
/// # Errors
/// The file cannot be read, is no whole gzip file, holds no UTF-8 or more than [`MAX_GZIP_TEXT_BYTES`].
pub fn read_gzip_text(path: impl AsRef<Path>) -> Result<String> {
    gunzip_text(&read(path.as_ref())?, path, MAX_GZIP_TEXT_BYTES)
}

/// The text of up to `most_bytes` in gzip's `bytes`; `path` names them in messages.
fn gunzip_text(bytes: &[u8], path: impl AsRef<Path>, most_bytes: u64) -> Result<String> {
    use std::io::Read as _;
    let path = path.as_ref();
    let mut text = Vec::new();
    // Nothing is taken in advance: memory grows with what comes out, up to the bound.
    flate2::read::MultiGzDecoder::new(bytes)
        .take(most_bytes + 1)
        .read_to_end(&mut text)
        .map_err(|e| corrupt(path, "gzip text", e))?;
    if text.len() as u64 > most_bytes {
        return Err(Error::invalid(
            path.display().to_string(),
            format!("its {} bytes hold more than {most_bytes} bytes of text", bytes.len()),
            "a file of paths is smaller than that; the file is damaged, or no file of paths",
        ));
    }
    String::from_utf8(text).map_err(|e| corrupt(path, "gzip text", e))
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

/// Reads a PNG (or JPEG) as 8-bit RGB; alpha is dropped.
///
/// # Errors
/// The file cannot be read or is no complete image.
pub fn read_png(path: impl AsRef<Path>) -> Result<Raster<[u8; 3]>> {
    let bytes = read(path.as_ref())?;
    Ok(decode_rgba(&bytes, path)?.map(|p| [p[0], p[1], p[2]]))
}

/// Encodes a mask as an 8-bit grey PNG: white where a pixel counts, black where it does not.
///
/// # Errors
/// An image without pixels.
pub fn encode_mask(mask: &Raster<bool>) -> Result<Vec<u8>> {
    encode_png8(&mask.map(|counts| if *counts { u8::MAX } else { 0 }))
}

/// Reads a mask: a pixel counts where it is not black. Alpha is dropped.
///
/// # Errors
/// The file cannot be read or is no complete image, or it is a JPEG, whose black is not quite black.
pub fn read_mask(path: impl AsRef<Path>) -> Result<Raster<bool>> {
    let path = path.as_ref();
    if image::guess_format(&read(path)?).ok() == Some(image::ImageFormat::Jpeg) {
        return Err(Error::invalid(
            path.display().to_string(),
            "a mask as a JPEG, whose black is not quite black",
            "write masks as PNG",
        ));
    }
    Ok(read_png16(path)?.map(|p| *p != [0; 3]))
}

/// Reads a PNG of 8 or 16 bits as 16-bit RGB: 8-bit values times 257, which is the same share of full scale; grey is three equal channels,
/// alpha is dropped.
///
/// # Errors
/// The file cannot be read or is no complete image.
pub fn read_png16(path: impl AsRef<Path>) -> Result<Raster<[u16; 3]>> {
    let path = path.as_ref();
    let rgb = decode_image(&read(path)?, path, image::DynamicImage::into_rgb16)?;
    let (width, height) = (rgb.width() as usize, rgb.height() as usize);
    Ok(Raster::from_vec(width, height, rgb.pixels().map(|p| p.0).collect()))
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
    let layer = image.layer_data;
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

    #[test]
    fn sha256_of_abc() {
        assert_eq!(sha256_hex(b"abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    }
}
