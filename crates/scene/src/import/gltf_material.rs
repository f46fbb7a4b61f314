//! glTF materials, textures and samplers; radio properties from `extras.corf_radio`.

use super::{ImportReport, gltf_accessor};
use crate::model::{Material, OpticalMaterial, Texture, TextureRef, Wrap};
use crate::radio_spec::RadioSpec;
use crate::{Error, Raster, Result, io};
use base64::Engine as _;
use glam::{Affine2, Mat2, Vec2};
use gltf::texture::{Info, WrappingMode};
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// The textures materials refer to, each once, to be decoded together.
pub(super) struct Textures<'a> {
    document: &'a gltf::Document,
    buffers: &'a [Vec<u8>],
    path: &'a Path,
    /// glTF texture index → scene texture index.
    index_of: BTreeMap<usize, u32>,
}

impl<'a> Textures<'a> {
    pub(super) fn new(document: &'a gltf::Document, buffers: &'a [Vec<u8>], path: &'a Path) -> Self {
        Self { document, buffers, path, index_of: BTreeMap::new() }
    }

    fn place(&self, texture: &gltf::Texture<'_>) -> String {
        format!("{}: images[{}]", self.path.display(), texture.source().index())
    }

    fn index(&mut self, texture: &gltf::Texture<'_>) -> u32 {
        let next = self.index_of.len() as u32;
        *self.index_of.entry(texture.index()).or_insert(next)
    }

    fn reference(&mut self, info: &Info<'_>) -> TextureRef {
        let uv_from_uv =
            info.texture_transform().map_or(Affine2::IDENTITY, |t| uv_transform(t.offset(), t.rotation(), t.scale()));
        TextureRef { texture: self.index(&info.texture()), uv_from_uv }
    }

    /// Decodes every texture referred to, each image once.
    pub(super) fn decode(&self) -> Result<Vec<Texture>> {
        let mut used: Vec<(&usize, &u32)> = self.index_of.iter().collect();
        used.sort_by_key(|(_, scene)| **scene);
        let textures: Vec<gltf::Texture<'_>> = used.iter().filter_map(|(i, _)| self.document.textures().nth(**i)).collect();
        let images: BTreeMap<usize, &gltf::Texture<'_>> = textures.iter().map(|t| (t.source().index(), t)).collect();
        let jobs: Vec<(usize, String, Vec<u8>)> = images
            .iter()
            .map(|(i, t)| Ok((*i, self.place(t), self.encoded(&t.source(), &self.place(t))?)))
            .collect::<Result<_>>()?;
        let decoded: BTreeMap<usize, Raster<[u8; 4]>> =
            jobs.into_par_iter().map(|(i, place, bytes)| Ok((i, io::decode_rgba(&bytes, place)?))).collect::<Result<_>>()?;
        Ok(textures
            .iter()
            .map(|t| Texture {
                name: t.name().or(t.source().name()).map_or_else(|| format!("texture {}", t.index()), str::to_string),
                texels: decoded[&t.source().index()].clone(),
                wrap: [wrap(t.sampler().wrap_s()), wrap(t.sampler().wrap_t())],
            })
            .collect())
    }

    /// An image's PNG or JPEG bytes.
    fn encoded(&self, image: &gltf::Image<'_>, place: &str) -> Result<Vec<u8>> {
        let json = &self.document.as_json().images[image.index()];
        match (&json.buffer_view, &json.uri) {
            (Some(view), _) => {
                let view = self.document.views().nth(view.value());
                let view =
                    view.ok_or_else(|| Error::invalid(place, "its buffer view does not exist", "export the model again"))?;
                gltf_accessor::view_bytes(&view, self.buffers, place).map(<[u8]>::to_vec)
            }
            (None, Some(uri)) => read_uri(uri, self.path, place),
            (None, None) => Err(Error::invalid(place, "has neither a URI nor a buffer view", "export the model again")),
        }
    }
}

/// `KHR_texture_transform`: scale, then turn, then move. The extension's worked example (offset (0, 1), a quarter turn, scale ½ is the
/// lower left quadrant) settles the sense of the turn: u′ = u·cos + v·sin, v′ = −u·sin + v·cos, with v down.
fn uv_transform(offset: [f32; 2], rotation: f32, scale: [f32; 2]) -> Affine2 {
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

/// The bytes behind a glTF URI: a base64 data URI, or a file relative to the glTF file.
pub(super) fn read_uri(uri: &str, gltf: &Path, place: &str) -> Result<Vec<u8>> {
    if let Some(data) = uri.strip_prefix("data:") {
        let Some((_, base64)) = data.split_once(";base64,") else {
            return Err(Error::invalid(place, "a data URI that is not base64", "embed data as data:...;base64,..."));
        };
        return base64::engine::general_purpose::STANDARD
            .decode(base64)
            .map_err(|e| Error::invalid(place, format!("its data URI is no base64: {e}"), "export the model again"));
    }
    if uri.contains("://") {
        return Err(Error::invalid(place, format!("refers to {uri}"), "download the file and refer to it by a relative path"));
    }
    let path = gltf.parent().unwrap_or(Path::new("")).join(percent_decoded(uri));
    std::fs::read(&path).map_err(|e| {
        Error::invalid(place, format!("cannot read {}: {e}", path.display()), "put the file beside the .gltf, or export as .glb")
    })
}

/// `%20` and its like; anything malformed stays as it is.
fn percent_decoded(uri: &str) -> PathBuf {
    let bytes = uri.as_bytes();
    let mut out = Vec::with_capacity(bytes.len());
    let mut i = 0;
    while i < bytes.len() {
        let hex = (bytes[i] == b'%').then(|| bytes.get(i + 1..i + 3)).flatten();
        let value = hex.and_then(|h| std::str::from_utf8(h).ok()).and_then(|h| u8::from_str_radix(h, 16).ok());
        out.push(value.unwrap_or(bytes[i]));
        i += if value.is_some() { 3 } else { 1 };
    }
    PathBuf::from(String::from_utf8_lossy(&out).into_owned())
}

/// Which texture coordinates a material uses: those of its base colour, or of the first texture it has.
pub(super) fn tex_coord_set(material: &gltf::Material<'_>) -> u32 {
    tex_coord_sets(material).first().copied().unwrap_or(0)
}

fn tex_coord_sets(material: &gltf::Material<'_>) -> Vec<u32> {
    let pbr = material.pbr_metallic_roughness();
    let of = |info: Info<'_>| info.texture_transform().and_then(|t| t.tex_coord()).unwrap_or(info.tex_coord());
    let mut sets: Vec<u32> = [pbr.base_color_texture(), pbr.metallic_roughness_texture(), material.emissive_texture()]
        .into_iter()
        .flatten()
        .map(of)
        .collect();
    sets.extend(material.normal_texture().map(|n| n.tex_coord()));
    sets
}

/// One material.
pub(super) fn convert(material: &gltf::Material<'_>, textures: &mut Textures<'_>, report: &mut ImportReport) -> Result<Material> {
    let name = material
        .name()
        .map_or_else(|| material.index().map_or("default".to_string(), |i| format!("material {i}")), str::to_string);
    let place = format!("{}: material \"{name}\"", textures.path.display());
    let pbr = material.pbr_metallic_roughness();
    let sets = tex_coord_sets(material);
    if sets.iter().any(|s| Some(s) != sets.first()) {
        report.notes.push(format!("{place}: its textures use different TEXCOORD sets; all are drawn with set {}", sets[0]));
    }
    let [r, g, b, alpha] = pbr.base_color_factor();
    let mut transmission = material.transmission().map_or(0.0, |t| t.transmission_factor());
    if material.transmission().is_some_and(|t| t.transmission_texture().is_some()) {
        report.notes.push(format!("{place}: its transmission texture is not used"));
    }
    use gltf::material::AlphaMode;
    let alpha_cutoff = match material.alpha_mode() {
        AlphaMode::Opaque => None,
        // The cutoff meets factor × texel; the scene's meets the texel alone.
        AlphaMode::Mask => Some(material.alpha_cutoff().unwrap_or(0.5) / alpha.max(1e-6)),
        AlphaMode::Blend if pbr.base_color_texture().is_some() => {
            report.notes.push(format!("{place}: alphaMode BLEND is drawn as MASK at 0.5"));
            Some(0.5 / alpha.max(1e-6))
        }
        // Uniform blending is what exporters without the transmission extension write for glass.
        AlphaMode::Blend => {
            if transmission == 0.0 {
                transmission = 1.0 - alpha;
                report.notes.push(format!("{place}: alphaMode BLEND is drawn as transmission {transmission:.2}"));
            }
            None
        }
    };
    let strength = material.emissive_strength().unwrap_or(1.0);
    let normal = material.normal_texture();
    let optical = OpticalMaterial {
        base_color: [r, g, b],
        base_color_texture: pbr.base_color_texture().map(|i| textures.reference(&i)),
        alpha_cutoff,
        metallic: pbr.metallic_factor(),
        roughness: pbr.roughness_factor(),
        metallic_roughness_texture: pbr.metallic_roughness_texture().map(|i| textures.reference(&i)),
        normal_scale: normal.as_ref().map_or(1.0, |n| n.scale()),
        normal_texture: match normal {
            Some(n) => Some(TextureRef { texture: textures.index(&n.texture()), uv_from_uv: normal_transform(&n, &place)? }),
            None => None,
        },
        emissive: material.emissive_factor().map(|e| e * strength),
        emissive_texture: material.emissive_texture().map(|i| textures.reference(&i)),
        transmission,
        ior: material.ior().unwrap_or(1.5),
        double_sided: material.double_sided(),
    };
    let numbers = [optical.metallic, optical.roughness, optical.normal_scale, optical.transmission, optical.ior];
    if numbers.iter().chain(&optical.base_color).chain(&optical.emissive).any(|v| !(v.is_finite())) {
        return Err(Error::invalid(place, "a factor is not finite", "repair the material"));
    }
    Ok(Material { radio: radio(material, &name, &place)?, name, optical })
}

/// `KHR_texture_transform` of a normal texture, which the reader gives as plain JSON.
fn normal_transform(normal: &gltf::material::NormalTexture<'_>, place: &str) -> Result<Affine2> {
    #[derive(serde::Deserialize)]
    #[serde(default, rename_all = "camelCase")]
    struct Transform {
        offset: [f32; 2],
        rotation: f32,
        scale: [f32; 2],
    }
    impl Default for Transform {
        fn default() -> Self {
            Self { offset: [0.0; 2], rotation: 0.0, scale: [1.0; 2] }
        }
    }
    let Some(value) = normal.extension_value("KHR_texture_transform") else { return Ok(Affine2::IDENTITY) };
    let t: Transform = serde_json::from_value(value.clone()).map_err(|e| {
        Error::invalid(place, format!("KHR_texture_transform of the normal texture: {e}"), "export the model again")
    })?;
    Ok(uv_transform(t.offset, t.rotation, t.scale))
}

/// `extras.corf_radio`; other extras are nobody's business.
fn radio(material: &gltf::Material<'_>, name: &str, place: &str) -> Result<Option<crate::model::RadioMaterial>> {
    let Some(extras) = material.extras() else { return Ok(None) };
    let place = format!("{place}: extras.corf_radio");
    let value: serde_json::Value = serde_json::from_str(extras.get())
        .map_err(|e| Error::invalid(&place, format!("extras are no JSON: {e}"), "export the model again"))?;
    let Some(spec) = value.get("corf_radio") else { return Ok(None) };
    let spec: RadioSpec = serde_json::from_value(spec.clone()).map_err(|e| {
        Error::invalid(&place, e.to_string(), "keys: id, itu or relative_permittivity and conductivity_s_per_m, thickness_m, scattering_coefficient, xpd, scattering_pattern, alpha_r, alpha_i, lambda")
    })?;
    spec.to_material(name, &place).map(Some)
}
