//! glTF textures, their images and samplers.

use super::document::Source;
use crate::model::{Filter, Texture, TextureRef, Wrap};
use crate::{Error, Raster, Result, io};
use glam::{Affine2, Mat2, Vec2};
use gltf::texture::{Info, MagFilter, WrappingMode};
use rayon::prelude::*;
use std::collections::BTreeMap;

/// Conversion of a texture's texels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Use {
    /// None: they are used as stored.
    AsStored,
    /// Glossiness in A becomes roughness in G: `1 − factor · A`, the factor in 1/255.
    RoughnessOfGlossiness(u8),
}

/// The textures materials refer to, each once, to be decoded together.
pub(super) struct Textures<'a> {
    pub source: &'a Source<'a>,
    /// glTF texture index and use → scene texture index.
    index_of: BTreeMap<(usize, Use), u32>,
}

impl<'a> Textures<'a> {
    pub(super) fn new(source: &'a Source<'a>) -> Self {
        Self { source, index_of: BTreeMap::new() }
    }

    /// The scene's number of a texture.
    pub(super) fn index(&mut self, texture: &gltf::Texture<'_>) -> u32 {
        self.index_as(texture, Use::AsStored)
    }

    fn index_as(&mut self, texture: &gltf::Texture<'_>, used: Use) -> u32 {
        let next = self.index_of.len() as u32;
        *self.index_of.entry((texture.index(), used)).or_insert(next)
    }

    /// A texture as a material refers to it.
    pub(super) fn reference(&mut self, info: &Info<'_>) -> TextureRef {
        TextureRef { texture: self.index(&info.texture()), uv_from_uv: transform_of(info) }
    }

    /// The roughness of a specular-glossiness texture, in its green channel, where glossiness is `factor` times its alpha.
    pub(super) fn roughness_of_glossiness(&mut self, info: &Info<'_>, factor: f32) -> TextureRef {
        let used = Use::RoughnessOfGlossiness((255.0 * factor.clamp(0.0, 1.0)).round() as u8);
        TextureRef { texture: self.index_as(&info.texture(), used), uv_from_uv: transform_of(info) }
    }

    /// Decodes every texture referred to, each image once.
    pub(super) fn decode(&self) -> Result<Vec<Texture>> {
        let mut used: Vec<(&(usize, Use), &u32)> = self.index_of.iter().collect();
        used.sort_by_key(|(_, scene)| **scene);
        let textures: Vec<(gltf::Texture<'_>, Use)> =
            used.iter().filter_map(|((i, used), _)| Some((self.source.document.textures().nth(*i)?, *used))).collect();
        let mut jobs: BTreeMap<usize, (String, Vec<u8>)> = BTreeMap::new();
        for (texture, _) in &textures {
            let image = self.image(texture)?;
            if let std::collections::btree_map::Entry::Vacant(entry) = jobs.entry(image.index()) {
                let place = format!("{}: images[{}]", self.source.name, image.index());
                let bytes = self.encoded(&image, &place)?;
                entry.insert((place, bytes));
            }
        }
        let decoded: BTreeMap<usize, Raster<[u8; 4]>> =
            jobs.into_par_iter().map(|(i, (place, bytes))| Ok((i, io::decode_rgba(&bytes, place)?))).collect::<Result<_>>()?;
        textures
            .iter()
            .map(|(t, used)| {
                let image = self.image(t)?;
                let texels = decoded[&image.index()].clone();
                Ok(Texture {
                    name: t.name().or(image.name()).map_or_else(|| format!("texture {}", t.index()), str::to_string),
                    texels: match used {
                        Use::AsStored => texels,
                        Use::RoughnessOfGlossiness(factor) => {
                            let glossiness = |a: u8| (f32::from(*factor) * f32::from(a) / 255.0).round() as u8;
                            texels.map(|p| [255, 255 - glossiness(p[3]), 255, 255])
                        }
                    },
                    wrap: [wrap(t.sampler().wrap_s()), wrap(t.sampler().wrap_t())],
                    filter: match t.sampler().mag_filter() {
                        Some(MagFilter::Nearest) => Filter::Nearest,
                        Some(MagFilter::Linear) | None => Filter::Linear,
                    },
                })
            })
            .collect()
    }

    /// A texture's PNG or JPEG image. Other formats come with an extension, and such a texture may have a plain one beside it.
    fn image<'d>(&self, texture: &gltf::Texture<'d>) -> Result<gltf::Image<'d>> {
        texture.source().ok_or_else(|| {
            let place = format!("{}: textures[{}]", self.source.name, texture.index());
            let names: Vec<&str> = texture.extensions().into_iter().flat_map(|e| e.keys().map(String::as_str)).collect();
            match names.as_slice() {
                [] => Error::invalid(place, "has no image", "export the model again"),
                _ => Error::invalid(
                    place,
                    format!("has its image by {} alone, which this does not read", names.join(", ")),
                    "export its textures as PNG or JPEG, or with a PNG or JPEG beside as fallback (the texture's `source`)",
                ),
            }
        })
    }

    /// An image's PNG or JPEG bytes.
    fn encoded(&self, image: &gltf::Image<'_>, place: &str) -> Result<Vec<u8>> {
        let json = &self.source.document.as_json().images[image.index()];
        match (&json.buffer_view, &json.uri) {
            (Some(view), _) => {
                let view = self.source.document.views().nth(view.value());
                let view =
                    view.ok_or_else(|| Error::invalid(place, "its buffer view does not exist", "export the model again"))?;
                self.source.view(&view, place).map(<[u8]>::to_vec)
            }
            (None, Some(uri)) => self.source.uri(uri, place),
            (None, None) => Err(Error::invalid(place, "has neither a URI nor a buffer view", "export the model again")),
        }
    }
}

fn transform_of(info: &Info<'_>) -> Affine2 {
    info.texture_transform().map_or(Affine2::IDENTITY, |t| uv_transform(t.offset(), t.rotation(), t.scale()))
}

/// `KHR_texture_transform`: scale, then turn, then move. The extension's worked example (offset (0, 1), a quarter turn, scale ½ is the
/// lower left quadrant) settles the sense of the turn: u′ = u·cos + v·sin, v′ = −u·sin + v·cos, with v down.
pub(super) fn uv_transform(offset: [f32; 2], rotation: f32, scale: [f32; 2]) -> Affine2 {
    let (s, c) = rotation.sin_cos();
    let turn = Mat2::from_cols(Vec2::new(c, -s), Vec2::new(s, c));
    Affine2::from_mat2_translation(turn * Mat2::from_diagonal(Vec2::from_array(scale)), Vec2::from_array(offset))
}

fn wrap(mode: WrappingMode) -> Wrap {
    match mode {
        WrappingMode::Repeat => Wrap::Repeat,
        WrappingMode::MirroredRepeat => Wrap::Mirror,
        WrappingMode::ClampToEdge => Wrap::Clamp,
    }
}
