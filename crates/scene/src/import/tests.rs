//! Hand-built files: every number here is known.

mod contained_files;
mod gltf_features;
mod skins;

use super::{ImportOptions, from_glb, load_with_report, load_with_up};
use crate::config::UpAxis;
use crate::model::{Permittivity, PunctualKind, Wrap};
use crate::{Raster, Rng, Scene, io};
use glam::{Vec2, Vec3};
use serde_json::{Value, json};

/// A GLB container around JSON and bytes.
fn glb(json: &Value, bin: &[u8]) -> Vec<u8> {
    let pad = |mut v: Vec<u8>, with: u8| {
        v.resize(v.len().next_multiple_of(4), with);
        v
    };
    let (json, bin) = (pad(json.to_string().into_bytes(), b' '), pad(bin.to_vec(), 0));
    let mut out = Vec::new();
    out.extend(b"glTF");
    out.extend(2u32.to_le_bytes());
    out.extend((28 + json.len() as u32 + bin.len() as u32).to_le_bytes());
    out.extend((json.len() as u32).to_le_bytes());
    out.extend(b"JSON");
    out.extend(json);
    out.extend((bin.len() as u32).to_le_bytes());
    out.extend(b"BIN\0");
    out.extend(bin);
    out
}

/// A right triangle in the file's x–y plane, facing +z, with uvs and u16 indices, and a 2×1 PNG in the last view.
fn parts() -> (Value, Vec<u8>) {
    let mut bin = Vec::new();
    for v in [[0.0_f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] {
        bin.extend(v.iter().flat_map(|x| x.to_le_bytes()));
    }
    for v in [[0.0_f32, 1.0], [1.0, 1.0], [0.0, 0.0]] {
        bin.extend(v.iter().flat_map(|x| x.to_le_bytes()));
    }
    for i in [0u16, 1, 2, 0, 0, 1] {
        bin.extend(i.to_le_bytes());
    }
    let png = io::encode_png(&Raster::from_vec(2, 1, vec![[255, 0, 0], [0, 0, 255]])).unwrap();
    let at = bin.len();
    bin.extend(&png);
    let json = json!({
        "asset": { "version": "2.0" },
        "scene": 0,
        "scenes": [{ "nodes": [0] }],
        "extensionsUsed": ["KHR_lights_punctual", "KHR_materials_emissive_strength", "KHR_texture_transform",
                           "KHR_materials_transmission", "KHR_materials_ior"],
        "extensions": { "KHR_lights_punctual": { "lights": [
            { "type": "spot", "color": [1.0, 0.5, 0.25], "intensity": 8.0, "spot": { "innerConeAngle": 0.1, "outerConeAngle": 0.4 } }
        ] } },
        "nodes": [
            { "name": "Room", "translation": [1.0, 2.0, 3.0], "children": [1, 2] },
            { "name": "Wall", "mesh": 0, "scale": [2.0, 1.0, 1.0] },
            { "name": "Lamp", "translation": [0.0, 0.5, 0.0], "extensions": { "KHR_lights_punctual": { "light": 0 } } }
        ],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0, "TEXCOORD_0": 1 }, "indices": 2, "material": 0 }] }],
        "materials": [{
            "name": "Paint",
            "pbrMetallicRoughness": {
                "baseColorFactor": [0.5, 0.25, 0.125, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.75,
                "baseColorTexture": { "index": 0, "extensions": { "KHR_texture_transform": {
                    "offset": [0.0, 1.0], "rotation": std::f32::consts::FRAC_PI_2, "scale": [0.5, 0.5] } } }
            },
            "emissiveFactor": [1.0, 0.5, 0.0],
            "extensions": { "KHR_materials_emissive_strength": { "emissiveStrength": 4.0 },
                            "KHR_materials_transmission": { "transmissionFactor": 0.9 },
                            "KHR_materials_ior": { "ior": 1.45 } },
            "extras": { "artist": "x", "corf_radio": { "itu": "plasterboard", "thickness_m": 0.02, "scattering_coefficient": 0.4,
                        "scattering_pattern": "directive", "alpha_r": 5 } }
        }],
        "textures": [{ "source": 0, "sampler": 0 }],
        "samplers": [{ "wrapS": 33071, "wrapT": 33648 }],
        "images": [{ "bufferView": 3, "mimeType": "image/png" }],
        "accessors": [
            { "bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "min": [0.0, 0.0, 0.0], "max": [1.0, 1.0, 0.0] },
            { "bufferView": 1, "componentType": 5126, "count": 3, "type": "VEC2" },
            { "bufferView": 2, "componentType": 5123, "count": 6, "type": "SCALAR" }
        ],
        "bufferViews": [
            { "buffer": 0, "byteOffset": 0, "byteLength": 36 },
            { "buffer": 0, "byteOffset": 36, "byteLength": 24 },
            { "buffer": 0, "byteOffset": 60, "byteLength": 12 },
            { "buffer": 0, "byteOffset": at, "byteLength": png.len() }
        ],
        "buffers": [{ "byteLength": bin.len() }]
    });
    (json, bin)
}

fn scene() -> Scene {
    let (json, bin) = parts();
    from_glb(&glb(&json, &bin), "test.glb").unwrap()
}

fn fails(json: &Value, bin: &[u8], expected: &str) {
    let message = from_glb(&glb(json, bin), "test.glb").unwrap_err().to_string();
    assert!(message.contains("test.glb") && message.contains(expected), "{message}");
}

#[test]
fn node_transforms_compose_and_y_up_becomes_z_up() {
    let s = scene();
    // File (x, y, z) = (1 + 2u, 2 + v, 3) → world (x, −3, y).
    assert_eq!(s.corners(0), [Vec3::new(1.0, -3.0, 2.0), Vec3::new(3.0, -3.0, 2.0), Vec3::new(1.0, -3.0, 3.0)]);
    // Facing +z in the file is facing −y in the world; normals were computed.
    assert!(s.normals.iter().all(|n| (*n + Vec3::Y).length() < 1e-6));
    assert_eq!((s.objects.len(), s.objects[0].name.as_str(), s.name.as_str()), (1, "Wall", "test"));
    // The second triangle of the index list has no area.
    assert_eq!(s.triangles.len(), 1);
}

#[test]
fn materials_textures_and_lights_arrive() {
    let s = scene();
    let m = &s.materials[0];
    assert_eq!((m.name.as_str(), m.light.base_color, m.light.roughness), ("Paint", [0.5, 0.25, 0.125], 0.75));
    assert_eq!(m.light.emissive, [4.0, 2.0, 0.0]);
    assert_eq!((m.light.transmission, m.light.ior, m.light.double_sided), (0.9, 1.45, false));
    let radio = m.radio.as_ref().unwrap();
    assert_eq!((radio.id.as_str(), &radio.permittivity), ("plasterboard", &Permittivity::Itu("plasterboard".into())));
    let t = m.light.base_color_texture.unwrap();
    assert_eq!(s.textures[0].texels.pixels(), &[[255, 0, 0, 255], [0, 0, 255, 255]]);
    assert_eq!(s.textures[0].wrap, [Wrap::Clamp, Wrap::Mirror]);
    // The extension's own example: the unit square becomes the lower left quadrant (v down), turned.
    for (uv, expected) in [([0.0, 0.0], [0.0, 1.0]), ([1.0, 0.0], [0.0, 0.5]), ([0.0, 1.0], [0.5, 1.0]), ([1.0, 1.0], [0.5, 0.5])]
    {
        let got = t.uv_from_uv.transform_point2(Vec2::from_array(uv));
        assert!((got - Vec2::from_array(expected)).length() < 1e-6, "{uv:?} {got}");
    }
    let light = &s.lights[0];
    assert_eq!(light.kind, PunctualKind::Spot { inner_rad: 0.1, outer_rad: 0.4 });
    assert_eq!((light.position, light.intensity), (Vec3::new(1.0, -3.0, 2.5), [8.0, 4.0, 2.0]));
    // −z of the file is +y of the world.
    assert!((light.direction - Vec3::Y).length() < 1e-6);
}

#[test]
fn a_mirrored_node_keeps_its_outside_outside() {
    let (mut json, bin) = parts();
    json["nodes"][1]["scale"] = json!([-2.0, 1.0, 1.0]);
    let s = from_glb(&glb(&json, &bin), "test.glb").unwrap();
    let [a, b, c] = s.corners(0);
    let face = (b - a).cross(c - a).normalize();
    // Mirroring x leaves the +z side of the file (world −y) the outside.
    assert!((face + Vec3::Y).length() < 1e-6 && (s.normals[0] + Vec3::Y).length() < 1e-6, "{face}");
}

#[test]
fn strips_fans_and_byte_indices_are_triangles() {
    let (mut json, mut bin) = parts();
    // Four corners of a square as a strip, normalised unsigned bytes as positions' stand-in are not allowed: use indices of bytes.
    let at = bin.len();
    bin.extend([0u8, 1, 2, 0, 1]);
    json["buffers"][0]["byteLength"] = json!(bin.len());
    json["bufferViews"].as_array_mut().unwrap().push(json!({ "buffer": 0, "byteOffset": at, "byteLength": 5 }));
    json["accessors"]
        .as_array_mut()
        .unwrap()
        .push(json!({ "bufferView": 4, "componentType": 5121, "count": 4, "type": "SCALAR" }));
    json["meshes"][0]["primitives"][0]["indices"] = json!(3);
    for (mode, expected) in [(5, [[0, 1, 2], [2, 1, 0]]), (6, [[0, 1, 2], [0, 2, 0]])] {
        json["meshes"][0]["primitives"][0]["mode"] = json!(mode);
        let s = from_glb(&glb(&json, &bin), "test.glb").unwrap();
        // The fan's second triangle repeats a vertex: it has no area.
        assert_eq!(s.triangles.len(), if mode == 5 { 2 } else { 1 });
        for (i, t) in expected.iter().take(s.triangles.len()).enumerate() {
            let corners = [Vec3::new(1.0, -3.0, 2.0), Vec3::new(3.0, -3.0, 2.0), Vec3::new(1.0, -3.0, 3.0)];
            let set = |list: [Vec3; 3]| (0..3).map(|k| [list[k], list[(k + 1) % 3], list[(k + 2) % 3]]).collect::<Vec<_>>();
            assert!(set(s.corners(i)).contains(&t.map(|v: usize| corners[v])), "{mode} {i}");
        }
    }
}

#[test]
fn normalised_and_sparse_accessors_decode() {
    let (mut json, mut bin) = parts();
    // Texture coordinates as normalised u16, the last one replaced by a sparse value.
    let at = bin.len();
    bin.extend([0u16, 65535, 65535, 65535, 0, 0].iter().flat_map(|v| v.to_le_bytes()));
    bin.extend([2u8, 0]);
    bin.extend([13107u16, 0].iter().flat_map(|v| v.to_le_bytes()));
    json["buffers"][0]["byteLength"] = json!(bin.len());
    for (offset, length) in [(at, 12), (at + 12, 2), (at + 14, 4)] {
        json["bufferViews"].as_array_mut().unwrap().push(json!({ "buffer": 0, "byteOffset": offset, "byteLength": length }));
    }
    json["accessors"][1] = json!({ "bufferView": 4, "componentType": 5123, "normalized": true, "count": 3, "type": "VEC2",
        "sparse": { "count": 1, "indices": { "bufferView": 5, "componentType": 5121 }, "values": { "bufferView": 6 } } });
    let s = from_glb(&glb(&json, &bin), "test.glb").unwrap();
    assert_eq!(s.uvs, vec![[0.0, 1.0], [1.0, 1.0], [13107.0 / 65535.0, 0.0]]);
}

#[test]
fn a_file_cut_anywhere_is_an_error_and_never_a_panic() {
    let (json, bin) = parts();
    let whole = glb(&json, &bin);
    for cut in 0..whole.len() {
        assert!(from_glb(&whole[..cut], "test.glb").is_err(), "{cut} of {} bytes", whole.len());
    }
}

#[test]
fn damaged_bytes_never_panic() {
    let (json, bin) = parts();
    let whole = glb(&json, &bin);
    for round in 0..20_000 {
        let mut rng = Rng::keyed(5, 0, round);
        let mut bytes = whole.clone();
        for _ in 0..=rng.below(4) {
            let at = rng.below(bytes.len());
            // Digits are what steers offsets and counts; other bytes mostly break the JSON.
            bytes[at] = if bytes[at].is_ascii_digit() { b'0' + rng.below(10) as u8 } else { rng.below(256) as u8 };
        }
        // Whether it is an error depends on what was hit; reaching the next line is the test.
        let _ = from_glb(&bytes, "test.glb");
    }
}

#[test]
fn faults_inside_the_file_are_named() {
    let (json, bin) = parts();
    let changed = |path: &str, value: Value| {
        let mut json = json.clone();
        *json.pointer_mut(path).unwrap() = value;
        json
    };
    fails(&changed("/bufferViews/0/byteLength", json!(20)), &bin, "accessor 0");
    fails(&changed("/accessors/0/count", json!(4)), &bin, "accessor 0");
    fails(&changed("/accessors/2/componentType", json!(5126)), &bin, "indices are no unsigned integers");
    fails(&changed("/accessors/0/type", json!("VEC2")), &bin, "components");
    fails(&changed("/nodes/2", json!({ "children": [0] })), &bin, "two parents or is its own ancestor");
    fails(&changed("/images/0", json!({ "uri": "missing.png" })), &bin, "missing.png");
    fails(&changed("/images/0", json!({})), &bin, "images[0]");
    fails(&changed("/images/0", json!({ "uri": "data:image/png;base64,AAAA" })), &bin, "PNG or JPEG");
    fails(&changed("/buffers/0/byteLength", json!(100_000)), &bin, "buffers[0]");
    fails(&changed("/materials/0/extras/corf_radio/itu", json!("plasterbord")), &bin, "did you mean `plasterboard`");
    fails(&changed("/materials/0/extras/corf_radio", json!({ "itu": "wood" })), &bin, "thickness_m");
    fails(&changed("/nodes/1/mesh", json!(7)), &bin, "not readable as glTF");
    fails(&changed("/meshes/0/primitives/0/attributes/POSITION", json!(9)), &bin, "accessor 9 of 3");
    let mut bad = bin.clone();
    bad[12..16].copy_from_slice(&f32::NAN.to_le_bytes());
    fails(&json, &bad, "position 1 is not finite");
    let mut bad = bin.clone();
    bad[62..64].copy_from_slice(&9u16.to_le_bytes());
    fails(&json, &bad, "uses vertices [0, 9, 2] of 3");
    assert!(from_glb(b"not a glb at all", "test.glb").is_err());
}

#[test]
fn external_files_and_percent_escapes_resolve() {
    let dir = tempfile::tempdir().unwrap();
    let (mut json, bin) = parts();
    std::fs::write(dir.path().join("my data.bin"), &bin).unwrap();
    json["buffers"][0]["uri"] = json!("my%20data.bin");
    let path = dir.path().join("room.gltf");
    std::fs::write(&path, json.to_string()).unwrap();
    let (scene, report) = load_with_report(&path, &ImportOptions::default()).unwrap();
    assert_eq!((scene.triangles.len(), report.degenerate_triangles, report.computed_normals), (1, 1, 3));
    std::fs::remove_file(dir.path().join("my data.bin")).unwrap();
    assert!(load_with_up(&path, None).unwrap_err().to_string().contains("my data.bin"));
}
