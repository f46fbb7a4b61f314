//! One modality's Gaussians in the formats of splat viewers.

mod splat;
mod spz;
mod turn;

pub use splat::encode_splat;
pub use spz::{SpzClamped, encode_spz};
pub use turn::{Frame, turned};

use crate::files::ply::SingleModality;

impl SingleModality {
    /// The same with harmonics up to `sh_degree`, at least its own; the new ones are zero.
    pub fn padded(&self, sh_degree: usize) -> Self {
        let mut out = self.clone();
        let stride = self.appearance.stride();
        out.appearance.sh_degree = sh_degree.max(self.appearance.sh_degree);
        let widened = out.appearance.stride();
        let mut sh = vec![0.0; self.position.len() * widened];
        for (to, from) in sh.chunks_exact_mut(widened).zip(self.appearance.sh.chunks_exact(stride)) {
            to[..stride].copy_from_slice(from);
        }
        out.appearance.sh = sh;
        out
    }

    /// The same with three equal channels where there is one: grey.
    pub fn in_three_channels(&self) -> Self {
        let mut out = self.clone();
        if self.appearance.channels == 1 {
            out.appearance.channels = 3;
            out.appearance.sh = self.appearance.sh.iter().flat_map(|v| [*v; 3]).collect();
        }
        out
    }
}

/// Nearest of 0 to 255, and whether the value lies outside.
fn byte(value: f32) -> (u8, bool) {
    let rounded = value.round();
    (rounded.clamp(0.0, 255.0) as u8, !(0.0..=255.0).contains(&rounded))
}

/// A unit quaternion (w, x, y, z); none of a field's is zero.
fn normalised(q: [f32; 4]) -> [f32; 4] {
    let norm = q.iter().map(|c| c * c).sum::<f32>().sqrt();
    q.map(|c| c / norm)
}

#[cfg(test)]
mod tests;
