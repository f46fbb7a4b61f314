//! The files that an input is taken for: several of them stand in one, and readers of paths want them on disk.

use anyhow::Result;
use std::path::{Path, PathBuf};

/// What stands between the files of an input that has several.
pub const SEPARATOR: &[u8] = b"\n=====\n";

/// An input's files: what stands before the first separator, between it and the next, and so on.
pub(crate) fn parts<const N: usize>(bytes: &[u8]) -> [&[u8]; N] {
    let mut rest = bytes;
    std::array::from_fn(|_| match rest.windows(SEPARATOR.len()).position(|w| w == SEPARATOR) {
        Some(at) => {
            let part = &rest[..at];
            rest = &rest[at + SEPARATOR.len()..];
            part
        }
        None => std::mem::take(&mut rest),
    })
}

/// Writes an input to a file of the folder.
pub(crate) fn put(folder: &Path, name: &str, bytes: &[u8]) -> Result<PathBuf> {
    let path = folder.join(name);
    std::fs::write(&path, bytes)?;
    Ok(path)
}
