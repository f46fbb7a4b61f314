//! The scene on the GPU: the buffers that `scene.wgsl` binds, of records.

use super::super::LightTracer;
use super::super::bsdf::albedo_tables;
use super::super::emitter::{Emitter, Emitters, Kind};
use super::super::records;
use super::super::surface::Cover;
use super::super::texture::{Encoding, table};
use crate::bvh::binary::{BinaryNode, BinaryTree};
use corf_gpu::Context;
use corf_scene::model::{AlphaMode, Filter, LightMaterial, PunctualKind, Texture, TextureRef, Wrap};
use corf_scene::{Error, Result, Scene};
use glam::Vec3;

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
        let buffers = [
            upload(context, "nodes", &nodes(tree))?,
            upload(context, "triangles", &triangles(scene, &tracer.covers, tree))?,
            upload(context, "attributes", &attributes(scene, &tracer.emitters, tree, chart_of))?,
            upload(context, "vertex colours", &colors(scene, tree))?,
            upload(context, "materials", &materials(scene))?,
            upload(context, "textures", &textures)?,
            upload(context, "texels", &texel_words)?,
            upload(context, "tables", &tables())?,
            upload(context, "emitters", &emitters(&tracer.emitters, &place_of))?,
            upload(context, "emitters' cells", &tracer.emitters.cumulative)?,
            upload(context, "guides", &guides)?,
        ];
        Ok(Self { buffers, place_of, seen_at })
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

/// A storage buffer that holds some values.
pub(super) fn upload<T: bytemuck::Pod>(context: &Context, label: &str, values: &[T]) -> Result<wgpu::Buffer> {
    // A record has 192 bytes at most; a binding is no smaller than one element.
    let buffer = context.storage(label, (size_of_val(values) as u64).max(256))?;
    context.fill(&buffer, 0, values);
    Ok(buffer)
}

fn nodes(tree: &BinaryTree) -> Vec<records::Node> {
    let record = |node: &BinaryNode| records::Node {
        low_a: node.low[0].to_array(),
        a: node.children[0],
        high_a: node.high[0].to_array(),
        b: node.children[1],
        low_b: node.low[1].to_array(),
        high_b: node.high[1].to_array(),
        ..Default::default()
    };
    tree.nodes.iter().map(record).collect()
}

fn triangles(scene: &Scene, covers: &[Cover], tree: &BinaryTree) -> Vec<records::Triangle> {
    let record = |&i: &u32| {
        if i == NONE {
            return records::Triangle { number: NONE, ..Default::default() };
        }
        let ([a, b, c], cover) = (scene.corners(i as usize), covers[i as usize]);
        records::Triangle {
            a: a.to_array(),
            cover: u32::from(cover.alpha) | u32::from(cover.pane) << 1,
            b: b.to_array(),
            number: i,
            c: c.to_array(),
            unused: 0,
        }
    };
    tree.order.iter().map(record).collect()
}

/// `Attributes::parts` of a triangle without texture coordinates.
const WITHOUT_UV: u32 = 1 << 31;

fn attributes(scene: &Scene, emitters: &Emitters, tree: &BinaryTree, chart_of: impl Fn(u32) -> u32) -> Vec<records::Attributes> {
    let record = |&i: &u32| {
        if i == NONE {
            return records::Attributes::default();
        }
        let triangle = &scene.triangles[i as usize];
        let vertices = triangle.vertices.map(|v| v as usize);
        let normals = vertices.map(|v| scene.normals.get(v).copied());
        let normals = if let [Some(a), Some(b), Some(c)] = normals { [a, b, c] } else { [Vec3::ZERO; 3] };
        let uvs = vertices.map(|v| scene.uvs.get(v).copied());
        let without_uv = if uvs.iter().all(Option::is_some) { 0 } else { WITHOUT_UV };
        let [uv_a, uv_b, uv_c] = uvs.map(Option::unwrap_or_default);
        let (emitter, parts) = emitters.of_triangle[i as usize];
        records::Attributes {
            normal_a: normals[0].to_array(),
            material: triangle.material,
            normal_b: normals[1].to_array(),
            object: triangle.object,
            normal_c: normals[2].to_array(),
            chart: chart_of(i),
            uv_a,
            uv_b,
            uv_c,
            emitter,
            parts: parts | without_uv,
        }
    };
    tree.order.iter().map(record).collect()
}

/// Colours of the triangles' corners; none where the scene has none.
fn colors(scene: &Scene, tree: &BinaryTree) -> Vec<[f32; 4]> {
    if scene.colors.is_empty() {
        return Vec::new();
    }
    let of = |vertex: u32| scene.colors[vertex as usize];
    let corners = |&i: &u32| if i == NONE { [[0.0; 4]; 3] } else { scene.triangles[i as usize].vertices.map(of) };
    tree.order.iter().flat_map(corners).collect()
}

fn map(reference: &Option<TextureRef>) -> records::Map {
    match reference {
        Some(TextureRef { texture, uv_from_uv }) => records::Map {
            x_axis: uv_from_uv.matrix2.x_axis.to_array(),
            y_axis: uv_from_uv.matrix2.y_axis.to_array(),
            origin: uv_from_uv.translation.to_array(),
            texture: *texture,
            unused: 0,
        },
        None => records::Map { texture: NONE, ..Default::default() },
    }
}

fn materials(scene: &Scene) -> Vec<records::Material> {
    let record = |m: &LightMaterial| {
        let (alpha_mode, cutoff) = match m.alpha_mode {
            AlphaMode::Opaque => (0, 0.0),
            AlphaMode::Mask { cutoff } => (1, cutoff),
            AlphaMode::Blend => (2, 0.0),
        };
        records::Material {
            base_color: m.base_color,
            alpha: m.alpha,
            emissive: m.emissive,
            normal_scale: m.normal_scale,
            metallic: m.metallic,
            roughness: m.roughness,
            transmission: m.transmission,
            ior: m.ior,
            cutoff,
            alpha_mode,
            double_sided: u32::from(m.double_sided),
            unused: 0,
            base_color_map: map(&m.base_color_texture),
            metallic_roughness_map: map(&m.metallic_roughness_texture),
            normal_map: map(&m.normal_texture),
            emissive_map: map(&m.emissive_texture),
        }
    };
    scene.materials.iter().map(|material| record(&material.light)).collect()
}

/// Texels and headers of the scene's textures, then of the coarse ones.
fn textures(scene: &Scene, coarse: &[Texture]) -> Result<(Vec<u32>, Vec<records::Texture>)> {
    let all = || scene.textures.iter().chain(coarse);
    let count: usize = all().map(|t| t.texels.pixels().len()).sum();
    if u32::try_from(count).is_err() {
        let what = format!("the scene's textures have {count} texels");
        return Err(Error::invalid("gpu", what, "make them smaller, or choose --device cpu"));
    }
    let (mut texels, mut headers) = (Vec::with_capacity(count), Vec::new());
    for texture in all() {
        let wrap = |w: Wrap| match w {
            Wrap::Repeat => 0,
            Wrap::Mirror => 1,
            Wrap::Clamp => 2,
        };
        headers.push(records::Texture {
            first: texels.len() as u32,
            width: texture.texels.width() as u32,
            height: texture.texels.height() as u32,
            mode: wrap(texture.wrap[0]) | wrap(texture.wrap[1]) << 2 | u32::from(texture.filter == Filter::Nearest) << 4,
        });
        texels.extend(texture.texels.pixels().iter().map(|t| u32::from_le_bytes(*t)));
    }
    Ok((texels, headers))
}

/// Decoded values of a byte, sRGB and linear, and the specular lobe's albedo (scale, bias).
fn tables() -> Vec<[f32; 2]> {
    let bytes = table(Encoding::Srgb).iter().zip(table(Encoding::Linear)).map(|(srgb, linear)| [*srgb, *linear]);
    bytes.chain(albedo_tables().into_iter().flatten().map(|(scale, bias)| [*scale, *bias])).collect()
}

fn emitters(emitters: &Emitters, place_of: &[u32]) -> Vec<records::Emitter> {
    let record = |Emitter { kind, luminance, power }: &Emitter| {
        let common = records::Emitter { luminance: *luminance, power: power.to_array(), ..Default::default() };
        match kind {
            Kind::Patch { corners: [a, b, c], weights, normal, area, double_sided, triangle } => {
                // What cannot be hit is of place 0, which is not there.
                let place = place_of[*triangle as usize];
                records::Emitter {
                    a: a.to_array(),
                    area: *area,
                    b: b.to_array(),
                    triangle: if place == NONE { 0 } else { place },
                    c: c.to_array(),
                    kind: u32::from(*double_sided) << 2,
                    normal: normal.to_array(),
                    range_m: f32::MAX,
                    weight_a: weights[0].to_array(),
                    weight_b: weights[1].to_array(),
                    weight_c: weights[2].to_array(),
                    ..common
                }
            }
            Kind::Punctual(light) => {
                let (kind, cone) = match light.kind {
                    PunctualKind::Point => (1, [0.0; 2]),
                    PunctualKind::Spot { inner_rad, outer_rad } => (2, [inner_rad.cos(), outer_rad.cos()]),
                    PunctualKind::Directional => (3, [0.0; 2]),
                };
                records::Emitter {
                    a: light.position.to_array(),
                    kind,
                    normal: light.direction.to_array(),
                    range_m: light.range_m.unwrap_or(f32::MAX),
                    cone,
                    ..common
                }
            }
        }
    };
    emitters.list.iter().map(record).collect()
}

/// The cells' guides, then what their visibility rays saw, four emitters a word; and where that begins.
fn guides(emitters: &Emitters) -> (Vec<u32>, u32) {
    let mut words: Vec<u32> = emitters.guides.iter().flatten().copied().collect();
    let seen_at = words.len() as u32;
    words.extend(emitters.seen.chunks(4).map(|c| c.iter().rev().fold(0, |word, byte| word << 8 | u32::from(*byte))));
    (words, seen_at)
}
