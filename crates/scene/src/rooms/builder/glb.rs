//! Writes objects as binary glTF 2.0: y up, one node and one mesh an object, one primitive a material, textures inside.
//!
//! The JSON comes from structs, so its keys keep one order in every build.

use super::materials::{Mat, MaterialSpec, SurfaceRadio};
use super::mesh_builder::BuiltObject;
use super::textures::Tex;
use crate::draw::PictureFormat;
use glam::DVec3;
use rayon::prelude::*;
use serde::Serialize;
use serde_json::{Value, json};
use std::collections::BTreeSet;

const FLOAT: u32 = 5126;
const UNSIGNED_SHORT: u32 = 5123;
const UNSIGNED_INT: u32 = 5125;
const ARRAY_BUFFER: u32 = 34962;
const ELEMENT_ARRAY_BUFFER: u32 = 34963;

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct Accessor {
    buffer_view: usize,
    byte_offset: usize,
    component_type: u32,
    count: usize,
    #[serde(rename = "type")]
    kind: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    min: Option<[f32; 3]>,
    #[serde(skip_serializing_if = "Option::is_none")]
    max: Option<[f32; 3]>,
}

#[derive(Serialize)]
#[serde(rename_all = "camelCase")]
struct BufferView {
    buffer: usize,
    byte_offset: usize,
    byte_length: usize,
    #[serde(skip_serializing_if = "Option::is_none")]
    target: Option<u32>,
}

/// A JSON object whose keys stay in the order they were written in.
struct Ordered(Vec<(&'static str, Value)>);

impl Serialize for Ordered {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(k, v)| (k, v)))
    }
}

/// The wire form of an `Ordered` nested in another.
fn nested(fields: Vec<(&'static str, Value)>) -> Value {
    // serde_json's map sorts its keys, or keeps this order where that feature is on: sorted input makes both the same.
    let mut fields = fields;
    fields.sort_by_key(|f| f.0);
    Value::Object(fields.into_iter().map(|(k, v)| (k.to_owned(), v)).collect())
}

/// World (z up) to glTF (y up): (x, y, z) → (x, z, −y).
fn gltf_from_world(p: DVec3) -> [f32; 3] {
    [p.x as f32, p.z as f32, -p.y as f32]
}

/// Radio properties as `extras.corf_radio`.
fn radio_extras(spec: &MaterialSpec) -> Value {
    let (scattering, alpha_r) = spec.radio.scattering();
    let mut fields = vec![
        ("id", json!(spec.radio.id())),
        ("thickness_m", json!(spec.thickness_m)),
        ("scattering_coefficient", json!(scattering)),
        ("scattering_pattern", json!("directive")),
        ("alpha_r", json!(alpha_r)),
        ("xpd", json!(0.0)),
    ];
    match spec.radio {
        SurfaceRadio::Itu(name) => fields.push(("itu", json!(name))),
        SurfaceRadio::Given(_, relative_permittivity, loss_tangent) => {
            let sigma = MaterialSpec::conductivity_s_per_m(relative_permittivity, loss_tangent);
            fields.push(("relative_permittivity", json!(relative_permittivity)));
            fields.push(("conductivity_s_per_m", json!(sigma)));
        }
    }
    nested(vec![("corf_radio", nested(fields))])
}

/// A number as JSON shows it: float32's shortest form, not its f64 expansion.
fn number(x: f32) -> Value {
    let exact: f64 = format!("{x}").parse().unwrap_or(f64::from(x));
    json!(exact)
}

fn numbers(x: &[f32]) -> Value {
    Value::Array(x.iter().map(|v| number(*v)).collect())
}

/// One material; `texture` gives a texture's index in the file.
fn material_json(mat: Mat, texture: impl Fn(Tex) -> usize) -> Ordered {
    let spec = mat.spec();
    let reference = |t: Tex| nested(vec![("index", json!(texture(t)))]);
    let emits = spec.emissive.iter().any(|e| *e > 0.0);
    let mut pbr = vec![
        ("baseColorFactor", numbers(&[spec.base[0], spec.base[1], spec.base[2], 1.0])),
        ("metallicFactor", number(spec.metallic)),
        ("roughnessFactor", number(spec.roughness)),
    ];
    if let (Some(t), false) = (spec.texture, emits) {
        pbr.push(("baseColorTexture", reference(t)));
    }
    let mut fields = vec![("name", json!(spec.name)), ("pbrMetallicRoughness", nested(pbr))];
    if let Some(t) = spec.normal {
        fields.push(("normalTexture", reference(t)));
    }
    let mut extensions = Vec::new();
    if emits {
        let strength = spec.emissive.iter().fold(0.0_f32, |m, e| m.max(*e));
        fields.push(("emissiveFactor", numbers(&spec.emissive.map(|e| e / strength))));
        if let Some(t) = spec.texture {
            fields.push(("emissiveTexture", reference(t)));
        }
        extensions.push(("KHR_materials_emissive_strength", nested(vec![("emissiveStrength", number(strength))])));
    }
    if spec.transmission > 0.0 {
        extensions.push(("KHR_materials_transmission", nested(vec![("transmissionFactor", number(spec.transmission))])));
        extensions.push(("KHR_materials_ior", nested(vec![("ior", number(1.52))])));
    }
    // Lamps shine to their outside only: their housings behind them are closed. A lamp shade shines to both.
    fields.push(("doubleSided", json!(!emits || mat == Mat::LampShade)));
    if !extensions.is_empty() {
        fields.push(("extensions", nested(extensions)));
    }
    fields.push(("extras", radio_extras(&spec)));
    Ordered(fields)
}

/// The binary chunk under construction: one region a kind of data.
#[derive(Default)]
struct Regions {
    positions: Vec<u8>,
    normals: Vec<u8>,
    uvs: Vec<u8>,
    indices: Vec<u8>,
}

fn push_f32(region: &mut Vec<u8>, values: &[f32]) {
    values.iter().for_each(|v| region.extend_from_slice(&v.to_le_bytes()));
}

fn pad4(bytes: &mut Vec<u8>, with: u8) {
    bytes.resize(bytes.len().next_multiple_of(4), with);
}

/// The whole file. Objects keep their order; materials and textures are those in use, in the order of their declaration.
pub fn write(objects: &[BuiltObject]) -> Vec<u8> {
    let used: BTreeSet<Mat> = objects.iter().flat_map(|o| o.parts.iter().map(|p| p.0)).collect();
    let materials: Vec<Mat> = used.into_iter().collect();
    let used: BTreeSet<Tex> = materials.iter().flat_map(|m| [m.spec().texture, m.spec().normal]).flatten().collect();
    let textures: Vec<Tex> = used.into_iter().collect();
    let images: Vec<Vec<u8>> = textures.par_iter().map(|t| t.paint().encode(t.format())).collect();

    let mut regions = Regions::default();
    let (mut accessors, mut meshes, mut nodes) = (Vec::new(), Vec::new(), Vec::new());
    for (index, object) in objects.iter().enumerate() {
        let mut primitives = Vec::new();
        for (mat, mesh) in &object.parts {
            let size = mat.spec().texture_size_m;
            let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
            let offsets = [regions.positions.len(), regions.normals.len(), regions.uvs.len()];
            for ((p, n), uv) in mesh.positions.iter().zip(&mesh.normals).zip(&mesh.uvs_m) {
                let position = gltf_from_world(*p);
                for k in 0..3 {
                    low[k] = low[k].min(position[k]);
                    high[k] = high[k].max(position[k]);
                }
                push_f32(&mut regions.positions, &position);
                push_f32(&mut regions.normals, &gltf_from_world(*n));
                push_f32(&mut regions.uvs, &[(uv.x / size[0]) as f32, (uv.y / size[1]) as f32]);
            }
            let wide = mesh.positions.len() > usize::from(u16::MAX);
            let offset = regions.indices.len();
            for i in mesh.triangles.iter().flatten() {
                if wide {
                    regions.indices.extend_from_slice(&i.to_le_bytes());
                } else {
                    regions.indices.extend_from_slice(&(*i as u16).to_le_bytes());
                }
            }
            pad4(&mut regions.indices, 0);
            let first = accessors.len();
            let count = mesh.positions.len();
            for (view, kind, bounds) in [(0, "VEC3", Some((low, high))), (1, "VEC3", None), (2, "VEC2", None)] {
                accessors.push(Accessor {
                    buffer_view: view,
                    byte_offset: offsets[view],
                    component_type: FLOAT,
                    count,
                    kind,
                    min: bounds.map(|b| b.0),
                    max: bounds.map(|b| b.1),
                });
            }
            let component_type = if wide { UNSIGNED_INT } else { UNSIGNED_SHORT };
            let count = 3 * mesh.triangles.len();
            accessors.push(Accessor {
                buffer_view: 3,
                byte_offset: offset,
                component_type,
                count,
                kind: "SCALAR",
                min: None,
                max: None,
            });
            let attributes = [("NORMAL", json!(first + 1)), ("POSITION", json!(first)), ("TEXCOORD_0", json!(first + 2))];
            let material = materials.binary_search(mat).unwrap_or_default();
            primitives.push(nested(vec![
                ("attributes", nested(attributes.to_vec())),
                ("indices", json!(first + 3)),
                ("material", json!(material)),
            ]));
        }
        meshes.push(Ordered(vec![("name", json!(object.name)), ("primitives", Value::Array(primitives))]));
        nodes.push(Ordered(vec![("name", json!(object.name)), ("mesh", json!(index))]));
    }

    let mut binary = Vec::new();
    let mut views = Vec::new();
    let mut append = |bytes: Vec<u8>, target: Option<u32>| {
        views.push(BufferView { buffer: 0, byte_offset: binary.len(), byte_length: bytes.len(), target });
        binary.extend_from_slice(&bytes);
        pad4(&mut binary, 0);
    };
    append(regions.positions, Some(ARRAY_BUFFER));
    append(regions.normals, Some(ARRAY_BUFFER));
    append(regions.uvs, Some(ARRAY_BUFFER));
    append(regions.indices, Some(ELEMENT_ARRAY_BUFFER));
    images.into_iter().for_each(|image| append(image, None));

    #[derive(Serialize)]
    #[serde(rename_all = "camelCase")]
    struct Root {
        asset: Ordered,
        extensions_used: Vec<&'static str>,
        scene: usize,
        scenes: Vec<Ordered>,
        nodes: Vec<Ordered>,
        meshes: Vec<Ordered>,
        materials: Vec<Ordered>,
        textures: Vec<Ordered>,
        images: Vec<Ordered>,
        samplers: Vec<Ordered>,
        accessors: Vec<Accessor>,
        buffer_views: Vec<BufferView>,
        buffers: Vec<Ordered>,
    }
    let index_of = |t: Tex| textures.binary_search(&t).unwrap_or_default();
    let all_nodes: Vec<usize> = (0..nodes.len()).collect();
    let root = Root {
        asset: Ordered(vec![("version", json!("2.0")), ("generator", json!("corf scene builder"))]),
        extensions_used: vec!["KHR_materials_emissive_strength", "KHR_materials_ior", "KHR_materials_transmission"],
        scene: 0,
        scenes: vec![Ordered(vec![("nodes", json!(all_nodes))])],
        nodes,
        meshes,
        materials: materials.iter().map(|m| material_json(*m, index_of)).collect(),
        textures: (0..textures.len()).map(|i| Ordered(vec![("sampler", json!(0)), ("source", json!(i))])).collect(),
        images: textures
            .iter()
            .enumerate()
            .map(|(i, t)| {
                let mime = if t.format() == PictureFormat::Png { "image/png" } else { "image/jpeg" };
                Ordered(vec![("name", json!(t.name())), ("mimeType", json!(mime)), ("bufferView", json!(4 + i))])
            })
            .collect(),
        // Linear, trilinear, repeat.
        samplers: vec![Ordered(vec![
            ("magFilter", json!(9729)),
            ("minFilter", json!(9987)),
            ("wrapS", json!(10497)),
            ("wrapT", json!(10497)),
        ])],
        accessors,
        buffer_views: views,
        buffers: vec![Ordered(vec![("byteLength", json!(binary.len()))])],
    };
    container(serde_json::to_vec(&root).unwrap_or_default(), binary)
}

/// The GLB container around both chunks.
fn container(mut json: Vec<u8>, binary: Vec<u8>) -> Vec<u8> {
    pad4(&mut json, b' ');
    let total = 12 + 8 + json.len() + 8 + binary.len();
    let mut file = Vec::with_capacity(total);
    file.extend_from_slice(b"glTF");
    for word in [2, total as u32, json.len() as u32] {
        file.extend_from_slice(&word.to_le_bytes());
    }
    file.extend_from_slice(b"JSON");
    file.extend_from_slice(&json);
    file.extend_from_slice(&(binary.len() as u32).to_le_bytes());
    file.extend_from_slice(b"BIN\0");
    file.extend_from_slice(&binary);
    file
}
