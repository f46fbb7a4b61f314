//! Checks of the headers of image files, before memory is allocated for their pixels.
//!
//! A header is a few bytes, and the size in it can be anything. Here a size must be within a stated bound, and the file must be long enough
//! to hold it: no compression packs more than so many bytes into one.

use crate::{Error, Result};
use exr::prelude as ex;
use std::io::Cursor;
use std::path::Path;

/// Most pixels an image may have: 16 384 × 8 192, half a gigabyte as 8-bit RGBA.
pub const MAX_PIXELS: u64 = crate::bounds::MAX_PIXELS as u64;
/// Most bytes of samples an EXR may have in all its channels.
pub const MAX_EXR_BYTES: u64 = 1 << 31;
/// Deflate's largest ratio (RFC 1951: two bits for a match of 258 bytes).
const DEFLATE_RATIO: u64 = 1032;
/// The largest ratio of an EXR compression but DWA: deflate on floats that were cut to 24 bits.
const EXR_RATIO: u64 = DEFLATE_RATIO * 4 / 3;
/// DWA deflates a cosine transform in which blocks of 64 samples may be one.
const DWA_RATIO: u64 = EXR_RATIO * 64;
/// JPEG spends a bit or more on every block of 8 × 8 pixels.
const JPEG_PIXELS_A_BYTE: u64 = 8 * 64;
/// A chunk of an EXR has an entry in the table of offsets and two numbers before its data.
const EXR_CHUNK_BYTES: u64 = 16;

const DAMAGED: &str = "the file is damaged or cut short; restore it, or delete it and generate it again";

/// A number of bytes as a person reads it.
fn readable(bytes: u64) -> String {
    match bytes {
        0..1_000 => format!("{bytes} bytes"),
        1_000..1_000_000 => format!("{:.1} kB", bytes as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", bytes as f64 / 1e6),
        _ => format!("{:.1} GB", bytes as f64 / 1e9),
    }
}

fn fault(path: &Path, what: impl Into<String>) -> Error {
    Error::invalid(path.display().to_string(), what, DAMAGED)
}

fn bounded(path: &Path, width: u64, height: u64, bytes: u64, most_bytes: u64) -> Result<()> {
    if width == 0 || height == 0 {
        return Err(fault(path, format!("declares {width} x {height} pixels: an image without any")));
    }
    if width.saturating_mul(height) > MAX_PIXELS || bytes > most_bytes {
        return Err(Error::invalid(
            path.display().to_string(),
            format!(
                "declares {width} x {height} pixels ({} when decoded); images of up to {MAX_PIXELS} pixels and {} are read",
                readable(bytes),
                readable(most_bytes)
            ),
            "make the image smaller; if it is not as large as that, the file is damaged: restore it",
        ));
    }
    Ok(())
}

/// Checks a PNG's or JPEG's header; what is neither is left to the decoder, which knows no other.
///
/// # Errors
/// A size past [`MAX_PIXELS`] or one that the file's bytes cannot hold; a palette that is no list of colours; a JPEG that does not end.
pub(super) fn check_png_or_jpeg(bytes: &[u8], path: &Path) -> Result<()> {
    if bytes.starts_with(b"\x89PNG\r\n\x1a\n") {
        return check_png(bytes, path);
    }
    if bytes.starts_with(b"\xff\xd8\xff") { check_jpeg(bytes, path) } else { Ok(()) }
}

fn big_endian(bytes: &[u8]) -> u64 {
    bytes.iter().fold(0, |n, b| n << 8 | u64::from(*b))
}

/// The chunks up to the pixels: the header's size, and a palette's length (PNG, third edition, 11.2).
fn check_png(bytes: &[u8], path: &Path) -> Result<()> {
    let mut rest = &bytes[8..];
    let mut first = true;
    while let Some((head, behind)) = rest.split_at_checked(8) {
        let (length, kind) = (big_endian(&head[..4]), &head[4..]);
        let data = usize::try_from(length).ok().and_then(|n| behind.get(..n));
        let Some(data) = data else { return Err(fault(path, "not a readable PNG: it ends within a chunk")) };
        match (kind, data) {
            (b"IHDR", [size @ .., depth, color, _, _, _]) if size.len() == 8 => {
                let (width, height) = (big_endian(&size[..4]), big_endian(&size[4..]));
                let samples = match color {
                    0 | 3 => 1,
                    4 => 2,
                    2 => 3,
                    6 => 4,
                    _ => return Err(fault(path, format!("not a readable PNG: colour type {color}"))),
                };
                bounded(path, width, height, width.saturating_mul(height).saturating_mul(4), 4 * MAX_PIXELS)?;
                // Both are within 2^27 here.
                let raw = height * (1 + (width * samples * u64::from(*depth)).div_ceil(8));
                held(path, "PNG", width, height, raw, bytes.len() as u64, DEFLATE_RATIO)?;
            }
            (b"IHDR", _) => return Err(fault(path, "not a readable PNG: its header is not 13 bytes long")),
            _ if first => return Err(fault(path, "not a readable PNG: it does not begin with its header")),
            (b"PLTE", colors) if colors.is_empty() || colors.len() % 3 != 0 || colors.len() > 768 => {
                return Err(fault(
                    path,
                    format!("not a readable PNG: its palette has {} bytes, not 3 for each of 1 to 256 colours", colors.len()),
                ));
            }
            (b"IDAT", _) => return Ok(()),
            _ => {}
        }
        first = false;
        // Behind the data stands its checksum.
        rest = behind.get(data.len() + 4..).unwrap_or(&[]);
    }
    Err(fault(path, "not a readable PNG: it ends before its pixels"))
}

/// Whether a PNG or JPEG can have transparent pixels, by the chunks before its pixels: an alpha channel, or a list of transparent colours.
pub(super) fn has_alpha(bytes: &[u8]) -> bool {
    if !bytes.starts_with(b"\x89PNG\r\n\x1a\n") {
        return false;
    }
    let mut rest = &bytes[8..];
    while let Some((head, behind)) = rest.split_at_checked(8) {
        let Some(data) = usize::try_from(big_endian(&head[..4])).ok().and_then(|n| behind.get(..n)) else { return false };
        match (&head[4..], data) {
            (b"IHDR", [.., 4 | 6, _, _, _]) => return true,
            (b"tRNS", _) => return true,
            (b"IDAT", _) => return false,
            _ => rest = behind.get(data.len() + 4..).unwrap_or(&[]),
        }
    }
    false
}

/// The segments up to the first scan: the frame's size; behind it, the mark that ends the image (ITU-T T.81, annex B).
fn check_jpeg(bytes: &[u8], path: &Path) -> Result<()> {
    let mut at = 2;
    loop {
        // Marks may be padded with 0xff, and decoders pass over bytes before one.
        while bytes.get(at).is_some_and(|b| *b != 0xff || bytes.get(at + 1) == Some(&0xff)) {
            at += 1;
        }
        let Some([0xff, mark, high, low]) = bytes.get(at..at + 4) else {
            return Err(fault(path, "not a readable JPEG: it ends before its pixels"));
        };
        // Marks without a segment: restarts, the start, TEM, and a byte that stands for itself.
        if matches!(mark, 0xd0..=0xd8 | 0x00 | 0x01) {
            at += 2;
            continue;
        }
        let data = bytes.get(at + 4..at + 2 + usize::from(u16::from_be_bytes([*high, *low])));
        let Some(data) = data else { return Err(fault(path, "not a readable JPEG: it ends within a segment")) };
        match (mark, data) {
            // Start of frame; DHT, JPG and DAC share the range.
            (0xc0..=0xcf, [_, size @ ..]) if !matches!(mark, 0xc4 | 0xc8 | 0xcc) && size.len() >= 4 => {
                let (height, width) = (big_endian(&size[..2]), big_endian(&size[2..4]));
                bounded(path, width, height, width * height * 4, 4 * MAX_PIXELS)?;
                held(path, "JPEG", width, height, width * height, bytes.len() as u64, JPEG_PIXELS_A_BYTE)?;
            }
            // Start of scan.
            (0xda, _) => {
                let ends = bytes[at..].windows(2).any(|w| w == [0xff, 0xd9]);
                return if ends { Ok(()) } else { Err(fault(path, "not a readable JPEG: it is cut short")) };
            }
            _ => {}
        }
        at += 4 + data.len();
    }
}

/// Whether a file of `length` bytes can hold `units` of which it packs at most `a_byte` into one.
fn held(path: &Path, kind: &str, width: u64, height: u64, units: u64, length: u64, a_byte: u64) -> Result<()> {
    if units <= length.saturating_mul(a_byte) {
        return Ok(());
    }
    Err(fault(
        path,
        format!("not a readable {kind}: it declares {width} x {height} pixels, which its {length} bytes cannot hold"),
    ))
}

/// Checks the headers of an EXR.
///
/// # Errors
/// They cannot be read; a layer has more than [`MAX_PIXELS`] or [`MAX_EXR_BYTES`], or more than the file's bytes can hold.
pub(super) fn check_exr(bytes: &[u8], path: &Path) -> Result<()> {
    let length = bytes.len() as u64;
    let meta = ex::MetaData::read_from_buffered(Cursor::new(bytes), false)
        .map_err(|e| fault(path, format!("not a readable EXR: {e}")))?;
    for header in meta.headers.iter().filter(|h| !h.deep) {
        let (width, height) = (header.layer_size.width() as u64, header.layer_size.height() as u64);
        let a_pixel: u64 = header.channels.list.iter().map(|c| c.sample_type.bytes_per_sample() as u64).sum();
        let samples = width.saturating_mul(height).saturating_mul(a_pixel);
        bounded(path, width, height, samples, MAX_EXR_BYTES)?;
        // Subsampled channels have less, and are refused later; further levels have more.
        let ratio =
            if matches!(header.compression, ex::Compression::DWAA(_) | ex::Compression::DWAB(_)) { DWA_RATIO } else { EXR_RATIO };
        let chunks = (header.chunk_count as u64).saturating_mul(EXR_CHUNK_BYTES);
        held(path, "EXR", width, height, samples, length, ratio)?;
        held(path, "EXR", width, height, chunks, length, 1)?;
    }
    Ok(())
}
