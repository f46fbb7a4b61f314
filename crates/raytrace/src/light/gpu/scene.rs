//! The scene on the GPU: the buffers that `scene.wgsl` declares.

use super::super::LightTracer;
use super::super::bsdf::albedo_tables;
use super::super::emitter::{Emitter, Emitters, Kind};
use super::super::surface::Cover;
use super::super::texture::{Encoding, table};
use super::super::words::Words;
use crate::bvh::binary::BinaryTree;
use corf_gpu::Context;
use corf_scene::model::{AlphaMode, Filter, LightMaterial, PunctualKind, Texture, TextureRef, Wrap};
use corf_scene::{Error, Result, Scene};
use glam::{Vec2, Vec3};

/// Index of what is not there.
pub(super) const NONE: u32 = u32::MAX;

/// The scene's buffers in the order of their bindings (1 to 11).
pub(super) struct SceneBuffers {
    pub buffers: [wgpu::Buffer; 11],
    /// Place in the tree's leaves of every triangle of the scene; [`NONE`] of those that cannot be hit.
    pub place_of: Vec<u32>,
    /// Word of the guides' buffer at which visibilities begin.
    pub seen_at: u32,
}

impl SceneBuffers {
    /// `chart_of` gives a triangle's chart.
    ///
    /// # Errors
    /// A scene that does not fit the adapter.
    pub fn new(context: &Context, tracer: &LightTracer<'_>, tree: &BinaryTree, chart_of: impl Fn(u32) -> u32) -> Result<Self> {
        let scene = tracer.scene;
        let mut place_of = vec![NONE; scene.triangles.len()];
        for (place, &triangle) in (0u32..).zip(&tree.order) {
            if let Some(slot) = place_of.get_mut(triangle as usize) {
                *slot = place;
            }
        }
        let (texel_words, textures) = textures(scene, &tracer.coarse)?;
        let (guides, seen_at) = guides(&tracer.emitters);
        let all = [
            ("nodes", nodes(tree)),
            ("triangles", triangles(scene, &tracer.covers, tree)),
            ("attributes", attributes(scene, &tracer.emitters, tree, chart_of)),
            ("vertex colours", colors(scene, tree)),
            ("materials", materials(scene)),
            ("textures", textures),
            ("texels", texel_words),
            ("tables", tables()),
            ("emitters", emitters(&tracer.emitters, &place_of)),
            ("emitters' cells", tracer.emitters.cumulative.iter().map(|c| c.to_bits()).collect()),
            ("guides", guides),
        ];
        let mut buffers = Vec::with_capacity(all.len());
        for (label, words) in all {
            buffers.push(upload(context, label, &words)?);
        }
        let lost = |_| Error::invalid("gpu", "a buffer of the scene was lost", "this is a defect of the device");
        Ok(Self { buffers: buffers.try_into().map_err(lost)?, place_of, seen_at })
    }
}

/// The tree over a scene's triangles.
pub(super) fn tree(tracer: &LightTracer<'_>) -> BinaryTree {
    let corners: Vec<[Vec3; 3]> = (0..tracer.scene.triangles.len()).map(|i| tracer.scene.corners(i)).collect();
    BinaryTree::build(&corners)
}

/// What kernels are compiled for: constants in WGSL.
pub(super) fn constants(tracer: &LightTracer<'_>, tree: &BinaryTree) -> String {
    format!(
        "const STACK = {}u;\nconst ALL_OPAQUE = {};\nconst COLORS = {};\n",
        tree.depth + 1,
        tracer.all_opaque,
        !tracer.scene.colors.is_empty(),
    )
}

/// A storage buffer that holds some words.
pub(super) fn upload(context: &Context, label: &str, words: &[u32]) -> Result<wgpu::Buffer> {
    // A struct of WGSL has 112 bytes at most; a binding is no smaller than one element.
    let buffer = context.storage(label, (4 * words.len() as u64).max(256))?;
    context.fill(&buffer, 0, words);
    Ok(buffer)
}

fn nodes(tree: &BinaryTree) -> Vec<u32> {
    let mut words = Words::default();
    for node in &tree.nodes {
        words.v3(node.low[0]).u(node.children[0]).v3(node.high[0]).u(node.children[1]);
        words.v3(node.low[1]).u(0).v3(node.high[1]).u(0);
    }
    words.0
}

fn triangles(scene: &Scene, covers: &[Cover], tree: &BinaryTree) -> Vec<u32> {
    let mut words = Words::default();
    for &i in &tree.order {
        let (corners, cover) =
            if i == NONE { ([Vec3::ZERO; 3], Cover::OPAQUE) } else { (scene.corners(i as usize), covers[i as usize]) };
        let bits = u32::from(cover.alpha) | u32::from(cover.pane) << 1;
        words.v3(corners[0]).u(bits).v3(corners[1]).u(i).v3(corners[2]).u(0);
    }
    words.0
}

/// `Attributes::parts` of a triangle without texture coordinates.
const WITHOUT_UV: u32 = 1 << 31;

fn attributes(scene: &Scene, emitters: &Emitters, tree: &BinaryTree, chart_of: impl Fn(u32) -> u32) -> Vec<u32> {
    let mut words = Words::default();
    for &i in &tree.order {
        if i == NONE {
            words.0.extend([0; 20]);
            continue;
        }
        let triangle = &scene.triangles[i as usize];
        let vertices = triangle.vertices.map(|v| v as usize);
        let normals = vertices.map(|v| scene.normals.get(v).copied());
        let normals = if let [Some(a), Some(b), Some(c)] = normals { [a, b, c] } else { [Vec3::ZERO; 3] };
        let uvs = vertices.map(|v| scene.uvs.get(v).map(|uv| Vec2::from(*uv)));
        let without_uv = if uvs.iter().all(Option::is_some) { 0 } else { WITHOUT_UV };
        let uvs = uvs.map(Option::unwrap_or_default);
        let (emitter, parts) = emitters.of_triangle[i as usize];
        words.v3(normals[0]).u(triangle.material).v3(normals[1]).u(triangle.object).v3(normals[2]).u(chart_of(i));
        words.v2(uvs[0]).v2(uvs[1]).v2(uvs[2]).u(emitter).u(parts | without_uv);
    }
    words.0
}

fn colors(scene: &Scene, tree: &BinaryTree) -> Vec<u32> {
    let mut words = Words::default();
    if !scene.colors.is_empty() {
        for &i in &tree.order {
            let of = |vertex: u32| scene.colors[vertex as usize];
            let colors = if i == NONE { [[0.0; 4]; 3] } else { scene.triangles[i as usize].vertices.map(of) };
            colors.iter().flatten().for_each(|c| {
                words.f(*c);
            });
        }
    }
    words.0
}

fn map(words: &mut Words, reference: &Option<TextureRef>) {
    match reference {
        Some(TextureRef { texture, uv_from_uv }) => {
            words.v2(uv_from_uv.matrix2.x_axis).v2(uv_from_uv.matrix2.y_axis).v2(uv_from_uv.translation).u(*texture).u(0)
        }
        None => words.v2(Vec2::ZERO).v2(Vec2::ZERO).v2(Vec2::ZERO).u(NONE).u(0),
    };
}

fn materials(scene: &Scene) -> Vec<u32> {
    let mut words = Words::default();
    for material in &scene.materials {
        let m: &LightMaterial = &material.light;
        let (mode, cutoff) = match m.alpha_mode {
            AlphaMode::Opaque => (0, 0.0),
            AlphaMode::Mask { cutoff } => (1, cutoff),
            AlphaMode::Blend => (2, 0.0),
        };
        words.v3(m.base_color.into()).f(m.alpha).v3(m.emissive.into()).f(m.normal_scale);
        words.f(m.metallic).f(m.roughness).f(m.transmission).f(m.ior);
        words.f(cutoff).u(mode).u(u32::from(m.double_sided)).u(0);
        for reference in [&m.base_color_texture, &m.metallic_roughness_texture, &m.normal_texture, &m.emissive_texture] {
            map(&mut words, reference);
        }
    }
    words.0
}

/// Texels and headers of the scene's textures, then of the coarse ones.
fn textures(scene: &Scene, coarse: &[Texture]) -> Result<(Vec<u32>, Vec<u32>)> {
    let all = || scene.textures.iter().chain(coarse);
    let count: usize = all().map(|t| t.texels.pixels().len()).sum();
    if u32::try_from(count).is_err() {
        let what = format!("the scene's textures have {count} texels");
        return Err(Error::invalid("gpu", what, "make them smaller, or choose --device cpu"));
    }
    let (mut texels, mut headers) = (Vec::with_capacity(count), Words::default());
    for texture in all() {
        let wrap = |w: Wrap| match w {
            Wrap::Repeat => 0,
            Wrap::Mirror => 1,
            Wrap::Clamp => 2,
        };
        let mode = wrap(texture.wrap[0]) | wrap(texture.wrap[1]) << 2 | u32::from(texture.filter == Filter::Nearest) << 4;
        headers.u(texels.len() as u32).u(texture.texels.width() as u32).u(texture.texels.height() as u32).u(mode);
        texels.extend(texture.texels.pixels().iter().map(|t| u32::from_le_bytes(*t)));
    }
    Ok((texels, headers.0))
}

/// Decoded values of a byte, sRGB and linear, and the specular lobe's albedo.
fn tables() -> Vec<u32> {
    let mut words = Words::default();
    for (srgb, linear) in table(Encoding::Srgb).iter().zip(table(Encoding::Linear)) {
        words.f(*srgb).f(*linear);
    }
    for (scale, bias) in albedo_tables().into_iter().flatten() {
        words.f(*scale).f(*bias);
    }
    words.0
}

fn emitters(emitters: &Emitters, place_of: &[u32]) -> Vec<u32> {
    let mut words = Words::default();
    for Emitter { kind, luminance, power } in &emitters.list {
        match kind {
            Kind::Patch { corners: [a, b, c], weights, normal, area, double_sided, triangle } => {
                // What cannot be hit is of place 0, which is not there.
                let place = place_of[*triangle as usize];
                let place = if place == NONE { 0 } else { place };
                words.v3(*a).f(*area).v3(*b).u(place).v3(*c).u(u32::from(*double_sided) << 2);
                words.v3(*normal).f(*luminance).v3(*power).f(f32::MAX);
                weights.iter().for_each(|w| {
                    words.v2(*w);
                });
                words.v2(Vec2::ZERO);
            }
            Kind::Punctual(light) => {
                let (kind, cone) = match light.kind {
                    PunctualKind::Point => (1, Vec2::ZERO),
                    PunctualKind::Spot { inner_rad, outer_rad } => (2, Vec2::new(inner_rad.cos(), outer_rad.cos())),
                    PunctualKind::Directional => (3, Vec2::ZERO),
                };
                words.v3(light.position).f(0.0).v3(Vec3::ZERO).u(0).v3(Vec3::ZERO).u(kind);
                words.v3(light.direction).f(*luminance).v3(*power).f(light.range_m.unwrap_or(f32::MAX));
                words.v2(Vec2::ZERO).v2(Vec2::ZERO).v2(Vec2::ZERO).v2(cone);
            }
        }
    }
    words.0
}

/// The cells' guides, then what their visibility rays saw, four emitters a word; and where that begins.
fn guides(emitters: &Emitters) -> (Vec<u32>, u32) {
    let mut words: Vec<u32> = emitters.guides.iter().flatten().copied().collect();
    let seen_at = words.len() as u32;
    words.extend(emitters.seen.chunks(4).map(|c| c.iter().rev().fold(0, |word, byte| word << 8 | u32::from(*byte))));
    (words, seen_at)
}
