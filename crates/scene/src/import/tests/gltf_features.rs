//! Tests of glTF features beside plain triangles: colours, morphs, instances, visibility, other material models, other encodings.

use super::*;
use crate::import::gltf;
use crate::import::{ImportOptions, ImportReport};
use crate::model::{AlphaMode, Filter};
use std::path::Path;

/// A file under construction.
pub(super) struct File {
    pub(super) json: Value,
    pub(super) bin: Vec<u8>,
}

impl File {
    pub(super) fn new() -> Self {
        let (json, bin) = parts();
        Self { json, bin }
    }

    /// Adds an accessor of its own view; returns its number. `stride` 0 is tight.
    pub(super) fn accessor(
        &mut self,
        component: u32,
        kind: &str,
        count: usize,
        normalized: bool,
        stride: usize,
        bytes: &[u8],
    ) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        let mut view = json!({ "buffer": 0, "byteOffset": self.bin.len(), "byteLength": bytes.len() });
        if stride > 0 {
            view["byteStride"] = json!(stride);
        }
        self.bin.extend(bytes);
        self.json["buffers"][0]["byteLength"] = json!(self.bin.len());
        let views = self.json["bufferViews"].as_array_mut().unwrap();
        views.push(view);
        let view = views.len() - 1;
        let accessors = self.json["accessors"].as_array_mut().unwrap();
        accessors.push(
            json!({ "bufferView": view, "componentType": component, "count": count, "type": kind, "normalized": normalized }),
        );
        accessors.len() - 1
    }

    pub(super) fn floats(&mut self, kind: &str, count: usize, values: &[f32]) -> usize {
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.accessor(5126, kind, count, false, 0, &bytes)
    }

    pub(super) fn primitive(&mut self) -> &mut Value {
        &mut self.json["meshes"][0]["primitives"][0]
    }

    pub(super) fn read_by(&self, options: &ImportOptions) -> crate::Result<(Scene, ImportReport)> {
        gltf::load(&glb(&self.json, &self.bin), Path::new("test.glb"), options)
    }

    pub(super) fn read(&self) -> (Scene, ImportReport) {
        self.read_by(&ImportOptions::default()).unwrap()
    }

    pub(super) fn refused(&self, words: &[&str]) {
        let message = self.read_by(&ImportOptions::default()).unwrap_err().to_string();
        for word in words.iter().chain(&["test.glb"]) {
            assert!(message.contains(word), "\"{word}\": {message}");
        }
    }
}

/// Lines of a report that hold a word.
pub(super) fn lines<'r>(report: &'r ImportReport, word: &str) -> Vec<&'r String> {
    report.notes.iter().chain(&report.unread).filter(|line| line.contains(word)).collect()
}

#[test]
fn the_plain_file_has_nothing_unread() {
    let (_, report) = File::new().read();
    assert_eq!((report.notes.len(), report.unread.len()), (0, 0), "{report:?}");
}

#[test]
fn vertex_colours_of_every_encoding_arrive() {
    let expected = [[1.0, 0.2, 0.0, 1.0], [0.0, 1.0, 0.4, 0.6], [0.8, 0.0, 1.0, 0.0]];
    for (kind, channels) in [("VEC4", 4), ("VEC3", 3)] {
        for component in [5126, 5121, 5123] {
            let mut f = File::new();
            let values = expected.iter().flat_map(|c| c[..channels].to_vec());
            let (bytes, stride): (Vec<u8>, usize) = match component {
                5126 => (values.flat_map(|v: f32| v.to_le_bytes()).collect(), 0),
                // Padded to four bytes a vertex, as the standard asks.
                5121 => (expected.iter().flat_map(|c| c.map(|v| (v * 255.0_f32).round() as u8)).collect(), 4),
                _ => (
                    expected
                        .iter()
                        .flat_map(|c| c.map(|v| (v * 65535.0_f32).round() as u16))
                        .flat_map(u16::to_le_bytes)
                        .collect(),
                    8,
                ),
            };
            let colors = f.accessor(component, kind, 3, component != 5126, stride, &bytes);
            f.primitive()["attributes"]["COLOR_0"] = json!(colors);
            let (scene, report) = f.read();
            assert!(report.notes.is_empty() && report.unread.is_empty(), "{report:?}");
            for (got, expected) in scene.colors.iter().zip(expected) {
                for c in 0..4 {
                    let expected = if c < channels { expected[c] } else { 1.0 };
                    assert!((got[c] - expected).abs() < 1e-6, "{kind} {component}: {got:?}");
                }
            }
            assert_eq!(scene.colors.len(), scene.positions.len());
        }
    }
    let mut f = File::new();
    let colors = f.accessor(5121, "VEC4", 3, false, 0, &[255; 12]);
    f.primitive()["attributes"]["COLOR_0"] = json!(colors);
    f.refused(&["not normalised", "meshes[0].primitives[0]"]);
}

#[test]
fn meshes_without_colours_are_white_beside_those_with() {
    let mut f = File::new();
    let colors = f.floats("VEC3", 3, &[0.5; 9]);
    let mut colored = f.json["meshes"][0].clone();
    colored["primitives"][0]["attributes"]["COLOR_0"] = json!(colors);
    f.json["meshes"].as_array_mut().unwrap().push(colored);
    f.json["nodes"].as_array_mut().unwrap().extend([json!({ "mesh": 1 }), json!({ "mesh": 0 })]);
    f.json["scenes"][0]["nodes"] = json!([0, 3, 4]);
    let (scene, _) = f.read();
    let of_triangle = |i: usize| scene.colors[scene.triangles[i].vertices[0] as usize];
    assert_eq!([of_triangle(0), of_triangle(1), of_triangle(2)], [[1.0; 4], [0.5, 0.5, 0.5, 1.0], [1.0; 4]]);
    assert_eq!(scene.colors.len(), scene.positions.len());
    assert!(self::scene().colors.is_empty());
}

#[test]
fn morph_targets_displace_by_the_meshs_weights_or_the_nodes() {
    let mut f = File::new();
    let up = f.floats("VEC3", 3, &[0.0, 0.0, 1.0, 0.0, 0.0, 1.0, 0.0, 0.0, 1.0]);
    let along = f.floats("VEC3", 3, &[0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    f.primitive()["targets"] = json!([{ "POSITION": up }, { "POSITION": along, "TANGENT": along }]);
    // Without weights all are 0.
    assert_eq!(f.read().0.corners(0), scene().corners(0));
    f.json["meshes"][0]["weights"] = json!([0.5, 0.0]);
    let corners = f.read().0.corners(0);
    // File (x, y, z + 0.5) under the node: world (1 + 2u, −3.5, 2 + v).
    assert_eq!(corners, [Vec3::new(1.0, -3.5, 2.0), Vec3::new(3.0, -3.5, 2.0), Vec3::new(1.0, -3.5, 3.0)]);
    f.json["nodes"][1]["weights"] = json!([0.0, 2.0]);
    assert_eq!(f.read().0.corners(0), [Vec3::new(1.0, -3.0, 2.0), Vec3::new(7.0, -3.0, 2.0), Vec3::new(1.0, -3.0, 3.0)]);
    f.json["nodes"][1]["weights"] = json!([1.0]);
    f.refused(&["2 morph targets", "1 weights"]);
    f.json["nodes"][1].as_object_mut().unwrap().remove("weights");
    let short = f.floats("VEC3", 2, &[0.0; 6]);
    f.primitive()["targets"][0] = json!({ "POSITION": short });
    f.refused(&["targets[0]", "2 displacements for 3 vertices"]);
}

#[test]
fn morph_targets_displace_colours_and_texture_coordinates() {
    let mut f = File::new();
    let colors = f.floats("VEC3", 3, &[0.5; 9]);
    f.primitive()["attributes"]["COLOR_0"] = json!(colors);
    let brighter = f.floats("VEC3", 3, &[0.2, 0.0, 0.9, 0.2, 0.0, 0.9, 0.2, 0.0, 0.9]);
    let aside = f.floats("VEC2", 3, &[0.25, 0.0, 0.25, 0.0, 0.25, 0.0]);
    f.primitive()["targets"] = json!([{ "COLOR_0": brighter, "TEXCOORD_0": aside }]);
    f.json["meshes"][0]["weights"] = json!([1.0]);
    let (scene, _) = f.read();
    assert_eq!(scene.colors[0], [0.7, 0.5, 1.0, 1.0]);
    assert_eq!(scene.uvs[..3], [[0.25, 1.0], [1.25, 1.0], [0.25, 0.0]]);
}

#[test]
fn instances_are_objects_of_their_own() {
    let mut f = File::new();
    let translations = f.floats("VEC3", 2, &[0.0, 0.0, 0.0, 0.0, 5.0, 0.0]);
    // The second is turned by 90° about the file's y, given as normalised bytes (0.7087 instead of 0.7071), and doubled.
    let rotations = f.accessor(5120, "VEC4", 2, true, 0, &[0, 0, 0, 127, 0, 90, 0, 90]);
    let scales = f.floats("VEC3", 2, &[1.0, 1.0, 1.0, 2.0, 2.0, 2.0]);
    f.json["nodes"][1]["extensions"] = json!({ "EXT_mesh_gpu_instancing": { "attributes": {
        "TRANSLATION": translations, "ROTATION": rotations, "SCALE": scales, "_ID": scales } } });
    f.json["extensionsRequired"] = json!(["EXT_mesh_gpu_instancing"]);
    let (scene, report) = f.read();
    assert_eq!(scene.objects.iter().map(|o| o.name.as_str()).collect::<Vec<_>>(), ["Wall (instance 0)", "Wall (instance 1)"]);
    assert_eq!(scene.corners(0), self::scene().corners(0));
    // (1, 0, 0) doubled, turned to (0, 0, −2), under the node's scale (2, 1, 1) and the root's translation (1, 2, 3).
    let expected = [Vec3::new(1.0, -3.0, 7.0), Vec3::new(1.0, -1.0, 7.0), Vec3::new(1.0, -3.0, 9.0)];
    for (got, expected) in scene.corners(1).iter().zip(expected) {
        assert!((*got - expected).length() < 1e-5, "{got} {expected}");
    }
    assert_eq!((report.notes.len(), lines(&report, "_ID").len()), (0, 1), "{report:?}");
    f.json["nodes"][1]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["SCALE"] = json!(0);
    f.refused(&["EXT_mesh_gpu_instancing", "values where another attribute has"]);
    f.json["nodes"][1]["extensions"]["EXT_mesh_gpu_instancing"]["attributes"]["SCALE"] = json!(77);
    f.refused(&["accessor 77 of"]);
}

#[test]
fn invisible_nodes_are_left_out_with_all_below_them() {
    let mut f = File::new();
    f.json["nodes"].as_array_mut().unwrap().push(json!({ "name": "Stays", "mesh": 0 }));
    f.json["scenes"][0]["nodes"] = json!([0, 3]);
    let hidden = |visible: Value| json!({ "KHR_node_visibility": { "visible": visible } });
    f.json["nodes"][0]["extensions"] = hidden(json!(false));
    // What is below stays hidden whatever it says itself.
    f.json["nodes"][1]["extensions"] = hidden(json!(true));
    let (scene, report) = f.read();
    assert_eq!((scene.objects.len(), scene.objects[0].name.as_str(), scene.lights.len()), (1, "Stays", 0));
    assert_eq!(
        lines(&report, "KHR_node_visibility"),
        ["nodes[1] \"Wall\" and 1 more: is left out: KHR_node_visibility says that it or a node above it is not visible"]
    );
    f.json["nodes"][0]["extensions"] = hidden(json!("no"));
    f.refused(&["KHR_node_visibility", "nodes[0]"]);
}

#[test]
fn specular_glossiness_gives_its_colour() {
    let with = |sg: Value| {
        let mut f = File::new();
        f.json["materials"][0] = json!({ "extensions": { "KHR_materials_pbrSpecularGlossiness": sg } });
        let (scene, report) = f.read();
        (scene.materials[0].light.clone(), scene.textures, report)
    };
    let (m, _, report) =
        with(json!({ "diffuseFactor": [0.8, 0.05, 0.1, 0.5], "specularFactor": [0.04, 0.04, 0.04], "glossinessFactor": 0.25 }));
    assert_eq!((m.base_color, m.alpha, m.metallic, m.roughness), ([0.8, 0.05, 0.1], 0.5, 0.0, 0.75));
    assert!((m.ior - 1.5).abs() < 1e-6 && report.notes.is_empty(), "{} {report:?}", m.ior);
    // Strong and coloured over black: a metal.
    let (m, ..) = with(json!({ "diffuseFactor": [0, 0, 0, 1], "specularFactor": [1.0, 0.7, 0.3] }));
    assert_eq!((m.base_color, m.metallic, m.roughness), ([1.0, 0.7, 0.3], 1.0, 0.0));
    // Strong over a colour: no metallic-roughness surface is like it, and a note says what is kept.
    let (m, _, report) = with(json!({ "diffuseFactor": [0.5, 0.5, 0.5, 1], "glossinessFactor": 0.5 }));
    assert_eq!((m.base_color, m.metallic, m.ior), ([0.5; 3], 0.0, 1.5));
    assert_eq!(lines(&report, "specular colour").len(), 1, "{report:?}");
    // Textures: the diffuse one as it is, glossiness from the other's alpha.
    let (m, textures, report) = with(json!({ "diffuseTexture": { "index": 0 }, "specularGlossinessTexture": { "index": 0 },
        "glossinessFactor": 0.4 }));
    assert_eq!((m.base_color, m.roughness, textures.len()), ([1.0; 3], 1.0, 2));
    assert_eq!(textures[m.base_color_texture.unwrap().texture as usize].texels.pixels()[0], [255, 0, 0, 255]);
    // The test's texture is opaque: glossiness 0.4 · 1.
    assert_eq!(textures[m.metallic_roughness_texture.unwrap().texture as usize].texels.pixels()[0][1], 255 - 102);
    assert_eq!(lines(&report, "KHR_materials_pbrSpecularGlossiness").len(), 1);
}

#[test]
fn unlit_materials_are_matt_and_noted() {
    let mut f = File::new();
    f.json["materials"][0]["extensions"] = json!({ "KHR_materials_unlit": {} });
    let (scene, report) = f.read();
    let m = &scene.materials[0].light;
    assert_eq!((m.base_color, m.metallic, m.roughness, m.ior), ([0.5, 0.25, 0.125], 0.0, 1.0, 1.0));
    assert!(m.base_color_texture.is_some());
    assert_eq!(lines(&report, "KHR_materials_unlit").len(), 1);
}

#[test]
fn alpha_arrives_as_the_file_has_it() {
    let mut f = File::new();
    f.json["materials"][0]["pbrMetallicRoughness"]["baseColorFactor"] = json!([0.1, 0.1, 0.1, 0.25]);
    f.json["materials"][0]["alphaMode"] = json!("BLEND");
    let (scene, report) = f.read();
    let m = &scene.materials[0].light;
    assert_eq!((m.alpha, m.alpha_mode, m.transmission), (0.25, AlphaMode::Blend, 0.9));
    assert_eq!(lines(&report, "radio meets the whole surface").len(), 1);
    f.json["materials"][0]["alphaMode"] = json!("MASK");
    assert_eq!(f.read().0.materials[0].light.alpha_mode, AlphaMode::Mask { cutoff: 0.5 });
    f.json["materials"][0]["alphaCutoff"] = json!(0.75);
    assert_eq!(f.read().0.materials[0].light.alpha_mode, AlphaMode::Mask { cutoff: 0.75 });
}

#[test]
fn nearest_samplers_are_nearest() {
    let mut f = File::new();
    assert_eq!(f.read().0.textures[0].filter, Filter::Linear);
    f.json["samplers"][0]["magFilter"] = json!(9728);
    assert_eq!(f.read().0.textures[0].filter, Filter::Nearest);
    f.json["samplers"][0]["magFilter"] = json!(9729);
    f.json["samplers"][0]["minFilter"] = json!(9728);
    assert_eq!(f.read().0.textures[0].filter, Filter::Linear);
}

#[test]
fn a_rotation_that_is_not_unit_turns_and_does_not_scale() {
    let mut f = File::new();
    let half = std::f32::consts::FRAC_1_SQRT_2;
    f.json["nodes"][1]["rotation"] = json!([0.0, 0.0, half, half]);
    let (unit, report) = f.read();
    assert!(report.notes.is_empty(), "{report:?}");
    for factor in [2.0f32, 0.1, -3.0, 1e18] {
        f.json["nodes"][1]["rotation"] = json!([0.0, 0.0, half * factor, half * factor]);
        let (scene, report) = f.read();
        for (a, b) in scene.corners(0).iter().zip(unit.corners(0)) {
            assert!((*a - b).length() < 1e-6, "{factor}: {a} {b}");
        }
        assert_eq!(lines(&report, "no unit quaternion").len(), 1, "{factor} {report:?}");
    }
    f.json["nodes"][1]["rotation"] = json!([0.0, 0.0, 0.0, 0.0]);
    f.refused(&["nodes[1] \"Wall\"", "no quaternion"]);
    f.json["nodes"][1]["rotation"] = json!([1e39, 0.0, 0.0, 1.0]);
    f.refused(&["out of range"]);
}

#[test]
fn quantised_meshes_are_read_as_they_are_meant() {
    let mut f = File::new();
    f.json["extensionsUsed"] = json!(["KHR_mesh_quantization"]);
    f.json["extensionsRequired"] = json!(["KHR_mesh_quantization"]);
    let shorts = |v: &[i16]| v.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>();
    // Positions: normalised shorts, padded to eight bytes; unit normals and texture coordinates as bytes.
    let positions = f.accessor(5122, "VEC3", 3, true, 8, &shorts(&[0, 0, 0, 0, 32767, 0, 0, 0, 0, 32767, -32768, 0]));
    let normals = f.accessor(5120, "VEC3", 3, true, 4, &[0, 0, 127, 0, 0, 0, 127, 0, 0, 0x81, 0, 0]);
    let uvs = f.accessor(5121, "VEC2", 3, false, 4, &[0, 1, 0, 0, 2, 1, 0, 0, 0, 200, 0, 0]);
    f.primitive()["attributes"] = json!({ "POSITION": positions, "NORMAL": normals, "TEXCOORD_0": uvs });
    let (scene, _) = f.read();
    // The last vertex is at file (0, 1, −1): world (1, −2, 3).
    assert_eq!(scene.corners(0), [Vec3::new(1.0, -3.0, 2.0), Vec3::new(3.0, -3.0, 2.0), Vec3::new(1.0, -2.0, 3.0)]);
    // File +z is world −y, file −y world −z.
    let normal = |k: usize| scene.normals[scene.triangles[0].vertices[k] as usize];
    assert!((normal(0) + Vec3::Y).length() < 1e-6 && (normal(2) + Vec3::Z).length() < 1e-6);
    assert_eq!(scene.uvs, [[0.0, 1.0], [2.0, 1.0], [0.0, 200.0]]);
    // Integers as they are, which the node's scale brings to metres.
    let positions = f.accessor(5121, "VEC3", 3, false, 4, &[0, 0, 0, 0, 200, 0, 0, 0, 0, 100, 0, 0]);
    f.primitive()["attributes"]["POSITION"] = json!(positions);
    f.json["nodes"][1]["scale"] = json!([0.01, 0.01, 0.01]);
    let corners = f.read().0.corners(0);
    assert!((corners[1] - Vec3::new(3.0, -3.0, 2.0)).length() < 1e-6 && (corners[2] - Vec3::new(1.0, -3.0, 3.0)).length() < 1e-6);
}

#[test]
fn compressed_meshes_with_plain_data_beside_are_read() {
    let mut f = File::new();
    f.json["extensionsUsed"] = json!(["KHR_draco_mesh_compression"]);
    f.primitive()["extensions"] = json!({ "KHR_draco_mesh_compression": { "bufferView": 2, "attributes": { "POSITION": 0 } } });
    let (scene, report) = f.read();
    assert_eq!(scene.corners(0), self::scene().corners(0));
    assert!(report.notes.is_empty() && report.unread.is_empty(), "{report:?}");
    f.json["extensionsRequired"] = json!(["KHR_draco_mesh_compression"]);
    assert_eq!(f.read().0.corners(0), self::scene().corners(0));
    // Any attribute without data makes the fallback incomplete.
    for accessor in 0..3 {
        let mut f = File { json: f.json.clone(), bin: f.bin.clone() };
        f.json["accessors"][accessor].as_object_mut().unwrap().remove("bufferView");
        f.refused(&["KHR_draco_mesh_compression", "meshes[0].primitives[0]", "without Draco"]);
    }
    // Without the extension nobody has the data.
    f.primitive().as_object_mut().unwrap().remove("extensions");
    f.json["accessors"][0].as_object_mut().unwrap().remove("bufferView");
    f.refused(&["accessor 0", "has no data"]);
}

#[test]
fn compressed_buffers_with_plain_data_beside_are_read() {
    for name in ["EXT_meshopt_compression", "KHR_meshopt_compression"] {
        let mut f = File::new();
        f.json["extensionsUsed"] = json!([name]);
        f.json["extensionsRequired"] = json!([name]);
        f.json["bufferViews"][0]["extensions"] =
            json!({ name: { "buffer": 0, "byteLength": 8, "byteStride": 12, "count": 3, "mode": "ATTRIBUTES" } });
        assert_eq!(f.read().0.corners(0), self::scene().corners(0));
        // A fallback buffer without data.
        f.json["buffers"].as_array_mut().unwrap().push(json!({ "byteLength": 36, "extensions": { name: { "fallback": true } } }));
        f.json["bufferViews"][0]["buffer"] = json!(1);
        f.refused(&[name, "buffer view 0", "no plain data"]);
    }
}

#[test]
fn textures_in_other_formats_are_read_by_their_fallback() {
    for name in ["EXT_texture_webp", "KHR_texture_basisu", "EXT_texture_avif", "MSFT_texture_dds"] {
        let mut f = File::new();
        f.json["images"].as_array_mut().unwrap().push(json!({ "uri": "not-there.webp", "mimeType": "image/webp" }));
        f.json["textures"][0]["extensions"] = json!({ name: { "source": 1 } });
        for required in [json!([]), json!([name])] {
            f.json["extensionsRequired"] = required;
            assert_eq!(f.read().0.textures[0].texels.pixels(), &[[255, 0, 0, 255], [0, 0, 255, 255]]);
        }
        f.json["textures"][0].as_object_mut().unwrap().remove("source");
        f.refused(&[name, "textures[0]", "PNG or JPEG"]);
    }
    // What is no texture of a material is nobody's need.
    let mut f = File::new();
    f.json["textures"].as_array_mut().unwrap().push(json!({ "extensions": { "EXT_texture_webp": { "source": 0 } } }));
    f.read();
}

#[test]
fn required_extensions_that_are_not_read_are_refused_by_name() {
    let mut f = File::new();
    f.json["extensionsRequired"] = json!(["KHR_mesh_quantization", "KHR_materials_diffuse_transmission"]);
    f.refused(&["KHR_materials_diffuse_transmission", "extensionsRequired", "take the name out"]);
    f.json["extensionsRequired"] = json!([]);
    f.json["asset"]["version"] = json!("1.0");
    f.refused(&["asset.version", "1.0"]);
}

#[test]
fn what_is_not_read_is_told_once_a_kind() {
    let mut f = File::new();
    let more = f.floats("VEC2", 3, &[0.0; 6]);
    let wide = f.floats("VEC4", 3, &[0.0; 12]);
    let attributes = f.primitive()["attributes"].as_object_mut().unwrap();
    for (name, accessor) in [("TEXCOORD_1", more), ("COLOR_1", wide), ("TANGENT", wide), ("_BATCHID", more)] {
        attributes.insert(name.into(), json!(accessor));
    }
    let coated = json!({ "name": "Car", "extensions": { "KHR_materials_clearcoat": {}, "KHR_materials_sheen": {} },
        "occlusionTexture": { "index": 0 } });
    f.json["materials"].as_array_mut().unwrap().extend([coated.clone(), coated.clone(), coated]);
    f.json["cameras"] = json!([{ "type": "perspective", "perspective": { "yfov": 1.0, "znear": 0.1 } }]);
    f.json["nodes"][0]["camera"] = json!(0);
    f.json["nodes"].as_array_mut().unwrap().push(json!({ "name": "Elsewhere", "mesh": 0 }));
    f.json["scenes"].as_array_mut().unwrap().push(json!({ "nodes": [3] }));
    let times = f.floats("SCALAR", 2, &[0.0, 1.0]);
    let values = f.floats("VEC3", 2, &[0.0; 6]);
    let animation = json!({ "channels": [{ "sampler": 0, "target": { "node": 1, "path": "translation" } }],
        "samplers": [{ "input": times, "output": values }] });
    f.json["animations"] = json!([animation.clone(), animation]);
    f.json["extensions"]["EXT_lights_image_based"] = json!({ "lights": [] });
    f.json["asset"]["extensions"] = json!({ "KHR_xmp_json_ld": { "packet": 0 } });
    f.json["extras"] = json!({ "extensions": { "not": "one" } });
    let (_, report) = f.read();
    for (word, start) in [
        ("KHR_materials_clearcoat", "materials[1] \"Car\" and 2 more: "),
        ("KHR_materials_sheen", "materials[1] \"Car\" and 2 more: "),
        ("no scene that is read", "nodes[3] \"Elsewhere\": "),
        ("EXT_lights_image_based", "extensions: "),
    ] {
        let found = lines(&report, word);
        assert!(found.len() == 1 && found[0].starts_with(start) && report.notes.contains(found[0]), "{word}: {report:#?}");
    }
    for (word, start) in [
        ("TEXCOORD_1", "meshes[0].primitives[0]: "),
        ("COLOR_1", "meshes[0].primitives[0]: "),
        ("TANGENT", "meshes[0].primitives[0]: "),
        ("_BATCHID", "meshes[0].primitives[0]: "),
        ("occlusion", "materials[1] and 2 more: "),
        ("cameras", "nodes[0] \"Room\": "),
        ("animations", "animations[0] and 1 more: "),
        ("KHR_xmp_json_ld", "asset: "),
    ] {
        let found = lines(&report, word);
        assert!(found.len() == 1 && found[0].starts_with(start) && report.unread.contains(found[0]), "{word}: {report:#?}");
    }
    assert_eq!((report.notes.len(), report.unread.len()), (4, 8), "{report:#?}");
}

#[test]
fn a_file_that_is_z_up_is_read_as_one_where_it_is_said() {
    let f = File::new();
    let up = |up| f.read_by(&ImportOptions { up, ..ImportOptions::default() }).unwrap().0;
    assert_eq!(up(Some(UpAxis::Y)).corners(0), scene().corners(0));
    // As the file has it: (1 + 2u, 2 + v, 3), facing +z.
    let z = up(Some(UpAxis::Z));
    assert_eq!(z.corners(0), [Vec3::new(1.0, 2.0, 3.0), Vec3::new(3.0, 2.0, 3.0), Vec3::new(1.0, 3.0, 3.0)]);
    assert!((z.normals[0] - Vec3::Z).length() < 1e-6 && (z.lights[0].direction + Vec3::Z).length() < 1e-6);
}

#[test]
fn an_offset_is_taken_off_translations_in_doubles() {
    let mut f = File::new();
    // World (x, -z, y). Neither number is one of single precision, whose steps are 1/32 m there.
    f.json["nodes"][0]["translation"] = json!([446_521.007_812_5, 2.0, -85_232.996_093_75]);
    let options = ImportOptions { offset_m: Some([446_520.007_812_5, 85_235.996_093_75, 0.0]), ..ImportOptions::default() };
    let near = scene();
    let same = |scene: &Scene| {
        assert_eq!(scene.positions, near.positions);
        assert_eq!(scene.normals, near.normals);
        assert!((scene.lights[0].position - near.lights[0].position).length() < 1e-6);
    };
    let (moved, report) = f.read_by(&options).unwrap();
    same(&moved);
    assert!(report.notes.is_empty(), "{report:?}");
    let translation = f.json["nodes"][0]["translation"].take();
    let t: Vec<f64> = translation.as_array().unwrap().iter().map(|v| v.as_f64().unwrap()).collect();
    f.json["nodes"][0] = json!({ "children": [1, 2], "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, t[0], t[1], t[2], 1] });
    same(&f.read_by(&options).unwrap().0);
    // Vertices that the file itself holds in single precision far out are said to be as coarse as that.
    let far = f.floats("VEC3", 3, &[446_520.0, 0.0, 0.0, 446_521.0, 0.0, 0.0, 446_520.0, 1.0, 0.0]);
    f.primitive()["attributes"]["POSITION"] = json!(far);
    f.json["nodes"][0] = json!({ "children": [1, 2] });
    let (_, report) = f.read_by(&ImportOptions { offset_m: Some([893_040.0, 0.0, 0.0]), ..ImportOptions::default() }).unwrap();
    assert!(report.notes.len() == 1 && report.notes[0].contains("893042 m"), "{report:?}");
}

#[test]
fn counts_that_no_data_backs_take_no_memory() {
    let mut f = File::new();
    // A sparse accessor of four billion elements; instances of nothing; a cycle; numbers that no address has.
    let sparse = |count: u64| {
        json!({ "componentType": 5126, "count": count, "type": "VEC3",
        "sparse": { "count": 1, "indices": { "bufferView": 2, "componentType": 5121 }, "values": { "bufferView": 0 } } })
    };
    for count in [4_194_305u64, 4_000_000_000, u64::MAX] {
        f.json["accessors"][0] = sparse(count);
        f.refused(&["accessor 0", "elements without data"]);
    }
    let mut f = File::new();
    for (pointer, value) in [
        ("/accessors/0/count", json!(u64::MAX)),
        ("/accessors/0/count", json!(u64::MAX / 12 + 1)),
        ("/bufferViews/0/byteLength", json!(u64::MAX)),
        ("/accessors/0/byteOffset", json!(u64::MAX)),
        ("/bufferViews/0/byteStride", json!(4)),
    ] {
        let mut broken = File { json: f.json.clone(), bin: f.bin.clone() };
        let (parent, member) = pointer.rsplit_once('/').unwrap();
        broken.json.pointer_mut(parent).unwrap()[member] = value;
        broken.refused(&["accessor 0"]);
    }
    f.json["accessors"][0]["byteOffset"] = json!(-4);
    f.refused(&["not readable as glTF"]);
    let mut f = File::new();
    let big = f.accessor(5126, "VEC3", 0, false, 0, &[]);
    f.json["accessors"][big] = sparse(1_000_001);
    f.json["nodes"][1]["extensions"] = json!({ "EXT_mesh_gpu_instancing": { "attributes": { "TRANSLATION": big } } });
    f.refused(&["EXT_mesh_gpu_instancing", "1000001 instances"]);
    f.json["accessors"][big] = sparse(1_000_000);
    let indices: Vec<u8> = [0u8, 1, 2].repeat(60);
    let indices = f.accessor(5121, "SCALAR", 180, false, 0, &indices);
    f.primitive()["indices"] = json!(indices);
    f.refused(&["1000000 instances of 60 triangles", "50000000"]);
}

#[test]
fn trees_of_any_depth_are_walked() {
    let mut f = File::new();
    let depth = 20_000;
    let nodes = f.json["nodes"].as_array_mut().unwrap();
    nodes.extend((0..depth).map(|i| json!({ "children": [if i + 1 < depth { 4 + i } else { 0 }] })));
    f.json["scenes"][0]["nodes"] = json!([3]);
    assert_eq!(f.read().0.corners(0), scene().corners(0));
    f.json["nodes"][2]["children"] = json!([3]);
    f.refused(&["two parents or is its own ancestor"]);
    let deep = format!("{{\"asset\":{{\"version\":\"2.0\",\"extras\":{}1{}}}}}", "[".repeat(100_000), "]".repeat(100_000));
    assert!(from_glb(deep.as_bytes(), "test.gltf").unwrap_err().to_string().contains("recursion"));
}
