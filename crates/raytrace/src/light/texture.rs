//! Texture look-ups: bilinear, with wrap modes and decoding through tables.

use corf_scene::Raster;
use corf_scene::color::{linear_from_srgb, quantize8, srgb_from_linear};
use corf_scene::model::{Filter, Texture, TextureRef, Wrap};
use glam::Vec2;
use rayon::prelude::*;
use std::sync::OnceLock;

/// Encoding of a texture's bytes.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    /// Colour: sRGB-encoded.
    Srgb,
    /// Data: value / 255.
    Linear,
}

/// Decoded values of a byte.
pub(super) fn table(encoding: Encoding) -> &'static [f32; 256] {
    static TABLES: OnceLock<[[f32; 256]; 2]> = OnceLock::new();
    let tables = TABLES.get_or_init(|| {
        let of = |f: &dyn Fn(f32) -> f32| std::array::from_fn(|i| f(i as f32 / 255.0));
        [of(&linear_from_srgb), of(&|v| v)]
    });
    &tables[usize::from(encoding == Encoding::Linear)]
}

/// The two texel indices around a coordinate along one axis of `n` texels, and the second one's weight.
#[inline(always)]
fn neighbours(coordinate: f32, n: usize, wrap: Wrap) -> ([usize; 2], f32) {
    let coordinate = match wrap {
        Wrap::Repeat => coordinate - coordinate.floor(),
        // Far outside, a clamped coordinate is no different from just outside.
        Wrap::Clamp => coordinate.clamp(-1.0, 2.0),
        Wrap::Mirror => coordinate - 2.0 * (0.5 * coordinate).floor(),
    };
    // Texel centres are at half-integers.
    let x = coordinate * n as f32 - 0.5;
    let floor = x.floor();
    let first = floor as i32;
    let last = n as i32 - 1;
    let index = |i: i32| match wrap {
        // The coordinate is in [0, 1], so i is in [−1, n].
        Wrap::Repeat if i < 0 => last,
        Wrap::Repeat if i > last => 0,
        Wrap::Repeat => i,
        Wrap::Clamp => i.clamp(0, last),
        // In [0, 2], so i is in [−1, 2n].
        Wrap::Mirror if i < 0 || i > 2 * last + 1 => 0,
        Wrap::Mirror if i > last => 2 * last + 1 - i,
        Wrap::Mirror => i,
    };
    ([index(first) as usize, index(first + 1) as usize], x - floor)
}

/// The four texels around a texture coordinate and their weights; `None` for an empty texture.
#[inline]
fn footprint(texture: &Texture, uv: Vec2) -> Option<[([u8; 4], f32); 4]> {
    let (w, h) = (texture.texels.width(), texture.texels.height());
    if w == 0 || h == 0 || !uv.is_finite() {
        return None;
    }
    let (columns, fx) = neighbours(uv.x, w, texture.wrap[0]);
    let (rows, fy) = neighbours(uv.y, h, texture.wrap[1]);
    // The nearest of the four is the one whose square holds the coordinate.
    let (fx, fy) = match texture.filter {
        Filter::Linear => (fx, fy),
        Filter::Nearest => (f32::from(fx >= 0.5), f32::from(fy >= 0.5)),
    };
    let texel = |i: usize, j: usize| texture.texels[(columns[i], rows[j])];
    Some([
        (texel(0, 0), (1.0 - fx) * (1.0 - fy)),
        (texel(1, 0), fx * (1.0 - fy)),
        (texel(0, 1), (1.0 - fx) * fy),
        (texel(1, 1), fx * fy),
    ])
}

/// The texture's value at a mesh's texture coordinate: colour decoded, alpha linear. An empty texture is white.
#[inline]
pub(super) fn sample(textures: &[Texture], reference: &TextureRef, uv: Vec2, encoding: Encoding) -> [f32; 4] {
    let uv = reference.uv_from_uv.transform_point2(uv);
    let Some(taps) = footprint(&textures[reference.texture as usize], uv) else { return [1.0; 4] };
    let decode = table(encoding);
    let mut value = [0.0; 4];
    for (texel, weight) in taps {
        for c in 0..3 {
            value[c] += weight * decode[texel[c] as usize];
        }
        value[3] += weight * f32::from(texel[3]) * (1.0 / 255.0);
    }
    value
}

/// Mean of a whole texture, decoded.
pub(super) fn mean(textures: &[Texture], reference: &TextureRef, encoding: Encoding) -> [f32; 3] {
    let texels = textures[reference.texture as usize].texels.pixels();
    if texels.is_empty() {
        return [1.0; 3];
    }
    let decode = table(encoding);
    let mut sum = [0.0f64; 3];
    for texel in texels {
        for c in 0..3 {
            sum[c] += f64::from(decode[texel[c] as usize]);
        }
    }
    sum.map(|s| (s / texels.len() as f64) as f32)
}

/// Longest side of a coarse texture.
const COARSE_TEXELS: usize = 64;

/// Colour textures averaged (in linear light) to at most 64 texels a side, for look-ups whose footprint is wide.
pub(super) fn coarse(textures: &[Texture]) -> Vec<Texture> {
    textures.par_iter().map(coarsened).collect()
}

fn coarsened(texture: &Texture) -> Texture {
    let (w, h) = (texture.texels.width(), texture.texels.height());
    let shrink = w.max(h).div_ceil(COARSE_TEXELS);
    if shrink <= 1 {
        return texture.clone();
    }
    let (cw, ch) = ((w / shrink).max(1), (h / shrink).max(1));
    let decode = table(Encoding::Srgb);
    let texels = Raster::from_fn(cw, ch, |x, y| {
        let (columns, rows) = (x * w / cw..(x + 1) * w / cw, y * h / ch..(y + 1) * h / ch);
        let count = (columns.len() * rows.len()) as f32;
        let mut sum = [0.0f32; 4];
        for row in rows {
            for texel in &texture.texels.pixels()[row * w..][columns.clone()] {
                (0..3).for_each(|c| sum[c] += decode[texel[c] as usize]);
                sum[3] += f32::from(texel[3]) / 255.0;
            }
        }
        let mean = sum.map(|v| v / count);
        [
            quantize8(srgb_from_linear(mean[0])),
            quantize8(srgb_from_linear(mean[1])),
            quantize8(srgb_from_linear(mean[2])),
            quantize8(mean[3]),
        ]
    });
    Texture { name: texture.name.clone(), texels, wrap: texture.wrap, filter: Filter::Linear }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Affine2;

    fn ramp(wrap: Wrap, filter: Filter) -> (Vec<Texture>, TextureRef) {
        let texels = Raster::from_fn(4, 1, |x, _| [(x * 50) as u8, 0, 255, 128]);
        (
            vec![Texture { name: "ramp".into(), texels, wrap: [wrap; 2], filter }],
            TextureRef { texture: 0, uv_from_uv: Affine2::IDENTITY },
        )
    }

    fn red(wrap: Wrap, u: f32) -> f32 {
        red_by(Filter::Linear, wrap, u)
    }

    fn red_by(filter: Filter, wrap: Wrap, u: f32) -> f32 {
        let (textures, reference) = ramp(wrap, filter);
        sample(&textures, &reference, Vec2::new(u, 0.5), Encoding::Linear)[0] * 255.0
    }

    #[test]
    fn texel_centres_are_exact_and_between_them_it_is_linear() {
        assert!((red(Wrap::Repeat, 0.375) - 50.0).abs() < 1e-3);
        assert!((red(Wrap::Repeat, 0.5) - 75.0).abs() < 1e-3);
    }

    #[test]
    fn the_nearest_texel_is_the_one_the_coordinate_falls_into() {
        for (u, expected) in
            [(0.001, 0.0), (0.249, 0.0), (0.251, 50.0), (0.499, 50.0), (0.501, 100.0), (0.999, 150.0), (1.01, 0.0)]
        {
            assert_eq!((red_by(Filter::Nearest, Wrap::Repeat, u)).round(), expected, "{u}");
        }
        assert_eq!(red_by(Filter::Nearest, Wrap::Clamp, 7.0).round(), 150.0);
        assert_eq!(red_by(Filter::Nearest, Wrap::Mirror, 1.01).round(), 150.0);
    }

    #[test]
    fn wrap_modes_continue_as_named() {
        assert!((red(Wrap::Repeat, 1.0) - 75.0).abs() < 1e-3, "halfway between last and first");
        assert!((red(Wrap::Repeat, -0.625) - 50.0).abs() < 1e-3);
        assert!((red(Wrap::Clamp, 7.0) - 150.0).abs() < 1e-3);
        assert!((red(Wrap::Mirror, 1.125) - 150.0).abs() < 1e-3, "mirrored: the last texel again");
        assert!((red(Wrap::Mirror, 1.375) - 100.0).abs() < 1e-3);
        assert!((red(Wrap::Mirror, -0.375) - 50.0).abs() < 1e-3 && (red(Wrap::Mirror, 2.375) - 50.0).abs() < 1e-3);
        assert!((red(Wrap::Mirror, 2.0)).abs() < 1e-3 && (red(Wrap::Mirror, 0.0)).abs() < 1e-3);
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            for u in [-1e9, -7.3, -1e-9, 0.0, 1.0, 0.999_999_9, 1.999_999_9, 2.0, 33.3, 1e9] {
                assert!((0.0..=150.0).contains(&red(wrap, u)), "{wrap:?} {u}");
            }
        }
    }

    #[test]
    fn colour_is_decoded_and_alpha_is_not() {
        let (textures, reference) = ramp(Wrap::Clamp, Filter::Linear);
        let v = sample(&textures, &reference, Vec2::new(0.625, 0.5), Encoding::Srgb);
        assert!((v[0] - linear_from_srgb(100.0 / 255.0)).abs() < 1e-6);
        assert!((v[3] - 128.0 / 255.0).abs() < 1e-6);
    }

    #[test]
    fn the_texture_transform_acts_on_mesh_coordinates() {
        let (textures, mut reference) = ramp(Wrap::Repeat, Filter::Linear);
        reference.uv_from_uv = Affine2::from_scale(Vec2::new(2.0, 1.0));
        let v = sample(&textures, &reference, Vec2::new(0.1875, 0.5), Encoding::Linear);
        assert!((v[0] * 255.0 - 50.0).abs() < 1e-3);
    }

    #[test]
    fn coarse_textures_keep_the_mean_colour_and_the_layout() {
        let texels =
            Raster::from_fn(500, 128, |x, y| if x < 250 { [255, (y % 2 * 255) as u8, 0, 255] } else { [0, 80, 200, 255] });
        let fine = vec![Texture { name: "halves".into(), texels, wrap: [Wrap::Clamp; 2], filter: Filter::Linear }];
        let coarse = coarse(&fine);
        assert!(coarse[0].texels.width() <= 64 && coarse[0].texels.height() <= 64);
        let reference = TextureRef { texture: 0, uv_from_uv: Affine2::IDENTITY };
        let (a, b) = (mean(&fine, &reference, Encoding::Srgb), mean(&coarse, &reference, Encoding::Srgb));
        for c in 0..3 {
            // Eight-bit rounding of every coarse texel, and a column that straddles the halves.
            assert!((a[c] - b[c]).abs() < 0.01, "{a:?} {b:?}");
        }
        let left = sample(&coarse, &reference, Vec2::new(0.25, 0.5), Encoding::Srgb);
        assert!(
            left[0] > 0.99 && (left[1] - 0.5).abs() < 0.01 && left[2] < 0.01,
            "averaged as light, not as code values: {left:?}"
        );
    }
}
