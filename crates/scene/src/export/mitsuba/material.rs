//! Materials in terms of Mitsuba's own BSDFs.

use super::emission::{self, EmissionMap};
use super::slug;
use super::texture::{Textures, Use};
use super::xml::Xml;
use crate::model::{AlphaMode, LightMaterial, TextureRef};
use crate::{Result, Scene};
use std::collections::BTreeSet;

/// A material's id in the XML.
pub(super) fn id(scene: &Scene, index: u32) -> String {
    format!("m_{index}_{}", slug(&scene.materials[index as usize].name))
}

/// Whether light may pass a surface straight.
pub(super) fn is_seen_through(m: &LightMaterial) -> bool {
    m.transmission > 0.0 || m.alpha_mode != AlphaMode::Opaque
}

/// Opacity of a surface: full, uniform, or by a texture.
enum Opacity {
    All,
    Even(f32),
    Textured(TextureRef, Use),
}

/// Writes one material as a `bsdf` that shapes refer to by [`id`].
///
/// # Errors
/// A texture that cannot be encoded.
pub(super) fn write(
    scene: &Scene,
    index: u32,
    textures: &mut Textures<'_>,
    xml: &mut Xml,
    approximated: &mut BTreeSet<String>,
) -> Result<()> {
    let material = &scene.materials[index as usize];
    let m = &material.light;
    let id = id(scene, index);
    let colored = emission::is_colored(scene, index);
    let map = EmissionMap::of(scene, index);
    let mut note = |what: &str| {
        approximated.insert(format!("material \"{}\": {what}", material.name));
    };
    let references = [&m.base_color_texture, &m.metallic_roughness_texture, &m.normal_texture, &m.emissive_texture];
    for reference in references.into_iter().flatten() {
        if textures.get(Some(reference)).is_some_and(|t| t.wrap[0] != t.wrap[1]) {
            note("its texture wraps otherwise along v than along u, and Mitsuba knows one way");
        }
    }
    if colored && textures.get(m.base_color_texture.as_ref()).is_some() {
        note("vertex colours are left out, since it has a base colour texture");
    }
    if scene.colors.iter().any(|c| c[3] < 1.0) && m.alpha_mode != AlphaMode::Opaque {
        note("the alpha of vertex colours is left out");
    }
    let mut wrapper = Wrapper { id: Some(id), depth: 0 };
    match opacity(m, textures) {
        Opacity::All => {}
        Opacity::Even(alpha) => {
            wrapper.open(xml, "mask");
            xml.float("opacity", alpha);
        }
        Opacity::Textured(reference, wanted) => {
            wrapper.open(xml, "mask");
            textures.write(xml, "opacity", reference.texture, map.other(&reference), wanted)?;
        }
    }
    if m.transmission > 0.0 {
        if m.transmission < 1.0 {
            note("a pane that neither lets all light through nor mirrors it is a blend with a diffuse one");
            wrapper.open(xml, "blendbsdf");
            xml.float("weight", m.transmission);
            xml.open("bsdf", &[("type", "twosided")]);
            xml.open("bsdf", &[("type", "diffuse")]);
            base_color(m, colored, textures, &map, xml, "reflectance")?;
            xml.close();
            xml.close();
        }
        wrapper.open(xml, "thindielectric");
        xml.float("int_ior", m.ior.max(1.0));
        xml.float("ext_ior", 1);
        base_color(m, colored, textures, &map, xml, "specular_transmittance")?;
    } else {
        wrapper.open(xml, "twosided");
        if let Some(reference) = m.normal_texture.filter(|t| textures.get(Some(t)).is_some()) {
            wrapper.open(xml, "normalmap");
            textures.write(xml, "normalmap", reference.texture, map.other(&reference), Use::Normal(m.normal_scale))?;
        }
        wrapper.open(xml, "principled");
        base_color(m, colored, textures, &map, xml, "base_color")?;
        let (data, factors) = (m.metallic_roughness_texture, [("roughness", 1, m.roughness), ("metallic", 2, m.metallic)]);
        for (name, channel, factor) in factors {
            match data.filter(|t| factor > 0.0 && textures.get(Some(t)).is_some()) {
                Some(r) => textures.write(xml, name, r.texture, map.other(&r), Use::Data(channel, factor))?,
                None => xml.float(name, factor.clamp(0.0, 1.0)),
            }
        }
        // F₀ = ((ior − 1)/(ior + 1))²; an `eta` of 1 is refused by some versions.
        if m.ior > 1.0 { xml.float("eta", m.ior) } else { xml.float("specular", 0) }
    }
    wrapper.close(xml);
    Ok(())
}

/// Nested BSDFs, of which the outermost has the id.
struct Wrapper {
    id: Option<String>,
    depth: usize,
}

impl Wrapper {
    fn open(&mut self, xml: &mut Xml, kind: &str) {
        match self.id.take() {
            Some(id) => xml.open("bsdf", &[("type", kind), ("id", &id)]),
            None => xml.open("bsdf", &[("type", kind)]),
        }
        self.depth += 1;
    }

    fn close(self, xml: &mut Xml) {
        (0..self.depth).for_each(|_| xml.close());
    }
}

fn base_color(
    m: &LightMaterial,
    colored: bool,
    textures: &mut Textures<'_>,
    map: &EmissionMap,
    xml: &mut Xml,
    name: &str,
) -> Result<()> {
    match m.base_color_texture.filter(|t| textures.get(Some(t)).is_some()) {
        Some(r) => textures.write(xml, name, r.texture, map.other(&r), Use::Color(m.base_color))?,
        None if colored => {
            xml.open("texture", &[("type", "mesh_attribute"), ("name", name)]);
            xml.value("string", "name", "vertex_color");
            xml.close();
        }
        None => xml.rgb(name, m.base_color.map(|c| c.clamp(0.0, 1.0))),
    }
    Ok(())
}

fn opacity(m: &LightMaterial, textures: &Textures<'_>) -> Opacity {
    let holes = |t: &TextureRef| textures.get(Some(t)).is_some_and(|t| t.texels.pixels().iter().any(|p| p[3] < 255));
    let texture = m.base_color_texture.filter(holes);
    match (m.alpha_mode, texture) {
        (AlphaMode::Opaque, _) => Opacity::All,
        (AlphaMode::Mask { cutoff }, Some(t)) => Opacity::Textured(t, Use::Cutoff(m.alpha, cutoff)),
        (AlphaMode::Mask { cutoff }, None) if m.alpha < cutoff => Opacity::Even(0.0),
        (AlphaMode::Blend, Some(t)) => Opacity::Textured(t, Use::Coverage(m.alpha)),
        (AlphaMode::Blend, None) if m.alpha < 1.0 => Opacity::Even(m.alpha.max(0.0)),
        _ => Opacity::All,
    }
}
