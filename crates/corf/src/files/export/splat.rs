//! The `.splat` layout of antimatter15's viewer: 32 bytes a Gaussian, no header.

use super::{byte, normalised};
use crate::files::ply::SingleModality;
use crate::gaussians::{SH_C0, sigmoid};

/// A field of three channels as `.splat`, in its rows' order: position and standard deviations as f32 in metres, then red, green, blue and opacity as
/// bytes, then the quaternion w, x, y, z as bytes (128 is 0, 128 a unit). Harmonics above degree 0 have no place in it; a colour outside of [0, 1] ends
/// there.
pub fn encode_splat(field: &SingleModality) -> Vec<u8> {
    let a = &field.appearance;
    let mut out = Vec::with_capacity(32 * field.position.len());
    for i in 0..field.position.len() {
        field.position[i].iter().for_each(|v| out.extend(v.to_le_bytes()));
        field.log_scale[i].iter().for_each(|v| out.extend(v.exp().to_le_bytes()));
        let sh = &a.sh[i * a.stride()..];
        out.extend([0, 1, 2].map(|c| byte(255.0 * (0.5 + SH_C0 * sh[c])).0));
        out.push(byte(255.0 * sigmoid(a.opacity_logit[i])).0);
        out.extend(normalised(field.rotation[i]).map(|v| byte(128.0 * v + 128.0).0));
    }
    out
}
