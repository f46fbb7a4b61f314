//! A file of some metadata and a device's state: what checkpoints of reconstructions are made of.
//!
//! ```text
//! magic line   length of the header (u64)   header (JSON)   numbers (f32 and u32)   checksum (u64)
//! ```
//! All little-endian. The numbers are, for the Gaussians and Adam's two moments, position, rotation, ln scale, opacity and harmonics in
//! light, opacity and harmonics at 60 GHz; then the position rates, and then whatever words the kind of file adds.

use crate::{Appearance, Error, Gaussians, Result, device::DeviceState, files::checksum::checksum};
use corf_scene::io;
use serde::{Serialize, de::DeserializeOwned};
use std::path::Path;

/// Metadata that says how many Gaussians of which kind follow.
pub trait Header: Serialize + DeserializeOwned {
    /// First line of the file, with its version.
    const MAGIC: &'static str;

    /// Number of Gaussians.
    fn gaussians(&self) -> usize;

    /// No Gaussians, of the channels and degrees of those in the file.
    fn empty_field(&self) -> Gaussians;

    /// Number of words behind the device's state.
    fn more_words(&self) -> Option<usize>;
}

/// Writes a file whole or not at all.
///
/// # Errors
/// A file that cannot be written.
pub fn write<H: Header>(path: &Path, header: &H, state: &DeviceState, more: &[u32]) -> Result<()> {
    let text = serde_json::to_vec(header).map_err(|e| Error::Io { action: "write", path: path.to_owned(), source: e.into() })?;
    let mut bytes = H::MAGIC.as_bytes().to_vec();
    bytes.extend((text.len() as u64).to_le_bytes());
    bytes.extend(&text);
    let mut put = |numbers: &[f32]| {
        bytes.reserve(4 * numbers.len());
        numbers.iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
    };
    for g in [&state.gaussians, &state.moments[0], &state.moments[1]] {
        parts(g).into_iter().for_each(&mut put);
    }
    put(&state.position_rate);
    bytes.extend(more.iter().flat_map(|v| v.to_le_bytes()));
    bytes.extend(checksum(&bytes).to_le_bytes());
    Ok(io::write_atomic(path, &bytes)?)
}

/// Reads one back: the header, the device's state, and the words behind it.
///
/// # Errors
/// A file that cannot be read, is damaged, or is of another kind or version.
pub fn read<H: Header>(path: &Path) -> Result<(H, DeviceState, Vec<u32>)> {
    let bytes = io::read(path)?;
    decode(&bytes).ok_or_else(|| {
        let help = "remove the file and start the reconstruction anew";
        Error::invalid(path.display().to_string(), "this is no checkpoint of this version, or a damaged one", help)
    })
}

fn decode<H: Header>(bytes: &[u8]) -> Option<(H, DeviceState, Vec<u32>)> {
    let (content, sum) = bytes.split_at_checked(bytes.len().checked_sub(8)?)?;
    if checksum(content).to_le_bytes() != sum {
        return None;
    }
    let rest = content.strip_prefix(H::MAGIC.as_bytes())?;
    let (length, rest) = rest.split_at_checked(8)?;
    let (header, numbers) = rest.split_at_checked(usize::try_from(u64::from_le_bytes(length.try_into().ok()?)).ok()?)?;
    let header: H = serde_json::from_slice(header).ok()?;
    let n = header.gaussians();
    let mut words = Words(numbers);
    let empty = header.empty_field();
    let gaussians = words.gaussians(n, &empty)?;
    let moments = [words.gaussians(n, &empty)?, words.gaussians(n, &empty)?];
    let position_rate = words.take(n)?;
    let more = words.take(header.more_words()?)?.into_iter().map(f32::to_bits).collect();
    words.0.is_empty().then_some((header, DeviceState { gaussians, moments, position_rate }, more))
}

/// The arrays of some Gaussians, in the file's order.
fn parts(g: &Gaussians) -> [&[f32]; 7] {
    [
        g.position.as_flattened(),
        g.rotation.as_flattened(),
        g.log_scale.as_flattened(),
        &g.optical.opacity_logit,
        &g.optical.sh,
        &g.rf.opacity_logit,
        &g.rf.sh,
    ]
}

/// Numbers still to be read.
struct Words<'a>(&'a [u8]);

impl Words<'_> {
    fn take(&mut self, count: usize) -> Option<Vec<f32>> {
        let (now, later) = self.0.split_at_checked(count.checked_mul(4)?)?;
        self.0 = later;
        Some(now.as_chunks().0.iter().map(|word| f32::from_le_bytes(*word)).collect())
    }

    fn gaussians(&mut self, n: usize, like: &Gaussians) -> Option<Gaussians> {
        fn grouped<const K: usize>(flat: &[f32]) -> Vec<[f32; K]> {
            flat.as_chunks().0.to_vec()
        }
        let position = grouped(&self.take(n.checked_mul(3)?)?);
        let rotation = grouped(&self.take(n.checked_mul(4)?)?);
        let log_scale = grouped(&self.take(n.checked_mul(3)?)?);
        let mut appearance = |like: &Appearance| {
            let opacity_logit = self.take(n)?;
            let sh = self.take(n.checked_mul(like.stride())?)?;
            Some(Appearance { channels: like.channels, sh_degree: like.sh_degree, opacity_logit, sh })
        };
        Some(Gaussians { position, rotation, log_scale, optical: appearance(&like.optical)?, rf: appearance(&like.rf)? })
    }
}
