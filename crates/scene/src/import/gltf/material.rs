//! glTF materials; radio properties from `extras.corf_radio`.

use super::super::notes::Notes;
use super::texture::{Textures, uv_transform};
use crate::model::{AlphaMode, LightMaterial, Material, TextureRef};
use crate::radio_spec::RadioSpec;
use crate::{Error, Result};
use glam::Affine2;
use gltf::texture::Info;

/// Texture-coordinate set (`TEXCOORD_n`) of a material: that of its base colour, or of the first texture it has.
pub(super) fn tex_coord_set(material: &gltf::Material<'_>) -> u32 {
    tex_coord_sets(material).first().copied().unwrap_or(0)
}

fn tex_coord_sets(material: &gltf::Material<'_>) -> Vec<u32> {
    let pbr = material.pbr_metallic_roughness();
    let of = |info: Info<'_>| info.texture_transform().and_then(|t| t.tex_coord()).unwrap_or(info.tex_coord());
    let base = match specular_glossiness(material) {
        Some(sg) => [sg.diffuse_texture(), sg.specular_glossiness_texture()],
        None => [pbr.base_color_texture(), pbr.metallic_roughness_texture()],
    };
    let mut sets: Vec<u32> = base.into_iter().chain([material.emissive_texture()]).flatten().map(of).collect();
    sets.extend(material.normal_texture().map(|n| n.tex_coord()));
    sets
}

/// The specular-glossiness model of a material that is drawn by it; an unlit one is not.
fn specular_glossiness<'a>(material: &gltf::Material<'a>) -> Option<gltf::material::PbrSpecularGlossiness<'a>> {
    material.pbr_specular_glossiness().filter(|_| !material.unlit())
}

/// One material.
pub(super) fn convert(material: &gltf::Material<'_>, textures: &mut Textures<'_>, notes: &mut Notes) -> Result<Material> {
    let name = material
        .name()
        .map_or_else(|| material.index().map_or("default".to_string(), |i| format!("material {i}")), str::to_string);
    let short = format!("material \"{name}\"");
    let place = format!("{}: {short}", textures.source.name);
    let sets = tex_coord_sets(material);
    if sets.iter().any(|s| Some(s) != sets.first()) {
        notes.warn(format!("its textures use different TEXCOORD sets; all are drawn with set {}", sets[0]), &short);
    }
    let base = base(material, textures, notes, &short);
    if material.transmission().is_some_and(|t| t.transmission_texture().is_some()) {
        notes.warn("its transmission texture is not used", &short);
    }
    let [r, g, b, alpha] = base.color;
    use gltf::material::AlphaMode as Mode;
    let alpha_mode = match material.alpha_mode() {
        Mode::Opaque => AlphaMode::Opaque,
        Mode::Mask => AlphaMode::Mask { cutoff: material.alpha_cutoff().unwrap_or(0.5) },
        Mode::Blend => AlphaMode::Blend,
    };
    let shaped = base.texture.is_some() || alpha_mode != AlphaMode::Blend;
    if alpha_mode != AlphaMode::Opaque && shaped {
        notes.warn("its alpha makes holes for light alone; radio meets the whole surface", &short);
    }
    let strength = material.emissive_strength().unwrap_or(1.0);
    let normal = material.normal_texture();
    let light = LightMaterial {
        base_color: [r, g, b],
        base_color_texture: base.texture,
        alpha,
        alpha_mode,
        metallic: base.metallic,
        roughness: base.roughness,
        metallic_roughness_texture: base.metallic_roughness_texture,
        normal_scale: normal.as_ref().map_or(1.0, |n| n.scale()),
        normal_texture: match normal {
            Some(n) => Some(TextureRef { texture: textures.index(&n.texture()), uv_from_uv: normal_transform(&n, &place)? }),
            None => None,
        },
        emissive: material.emissive_factor().map(|e| e * strength),
        emissive_texture: material.emissive_texture().map(|i| textures.reference(&i)),
        transmission: material.transmission().map_or(0.0, |t| t.transmission_factor()),
        ior: base.ior,
        double_sided: material.double_sided(),
    };
    let cutoff = if let AlphaMode::Mask { cutoff } = alpha_mode { cutoff } else { 0.0 };
    let numbers = [light.metallic, light.roughness, light.normal_scale, light.transmission, light.ior, alpha, cutoff];
    if numbers.iter().chain(&light.base_color).chain(&light.emissive).any(|v| !(v.is_finite())) {
        return Err(Error::invalid(place, "a factor is not finite", "repair the material"));
    }
    Ok(Material { radio: radio(material, &name, &place)?, name, light })
}

/// A material's base layer.
struct Base {
    /// Linear RGBA.
    color: [f32; 4],
    texture: Option<TextureRef>,
    metallic: f32,
    roughness: f32,
    metallic_roughness_texture: Option<TextureRef>,
    ior: f32,
}

/// The base layer by whichever model the material is given in.
fn base(material: &gltf::Material<'_>, textures: &mut Textures<'_>, notes: &mut Notes, short: &str) -> Base {
    let pbr = material.pbr_metallic_roughness();
    let base = Base {
        color: pbr.base_color_factor(),
        texture: None,
        metallic: pbr.metallic_factor(),
        roughness: pbr.roughness_factor(),
        metallic_roughness_texture: None,
        ior: material.ior().unwrap_or(1.5),
    };
    if material.unlit() {
        notes.warn("KHR_materials_unlit: it is drawn as a matt surface of its colour, and lit like any other", short);
        let texture = pbr.base_color_texture().map(|i| textures.reference(&i));
        return Base { texture, metallic: 0.0, roughness: 1.0, ior: 1.0, ..base };
    }
    if let Some(sg) = material.pbr_specular_glossiness() {
        return of_specular_glossiness(&sg, textures, notes, short);
    }
    Base {
        texture: pbr.base_color_texture().map(|i| textures.reference(&i)),
        metallic_roughness_texture: pbr.metallic_roughness_texture().map(|i| textures.reference(&i)),
        ..base
    }
}

/// Reflectance at normal incidence above which a specular colour is a metal's.
const METAL_REFLECTANCE: f32 = 0.25;

/// `KHR_materials_pbrSpecularGlossiness` in terms of metallic-roughness. The diffuse colour is the base colour; a grey specular colour
/// is the reflectance of a dielectric and gives its index of refraction; a strong one over black is a metal's base colour.
fn of_specular_glossiness(
    sg: &gltf::material::PbrSpecularGlossiness<'_>,
    textures: &mut Textures<'_>,
    notes: &mut Notes,
    short: &str,
) -> Base {
    let (diffuse, specular, glossiness) = (sg.diffuse_factor(), sg.specular_factor(), sg.glossiness_factor());
    let gloss_texture = sg.specular_glossiness_texture();
    let matt = Base {
        color: diffuse,
        texture: sg.diffuse_texture().map(|i| textures.reference(&i)),
        metallic: 0.0,
        roughness: if gloss_texture.is_some() { 1.0 } else { 1.0 - glossiness },
        metallic_roughness_texture: gloss_texture.as_ref().map(|i| textures.roughness_of_glossiness(i, glossiness)),
        ior: 1.5,
    };
    let (low, high) = specular.iter().fold((f32::INFINITY, 0.0f32), |(low, high), s| (low.min(*s), high.max(*s)));
    if gloss_texture.is_some() {
        notes.warn(
            "KHR_materials_pbrSpecularGlossiness: its specular colours are not read, its diffuse colour and glossiness are",
            short,
        );
        matt
    } else if high > METAL_REFLECTANCE && sg.diffuse_texture().is_none() && diffuse[..3].iter().all(|d| *d == 0.0) {
        Base { color: [specular[0], specular[1], specular[2], diffuse[3]], metallic: 1.0, ..matt }
    } else if high > METAL_REFLECTANCE || high - low > 0.02 {
        notes.warn(
            "KHR_materials_pbrSpecularGlossiness: its specular colour is not read, its diffuse colour and glossiness are",
            short,
        );
        matt
    } else {
        // Reflectance at normal incidence is ((n − 1)/(n + 1))².
        let root = (0.5 * (low + high)).max(0.0).sqrt();
        Base { ior: (1.0 + root) / (1.0 - root), ..matt }
    }
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
