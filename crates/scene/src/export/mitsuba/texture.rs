//! Textures: what a material multiplies is multiplied here, since Mitsuba's `bitmap` takes no factor.

use super::slug;
use super::xml::Xml;
use crate::color::{linear_from_srgb, srgb_from_linear};
use crate::model::{Filter, Texture, TextureRef, Wrap};
use crate::{Error, Raster, Result, Scene, io};
use glam::{Affine2, Vec3};
use std::collections::HashMap;
use std::io::Cursor;

/// Use of a texture: the quantity that is read from it, and its factor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Use {
    /// Colour times a linear factor.
    Color([f32; 3]),
    /// Radiance: colour times a linear factor without bound.
    Emission([f32; 3]),
    /// One channel (0 to 2) as data, times a factor.
    Data(usize, f32),
    /// Tangent-space normals, x and y times a scale.
    Normal(f32),
    /// Alpha times a factor: coverage.
    Coverage(f32),
    /// Binary opacity: opaque where alpha times the factor (first) reaches the cutoff (second).
    Cutoff(f32, f32),
}

impl Use {
    fn name(self) -> &'static str {
        match self {
            Self::Color(_) => "color",
            Self::Emission(_) => "emission",
            Self::Data(1, _) => "roughness",
            Self::Data(..) => "metallic",
            Self::Normal(_) => "normal",
            Self::Coverage(_) | Self::Cutoff(..) => "opacity",
        }
    }

    /// A key of its own for every use and factor.
    fn key(self) -> (&'static str, [u32; 3]) {
        let numbers = match self {
            Self::Color(f) | Self::Emission(f) => f,
            Self::Data(channel, f) => [channel as f32, f, 0.0],
            Self::Normal(s) => [s, 0.0, 0.0],
            Self::Coverage(f) => [f, -1.0, 0.0],
            Self::Cutoff(f, cutoff) => [f, cutoff, 0.0],
        };
        (self.name(), numbers.map(f32::to_bits))
    }
}

/// Upsampling factor of an opacity mask with a cutoff over its texture, and the longest side up to which it is upsampled, pixels.
const CUTOFF_FINER: usize = 4;
const CUTOFF_MAX_SIDE: usize = 4096;

/// The texture files of a scene, each once for every use.
pub(super) struct Textures<'s> {
    scene: &'s Scene,
    known: HashMap<(u32, &'static str, [u32; 3]), String>,
    files: Vec<(String, Vec<u8>)>,
}

impl<'s> Textures<'s> {
    pub(super) fn new(scene: &'s Scene) -> Self {
        Self { scene, known: HashMap::new(), files: Vec::new() }
    }

    /// The texture a reference names, where it has texels.
    pub(super) fn get(&self, reference: Option<&TextureRef>) -> Option<&'s Texture> {
        let texture = self.scene.textures.get(reference?.texture as usize)?;
        (!texture.texels.pixels().is_empty()).then_some(texture)
    }

    /// All files so far.
    pub(super) fn into_files(self) -> Vec<(String, Vec<u8>)> {
        self.files
    }

    /// Writes a `bitmap` for property `name`, its coordinates from the mesh's by `uv_from_mesh`. Makes its file on first use.
    ///
    /// # Errors
    /// An image that cannot be encoded.
    pub(super) fn write(&mut self, xml: &mut Xml, name: &str, texture: u32, uv_from_mesh: Affine2, wanted: Use) -> Result<()> {
        let source = &self.scene.textures[texture as usize];
        let (kind, numbers) = wanted.key();
        let file = match self.known.get(&(texture, kind, numbers)) {
            Some(file) => file.clone(),
            None => {
                let (bytes, ending) = encode(source, wanted)?;
                let file = format!("textures/{}_{kind}_{}.{ending}", self.files.len(), slug(&source.name));
                self.files.push((file.clone(), bytes));
                self.known.insert((texture, kind, numbers), file.clone());
                file
            }
        };
        xml.open("texture", &[("type", "bitmap"), ("name", name)]);
        xml.value("string", "filename", &file);
        let nearest = source.filter == Filter::Nearest || matches!(wanted, Use::Cutoff(..));
        xml.value("string", "filter_type", if nearest { "nearest" } else { "bilinear" });
        let wrap = match source.wrap[0] {
            Wrap::Repeat => "repeat",
            Wrap::Mirror => "mirror",
            Wrap::Clamp => "clamp",
        };
        xml.value("string", "wrap_mode", wrap);
        // Full precision; by default Mitsuba keeps textures as half floats.
        xml.value("string", "format", "variant");
        if !matches!(wanted, Use::Color(_) | Use::Emission(_)) {
            xml.value("boolean", "raw", "true");
        }
        if uv_from_mesh != Affine2::IDENTITY {
            let (m, t) = (uv_from_mesh.matrix2.as_dmat2(), uv_from_mesh.translation.as_dvec2());
            let rows = [
                [m.x_axis.x, m.y_axis.x, 0.0, t.x],
                [m.x_axis.y, m.y_axis.y, 0.0, t.y],
                [0.0, 0.0, 1.0, 0.0],
                [0.0, 0.0, 0.0, 1.0],
            ];
            xml.matrix("to_uv", &rows);
        }
        xml.close();
        Ok(())
    }
}

/// The file of a use, and how its name ends.
fn encode(texture: &Texture, wanted: Use) -> Result<(Vec<u8>, &'static str)> {
    let texels = &texture.texels;
    let bytes = match wanted {
        Use::Color([1.0, 1.0, 1.0]) => png8(&texels.map(|t| [t[0], t[1], t[2]]))?,
        Use::Color(f) => png16(&texels.map(|t| {
            let channel = |c: usize| wide(srgb_from_linear(linear_from_srgb(f32::from(t[c]) / 255.0) * f[c]));
            [channel(0), channel(1), channel(2)]
        }))?,
        Use::Emission(f) => {
            let radiance = |t: &[u8; 4]| std::array::from_fn(|c| linear_from_srgb(f32::from(t[c]) / 255.0) * f[c]);
            return Ok((io::encode_exr_rgb(&texels.map(radiance))?, "exr"));
        }
        Use::Data(channel, 1.0) => png8(&texels.map(|t| [t[channel]]))?,
        Use::Data(channel, f) => png16(&texels.map(|t| [wide(f32::from(t[channel]) / 255.0 * f)]))?,
        Use::Normal(1.0) => png8(&texels.map(|t| [t[0], t[1], t[2]]))?,
        Use::Normal(scale) => png16(&texels.map(|t| {
            let [x, y, z] = [0, 1, 2].map(|c| f32::from(t[c]) / 255.0 * 2.0 - 1.0);
            let n = Vec3::new(x * scale, y * scale, z).normalize_or(Vec3::Z);
            n.to_array().map(|c| wide(0.5 * c + 0.5))
        }))?,
        Use::Coverage(1.0) => png8(&texels.map(|t| [t[3]]))?,
        Use::Coverage(f) => png16(&texels.map(|t| [wide(f32::from(t[3]) / 255.0 * f)]))?,
        Use::Cutoff(f, cutoff) => png8(&reached(texture, f, cutoff))?,
    };
    Ok((bytes, "png"))
}

/// `[0, 1]` to 16 bits, rounding to nearest.
fn wide(value: f32) -> u16 {
    (value.clamp(0.0, 1.0) * 65535.0 + 0.5) as u16
}

/// 255 where interpolated alpha times a factor reaches the cutoff, on a finer grid.
fn reached(texture: &Texture, factor: f32, cutoff: f32) -> Raster<[u8; 1]> {
    let (w, h) = (texture.texels.width(), texture.texels.height());
    let finer = (CUTOFF_MAX_SIDE / w.max(h)).clamp(1, CUTOFF_FINER);
    let index = |i: i64, n: usize, wrap: Wrap| match wrap {
        Wrap::Repeat => i.rem_euclid(n as i64) as usize,
        // Half a texel beyond an edge the mirror image has the edge's own texel.
        Wrap::Mirror | Wrap::Clamp => i.clamp(0, n as i64 - 1) as usize,
    };
    let around = |i: usize| {
        let x = (i as f32 + 0.5) / finer as f32 - 0.5;
        (x.floor() as i64, x - x.floor())
    };
    Raster::from_fn(w * finer, h * finer, |x, y| {
        let ((i, fx), (j, fy)) = (around(x), around(y));
        let (fx, fy) = if texture.filter == Filter::Nearest { (f32::from(fx >= 0.5), f32::from(fy >= 0.5)) } else { (fx, fy) };
        let alpha = |di: i64, dj: i64| {
            f32::from(texture.texels[(index(i + di, w, texture.wrap[0]), index(j + dj, h, texture.wrap[1]))][3]) / 255.0
        };
        let low = alpha(0, 0) * (1.0 - fx) + alpha(1, 0) * fx;
        let high = alpha(0, 1) * (1.0 - fx) + alpha(1, 1) * fx;
        [if factor * (low * (1.0 - fy) + high * fy) >= cutoff { 255 } else { 0 }]
    })
}

fn png8<const N: usize>(image: &Raster<[u8; N]>) -> Result<Vec<u8>> {
    let color = if N == 1 { image::ColorType::L8 } else { image::ColorType::Rgb8 };
    png(image.pixels().as_flattened(), image.width(), image.height(), color)
}

fn png16<const N: usize>(image: &Raster<[u16; N]>) -> Result<Vec<u8>> {
    let bytes: Vec<u8> = image.pixels().iter().flatten().flat_map(|v| v.to_ne_bytes()).collect();
    let color = if N == 1 { image::ColorType::L16 } else { image::ColorType::Rgb16 };
    png(&bytes, image.width(), image.height(), color)
}

fn png(buffer: &[u8], width: usize, height: usize, color: image::ColorType) -> Result<Vec<u8>> {
    let mut bytes = Vec::new();
    image::write_buffer_with_format(
        &mut Cursor::new(&mut bytes),
        buffer,
        width as u32,
        height as u32,
        color,
        image::ImageFormat::Png,
    )
    .map_err(|e| Error::invalid("PNG", format!("cannot encode {width}x{height}: {e}"), "give textures of a usual size"))?;
    Ok(bytes)
}
