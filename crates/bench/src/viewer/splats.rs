//! The Gaussians of a field as the page's graphics program reads them.

use corf::{Antialias, Appearance, Field, RasterConfig, gaussians::sigmoid};
use glam::{Mat3, Quat, Vec3};
use half::f16;
use serde::Serialize;

/// Numbers of geometry a Gaussian: mean and opacity in light; Σ_xx, Σ_xy, Σ_xz and opacity in radio; Σ_yy, Σ_yz, Σ_zz and nothing.
const GEOMETRY: usize = 12;

/// Layout of the bytes of a field, and how it is drawn.
#[derive(Debug, PartialEq, Serialize)]
pub(super) struct FieldLayout {
    /// Number of Gaussians.
    pub count: usize,
    /// Depth at or before which nothing is drawn, metres.
    pub near_m: f32,
    /// Variance of the pixel filter, square pixels.
    pub dilation_px2: f32,
    /// Whether opacity makes up for that filter.
    pub compensated: bool,
    /// Light; none where the field does not know it.
    #[serde(rename = "optical")]
    pub light: Option<Colours>,
    /// Radio; none where the field does not know it, or not as colours of Gaussians.
    #[serde(rename = "rf")]
    pub radio: Option<Colours>,
}

/// Layout of one modality's colours.
#[derive(Debug, PartialEq, Serialize)]
pub(super) struct Colours {
    /// 3 colours, or 1 level that is shown in colours.
    pub channels: usize,
    /// Spherical harmonics a channel.
    pub coefficients: usize,
    /// Groups of four numbers a Gaussian.
    pub texels: usize,
    /// What lies behind all Gaussians.
    pub background: [f32; 3],
}

impl Colours {
    fn of(appearance: &Appearance, background: [f32; 3]) -> Self {
        let (channels, coefficients) = (appearance.channels, appearance.coefficients());
        Self { channels, coefficients, texels: appearance.stride().div_ceil(4), background }
    }
}

/// Layout of a field's bytes; `radio` says whether its RF colours are spectra.
pub(super) fn layout(field: &Field, raster: &RasterConfig, radio: bool) -> FieldLayout {
    let (gaussians, meta) = (&field.gaussians, &field.meta);
    let background = meta.radio_background.unwrap_or(meta.radio_target.floor_color());
    FieldLayout {
        count: gaussians.len(),
        near_m: raster.near_m,
        dilation_px2: raster.antialias.dilation(),
        compensated: raster.antialias != Antialias::Off,
        light: meta.modalities.light.then(|| Colours::of(&gaussians.light, [0.0; 3])),
        radio: (meta.modalities.radio && radio).then(|| Colours::of(&gaussians.radio, background)),
    }
}

/// The bytes: all geometry as `f32`, then light's harmonics, then radio's, as `f16` in groups of four (coefficient by coefficient, channels
/// within); little endian.
pub(super) fn bytes(field: &Field, layout: &FieldLayout) -> Vec<u8> {
    let g = &field.gaussians;
    let mut out = Vec::with_capacity(g.len() * 4 * GEOMETRY);
    for i in 0..g.len() {
        let [w, x, y, z] = g.rotation[i];
        let norm = (w * w + x * x + y * y + z * z).max(1e-30).sqrt();
        let rotation = Mat3::from_quat(Quat::from_xyzw(x / norm, y / norm, z / norm, w / norm));
        let axes = rotation * Mat3::from_diagonal(Vec3::from_array(g.log_scale[i].map(f32::exp)));
        let s = axes * axes.transpose();
        let [px, py, pz] = g.position[i];
        let [light, radio] = [&g.light, &g.radio].map(|a| sigmoid(a.opacity_logit[i]));
        let numbers: [f32; GEOMETRY] =
            [px, py, pz, light, s.x_axis.x, s.x_axis.y, s.x_axis.z, radio, s.y_axis.y, s.y_axis.z, s.z_axis.z, 0.0];
        numbers.iter().for_each(|v| out.extend(v.to_le_bytes()));
    }
    for (appearance, colours) in [(&g.light, &layout.light), (&g.radio, &layout.radio)] {
        let Some(colours) = colours else { continue };
        let (stride, padded) = (appearance.stride(), 4 * colours.texels);
        out.reserve(2 * padded * g.len());
        for sh in appearance.sh.chunks_exact(stride) {
            let most = f16::MAX.to_f32();
            let halves = sh.iter().map(|v| f16::from_f32(v.clamp(-most, most))).chain(std::iter::repeat(f16::ZERO));
            halves.take(padded).for_each(|v| out.extend(v.to_le_bytes()));
        }
    }
    out
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use corf::{FieldMeta, Gaussians, target::RadioTarget};
    use corf_scene::Pinhole;
    use corf_scene::keyframe::{DbRange, Modalities};

    /// Two Gaussians.
    pub fn field() -> Field {
        let mut gaussians = Gaussians::empty(1, 0);
        gaussians.radio.sh_degree = 1;
        gaussians.position = vec![[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]];
        // A quarter turn about z, not normalised.
        gaussians.rotation = vec![[1.0, 0.0, 0.0, 0.0], [2.0, 0.0, 0.0, 2.0]];
        gaussians.log_scale = vec![[0.0, 0.0, 0.0], [1.0_f32.ln(), 2.0_f32.ln(), 3.0_f32.ln()]];
        gaussians.light.opacity_logit = vec![0.0, 0.0];
        gaussians.light.sh = vec![0.5; 6];
        gaussians.radio.opacity_logit = vec![0.0, 1.0];
        gaussians.radio.sh = vec![-0.25, 0.0, 0.0, 0.0, 1e6, 0.0, 0.0, 0.0];
        let camera = Pinhole::from_horizontal_fov(8, 6, 90.0);
        let meta = FieldMeta {
            radio_target: RadioTarget::Db,
            db_range: DbRange { min_db: -100.0, max_db: -40.0 },
            light_camera: camera,
            radio_camera: camera,
            radio_background: None,
            modalities: Modalities::BOTH,
        };
        Field { gaussians, meta }
    }

    #[test]
    fn the_bytes_hold_covariances_opacities_and_harmonics_where_the_layout_says() {
        let field = field();
        let layout = layout(&field, &RasterConfig::default(), true);
        let bytes = bytes(&field, &layout);
        let (light, radio) = (layout.light.as_ref().unwrap(), layout.radio.as_ref().unwrap());
        assert_eq!((light.channels, light.coefficients, light.texels), (3, 1, 1));
        assert_eq!((radio.channels, radio.coefficients, radio.texels, radio.background), (1, 4, 1, [0.0; 3]));
        assert_eq!(bytes.len(), 2 * (4 * GEOMETRY + 8 + 8));
        let float = |i: usize| f32::from_le_bytes(bytes[4 * i..4 * i + 4].try_into().unwrap());
        let second: Vec<f32> = (GEOMETRY..2 * GEOMETRY).map(float).collect();
        // Turned by 90° about z: the variances 1 and 4 of x and y have changed places.
        let expected = [4.0, 5.0, 6.0, 0.5, 4.0, 0.0, 0.0, 0.731_058_6, 1.0, 0.0, 9.0, 0.0];
        assert!(second.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-5), "{second:?}");
        let half = |i: usize| f16::from_le_bytes(bytes[2 * i..2 * i + 2].try_into().unwrap()).to_f32();
        let first = 2 * 2 * GEOMETRY;
        assert_eq!((0..8).map(|i| half(first + i)).collect::<Vec<_>>(), [0.5, 0.5, 0.5, 0.0, 0.5, 0.5, 0.5, 0.0]);
        assert_eq!((half(first + 8), half(first + 12)), (-0.25, f16::MAX.to_f32()));
    }

    #[test]
    fn a_modality_that_is_not_there_takes_no_bytes() {
        let mut field = field();
        field.meta.modalities.light = false;
        let layout = layout(&field, &RasterConfig { antialias: Antialias::Off, ..RasterConfig::default() }, false);
        assert!(layout.light.is_none() && layout.radio.is_none() && !layout.compensated);
        assert_eq!(bytes(&field, &layout).len(), 2 * 4 * GEOMETRY);
    }
}
