//! Niantic's `.spz`, version 3: quantised arrays, one behind the other, in gzip.

use super::{byte, normalised};
use crate::files::ply::SingleModality;
use crate::gaussians::sigmoid;
use crate::{Error, Result};
use flate2::{Compression, GzBuilder};
use std::io::Write;

/// "NGSP", little endian.
const MAGIC: u32 = 0x5053_474e;
/// The first version with rotations of four bytes.
const VERSION: u32 = 3;
/// Flag of fields trained with opacity compensated for the pixel's own extent.
const ANTIALIASED: u8 = 1;
/// Most fractional bits of a position: steps of 0.24 mm, up to 2048 m.
const FRACTIONAL_BITS: u32 = 12;
/// Bytes that a unit of a degree-0 coefficient spans, of 255.
const COLOR_SCALE: f32 = 0.15;

/// How many numbers lay outside of what the format can hold, and were set to its end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SpzClamped {
    /// Degree-0 coefficients beyond ±3.33.
    pub colors: usize,
    /// Standard deviations outside of 45 µm to 380 m.
    pub scales: usize,
    /// Higher coefficients outside of -1 to 127/128.
    pub harmonics: usize,
}

/// A field of three channels as `.spz`; its frame is to be [`Frame::YUp`](super::Frame), the format's. Positions are fixed-point numbers of 24 bits,
/// everything else has 8 bits but for rotations: the three smaller components of the quaternion, 10 bits each, and which one is missing.
///
/// # Errors
/// A position too far away for 24 bits; more than 2³² − 1 Gaussians.
pub fn encode_spz(field: &SingleModality, antialiased: bool) -> Result<(Vec<u8>, SpzClamped)> {
    let a = &field.appearance;
    let n = field.position.len();
    let farthest = field.position.iter().flatten().fold(0.0_f32, |m, v| m.max(v.abs()));
    let fits = |bits: &u32| (farthest * (1_u32 << bits) as f32).round() < (1 << 23) as f32;
    let far = || {
        let what = format!("a Gaussian lies {farthest} m from the origin");
        Error::invalid("spz", what, "positions have 24 bits, which end at 8388 km: export a PLY")
    };
    let bits = (0..=FRACTIONAL_BITS).rev().find(fits).ok_or_else(far)?;
    let count = u32::try_from(n).map_err(|_| Error::invalid("spz", format!("{n} Gaussians"), "export a PLY"))?;
    let mut clamped = SpzClamped::default();
    let mut data = Vec::with_capacity(16 + n * (9 + 1 + 3 + 3 + 4 + a.stride()));
    for word in [MAGIC, VERSION, count] {
        data.extend(word.to_le_bytes());
    }
    data.extend([a.sh_degree as u8, bits as u8, if antialiased { ANTIALIASED } else { 0 }, 0]);
    for v in field.position.iter().flatten() {
        let fixed = (v * (1_u32 << bits) as f32).round() as i32;
        data.extend(&fixed.to_le_bytes()[..3]);
    }
    let mut push = |value: f32, count: &mut usize| {
        let (value, outside) = byte(value);
        *count += usize::from(outside);
        data.push(value);
    };
    let mut none = 0;
    a.opacity_logit.iter().for_each(|v| push(255.0 * sigmoid(*v), &mut none));
    for sh in a.sh.chunks_exact(a.stride()) {
        sh[..3].iter().for_each(|v| push(255.0 * (COLOR_SCALE * v + 0.5), &mut clamped.colors));
    }
    field.log_scale.iter().flatten().for_each(|v| push(16.0 * (v + 10.0), &mut clamped.scales));
    field.rotation.iter().for_each(|q| data.extend(smallest_three(*q).to_le_bytes()));
    for v in a.sh.chunks_exact(a.stride()).flat_map(|sh| &sh[3..]) {
        let (value, outside) = byte(128.0 * v + 128.0);
        clamped.harmonics += usize::from(outside);
        data.push(value);
    }
    let io = |source| Error::Io { action: "compress", path: "spz".into(), source };
    // Without a time in its header, the same field has the same bytes.
    let mut gzip = GzBuilder::new().mtime(0).write(Vec::new(), Compression::best());
    gzip.write_all(&data).map_err(io)?;
    Ok((gzip.finish().map_err(io)?, clamped))
}

/// The index of the largest component of x, y, z, w in two bits, then sign and nine bits of each other one, in units of √½ / 511; the largest is
/// positive.
fn smallest_three(q: [f32; 4]) -> u32 {
    let [w, x, y, z] = normalised(q);
    let q = [x, y, z, w];
    let largest = (1..4).fold(0, |best, i| if q[i].abs() > q[best].abs() { i } else { best });
    let others = (0..4).filter(|i| *i != largest);
    others.fold(largest as u32, |packed, i| {
        let negative = (q[i] < 0.0) != (q[largest] < 0.0);
        let magnitude = (511.0 * std::f32::consts::SQRT_2 * q[i].abs()).round().min(511.0) as u32;
        packed << 10 | u32::from(negative) << 9 | magnitude
    })
}
