//! Texture look-ups: bilinear, with wrap modes and decoding through tables.

use corf_scene::color::linear_from_srgb;
use corf_scene::model::{Texture, TextureRef, Wrap};
use glam::Vec2;
use std::sync::OnceLock;

/// How the stored bytes mean colour.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    /// Colour: sRGB-encoded.
    Srgb,
    /// Data: value / 255.
    Linear,
}

fn table(encoding: Encoding) -> &'static [f32; 256] {
    static TABLES: OnceLock<[[f32; 256]; 2]> = OnceLock::new();
    let tables = TABLES.get_or_init(|| {
        let of = |f: &dyn Fn(f32) -> f32| std::array::from_fn(|i| f(i as f32 / 255.0));
        [of(&linear_from_srgb), of(&|v| v)]
    });
    &tables[usize::from(encoding == Encoding::Linear)]
}

/// Texel index of an integer coordinate under a wrap mode.
#[inline(always)]
fn wrapped(i: i64, n: i64, wrap: Wrap) -> usize {
    (match wrap {
        Wrap::Repeat => i.rem_euclid(n),
        Wrap::Clamp => i.clamp(0, n - 1),
        Wrap::Mirror => {
            let k = i.rem_euclid(2 * n);
            if k < n { k } else { 2 * n - 1 - k }
        }
    }) as usize
}

/// The four texels around a texture coordinate and their weights; `None` for an empty texture.
#[inline]
fn footprint(texture: &Texture, uv: Vec2) -> Option<[([u8; 4], f32); 4]> {
    let (w, h) = (texture.texels.width() as i64, texture.texels.height() as i64);
    if w == 0 || h == 0 || !uv.is_finite() {
        return None;
    }
    // Texel centres are at half-integers.
    let (x, y) = (uv.x * w as f32 - 0.5, uv.y * h as f32 - 0.5);
    let (x0, y0) = (x.floor(), y.floor());
    let (fx, fy) = (x - x0, y - y0);
    let (x0, y0) = (x0 as i64, y0 as i64);
    let columns = [wrapped(x0, w, texture.wrap[0]), wrapped(x0 + 1, w, texture.wrap[0])];
    let rows = [wrapped(y0, h, texture.wrap[1]), wrapped(y0 + 1, h, texture.wrap[1])];
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

#[cfg(test)]
mod tests {
    use super::*;
    use corf_scene::Raster;
    use glam::Affine2;

    fn ramp(wrap: Wrap) -> (Vec<Texture>, TextureRef) {
        let texels = Raster::from_fn(4, 1, |x, _| [(x * 50) as u8, 0, 255, 128]);
        (vec![Texture { name: "ramp".into(), texels, wrap: [wrap; 2] }], TextureRef { texture: 0, uv_from_uv: Affine2::IDENTITY })
    }

    fn red(wrap: Wrap, u: f32) -> f32 {
        let (textures, reference) = ramp(wrap);
        sample(&textures, &reference, Vec2::new(u, 0.5), Encoding::Linear)[0] * 255.0
    }

    #[test]
    fn texel_centres_are_exact_and_between_them_it_is_linear() {
        assert!((red(Wrap::Repeat, 0.375) - 50.0).abs() < 1e-3);
        assert!((red(Wrap::Repeat, 0.5) - 75.0).abs() < 1e-3);
    }

    #[test]
    fn wrap_modes_continue_as_named() {
        assert!((red(Wrap::Repeat, 1.0) - 75.0).abs() < 1e-3, "halfway between last and first");
        assert!((red(Wrap::Repeat, -0.625) - 50.0).abs() < 1e-3);
        assert!((red(Wrap::Clamp, 7.0) - 150.0).abs() < 1e-3);
        assert!((red(Wrap::Mirror, 1.125) - 150.0).abs() < 1e-3, "mirrored: the last texel again");
        assert!((red(Wrap::Mirror, 1.375) - 100.0).abs() < 1e-3);
    }

    #[test]
    fn colour_is_decoded_and_alpha_is_not() {
        let (textures, reference) = ramp(Wrap::Clamp);
        let v = sample(&textures, &reference, Vec2::new(0.625, 0.5), Encoding::Srgb);
        assert!((v[0] - linear_from_srgb(100.0 / 255.0)).abs() < 1e-6);
        assert!((v[3] - 128.0 / 255.0).abs() < 1e-6);
    }

    #[test]
    fn the_texture_transform_acts_on_mesh_coordinates() {
        let (textures, mut reference) = ramp(Wrap::Repeat);
        reference.uv_from_uv = Affine2::from_scale(Vec2::new(2.0, 1.0));
        let v = sample(&textures, &reference, Vec2::new(0.1875, 0.5), Encoding::Linear);
        assert!((v[0] * 255.0 - 50.0).abs() < 1e-3);
    }
}
