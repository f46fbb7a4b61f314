//! Arrays of numbers on disk with a header that says what they are: a trained network, or one in training.
//!
//! ```text
//! corf-network/1\n   length of the header (u64)   header (JSON)   numbers (f32)   checksum (u64)
//! ```
//! All little-endian.

use crate::{Error, Result, files::checksum::checksum};
use corf_scene::io;
use serde::{Serialize, de::DeserializeOwned};
use std::path::Path;

const MAGIC: &[u8] = b"corf-network/1\n";

/// Writes a header and arrays whole or not at all.
///
/// # Errors
/// A number that is not finite; a file that cannot be written.
pub fn write(path: &Path, header: &impl Serialize, arrays: &[&[f32]]) -> Result<()> {
    if arrays.iter().any(|a| a.iter().any(|v| !v.is_finite())) {
        let help = "the network has diverged: train it with a smaller rate";
        return Err(Error::invalid(path.display().to_string(), "a parameter of the network is not a finite number", help));
    }
    let failed = |e: serde_json::Error| Error::Io { action: "write", path: path.to_owned(), source: e.into() };
    let header = serde_json::to_vec(header).map_err(failed)?;
    let mut bytes = MAGIC.to_vec();
    bytes.extend((header.len() as u64).to_le_bytes());
    bytes.extend(&header);
    for array in arrays {
        bytes.extend(array.iter().flat_map(|v| v.to_le_bytes()));
    }
    bytes.extend(checksum(&bytes).to_le_bytes());
    Ok(io::write_atomic(path, &bytes)?)
}

/// Reads what [`write()`] wrote; `sizes` says from the header how many numbers each array has.
///
/// # Errors
/// A file that is missing, damaged or something else, a header that `sizes` refuses.
pub fn read<H: DeserializeOwned>(path: &Path, sizes: impl FnOnce(&H) -> Result<Vec<usize>>) -> Result<(H, Vec<Vec<f32>>)> {
    let bytes = io::read(path)?;
    let refuse = || {
        let help = "make it again with the command that made it";
        Error::invalid(path.display().to_string(), "this is no network of this version, or a damaged one", help)
    };
    let (header, mut numbers) = content(&bytes).ok_or_else(refuse)?;
    let header: H = serde_json::from_slice(header).map_err(|_| refuse())?;
    let mut arrays = vec![];
    for size in sizes(&header)? {
        let (now, later) = size.checked_mul(4).and_then(|bytes| numbers.split_at_checked(bytes)).ok_or_else(refuse)?;
        arrays.push(now.as_chunks().0.iter().map(|word| f32::from_le_bytes(*word)).collect());
        numbers = later;
    }
    let whole = numbers.is_empty() && arrays.iter().all(|a: &Vec<f32>| a.iter().all(|v| v.is_finite()));
    if whole { Ok((header, arrays)) } else { Err(refuse()) }
}

/// Header and numbers of a file that is whole.
fn content(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let (content, sum) = bytes.split_at_checked(bytes.len().checked_sub(8)?)?;
    if checksum(content).to_le_bytes() != sum {
        return None;
    }
    let (length, rest) = content.strip_prefix(MAGIC)?.split_at_checked(8)?;
    rest.split_at_checked(usize::try_from(u64::from_le_bytes(length.try_into().ok()?)).ok()?)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]

    use super::*;

    #[test]
    fn what_is_written_is_read_and_what_is_damaged_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("n");
        let (a, b) = ([1.0f32, -2.5], [3.0f32, f32::MIN_POSITIVE, 0.0]);
        write(&path, &("tag", 7), &[&a, &b]).unwrap();
        let sizes = |_: &(String, u32)| Ok(vec![2, 3]);
        let (header, arrays) = read(&path, sizes).unwrap();
        assert_eq!((header.0.as_str(), header.1), ("tag", 7));
        assert_eq!(arrays, [a.to_vec(), b.to_vec()]);
        for wrong in [vec![2, 2], vec![2, 3, 1], vec![usize::MAX]] {
            assert!(read(&path, |_: &(String, u32)| Ok(wrong.clone())).is_err());
        }
        let bytes = std::fs::read(&path).unwrap();
        for cut in 0..bytes.len() {
            std::fs::write(&path, &bytes[..cut]).unwrap();
            assert!(read(&path, sizes).is_err(), "{cut} bytes");
            let mut changed = bytes.clone();
            changed[cut] ^= 4;
            std::fs::write(&path, &changed).unwrap();
            assert!(read(&path, sizes).is_err(), "byte {cut}");
        }
        assert!(write(&path, &0, &[&[f32::NAN]]).unwrap_err().to_string().contains("diverged"));
    }
}
