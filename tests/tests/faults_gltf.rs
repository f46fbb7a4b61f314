//! Models that were read in part without a word, drawn wrongly, or that name files which are not theirs.

use crate::common::{corf, corf_ok, corf_refuses, shared, text};
use corf_raytrace::{Bvh, LightSettings, LightTracer};
use corf_scene::{Pinhole, Rigid3, Scene, import};
use glam::{DVec3, Vec3};
use std::path::{Path, PathBuf};

fn fault(name: &str) -> Option<PathBuf> {
    shared(&format!("faults/{name}"))
}

/// Mean linear radiance that a narrow lens sees at (x, y) of the file's frame (y up), from z = −3 towards the wall at z = 0.5.
fn seen(scene: &Scene, x: f64, y: f64) -> [f64; 3] {
    let bvh = Bvh::build(scene);
    let tracer = LightTracer::new(scene, &bvh);
    let camera = Pinhole::from_horizontal_fov(4, 4, 2.0);
    // File (x, y, z) is world (x, −z, y).
    let pose = Rigid3::looking_at(DVec3::new(x, 3.0, y), DVec3::new(x, 0.0, y), DVec3::Z);
    let settings = LightSettings { samples_per_pixel: 1024, max_bounces: 3, ..LightSettings::default() };
    let frame = tracer.render(&camera, &pose, &settings, 0);
    let n = frame.radiance.pixels().len() as f64;
    std::array::from_fn(|c| frame.radiance.pixels().iter().map(|p| f64::from(p[c])).sum::<f64>() / n)
}

/// Smallest and largest corner of an object, in the file's frame (y up).
fn bounds_of(scene: &Scene, name: &str) -> [Vec3; 2] {
    let object = scene.objects.iter().position(|o| o.name == name).unwrap() as u32;
    let corners = (0..scene.triangles.len()).filter(|i| scene.triangles[*i].object == object).flat_map(|i| scene.corners(i));
    let file = corners.map(|p| Vec3::new(p.x, p.z, -p.y));
    file.fold([Vec3::INFINITY, Vec3::NEG_INFINITY], |[low, high], p| [low.min(p), high.max(p)])
}

fn near(a: Vec3, b: [f32; 3]) -> bool {
    (a - Vec3::from(b)).length() < 1e-4
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn dark_glass_of_a_fifth_lets_four_fifths_through() {
    let Some(path) = fault("gltf/blend.gltf") else { return };
    let scene = import::load(path).unwrap();
    // The white wall above the sheets; behind a sheet it is a little darker, in the sheet's own shadow.
    let bare = seen(&scene, 0.49, 2.4)[1];
    let smoked = seen(&scene, -0.83, 1.5);
    // α = 0.2 of black over white: 0.8 of it. By tinted transmission it was 0.
    for c in smoked {
        assert!((0.70..0.86).contains(&(c / bare)), "{smoked:?} of {bare}");
    }
    // Over: 0.25 · (0.05, 0.1, 0.6) + 0.75 · white.
    let blue = seen(&scene, 0.93, 1.5);
    assert!(blue[2] > 1.1 * blue[1] && blue[1] > 1.005 * blue[0] && blue[0] > 0.6 * bare, "{blue:?} of {bare}");
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn vertex_colours_morphs_and_instances_are_where_they_belong() {
    let Some(path) = fault("gltf/vertex-colour-morph-instancing.gltf") else { return };
    let scene = import::load(&path).unwrap();
    // The five panels are one red: by factor, by bytes, by floats, displaced, twice.
    let panels = [(-0.826, 1.5), (0.054, 1.5), (0.934, 1.5), (1.814, 2.4)].map(|(x, y)| seen(&scene, x, y));
    for (i, p) in panels.iter().enumerate() {
        // 0.8 against 0.05 of base colour, light reflected by walls and the sheen of index 1.5 added to both.
        assert!(p[0] > 4.0 * p[1] && (p[1] - p[2]).abs() < 0.2 * p[1], "panel {i}: {p:?}");
    }
    let [low, high] = bounds_of(&scene, "morph");
    assert!(near(low, [1.44, 2.0, 0.0]) && near(high, [2.188, 2.8, 0.0]), "{low} {high}");
    assert_eq!(scene.objects.iter().filter(|o| o.name.starts_with("inst (instance ")).count(), 2);
    let info = corf_ok(&["scene", "info", "--json", text(&path)]);
    let info: serde_json::Value = serde_json::from_str(&info).unwrap();
    // Six walls and six panels of two triangles.
    assert_eq!(info["scene"]["triangles"], 24);
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn other_encodings_give_the_panel_that_is_meant() {
    for name in ["gltf/d-quant-req.gltf", "gltf/f-draco-opt.gltf", "gltf/e-specgloss.gltf"] {
        let Some(path) = fault(name) else { return };
        let scene = import::load(&path).unwrap();
        let [low, high] = bounds_of(&scene, "q");
        assert!(
            (low - Vec3::new(0.56, 1.1, 0.0)).length() < 1e-3 && (high - Vec3::new(1.308, 1.9, 0.0)).length() < 1e-3,
            "{low}"
        );
        let material = &scene.materials[scene.triangles.last().unwrap().material as usize].light;
        assert_eq!((material.base_color, material.metallic), ([0.8, 0.05, 0.05], 0.0), "{name}");
        assert!((material.ior - 1.5).abs() < 1e-5 && material.roughness == 1.0, "{name}");
        corf_ok(&["scene", "validate", text(&path)]);
    }
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn hidden_nodes_are_left_out_and_told() {
    let Some(path) = fault("gltf/h-hidden.gltf") else { return };
    let scene = import::load(&path).unwrap();
    assert!(scene.objects.iter().all(|o| o.name != "hid") && scene.triangles.len() == 12);
    for command in ["info", "validate"] {
        assert_eq!(corf_ok(&["scene", command, text(&path)]).matches("KHR_node_visibility").count(), 1);
    }
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn what_has_no_fallback_is_refused_by_name() {
    let Some(path) = fault("gltf/c-webp-req.gltf") else { return };
    for command in ["info", "validate"] {
        corf_refuses(&["scene", command, text(&path)], &["EXT_texture_webp", "textures[0]", "PNG or JPEG"]);
    }
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn a_wild_quaternion_turns_and_does_not_scale() {
    let Some(path) = fault("fuzz/quat.gltf") else { return };
    let output = corf_ok(&["scene", "info", "--json", text(&path)]);
    let info: serde_json::Value = serde_json::from_str(&output).unwrap();
    let notes = info["import"].as_array().unwrap();
    assert_eq!(notes.iter().filter(|n| n["what"].as_str().unwrap().contains("no unit quaternion")).count(), 1);
    // Half a turn about x at a fifth of the size: (1 + x/5, 0.5 − y/5, −1 − z/5), y up to 5 and z from −5 to 6.
    let scene = import::load(&path).unwrap();
    let [low, high] = bounds_of(&scene, "strip");
    assert!(near(low, [1.0, -0.5, -2.2]) && near(high, [2.2, 0.5, 0.0]), "{low} {high}");
}

/// A floor and a lamp of 8 m × 8 m: the mesh with its buffer beside it, and a scene file. `change` edits the mesh's JSON text.
fn small_model(folder: &Path, change: impl Fn(String) -> String) -> (PathBuf, PathBuf) {
    let gltf = r#"{ "asset": { "version": "2.0" }, "scenes": [{ "nodes": [0, 1] }],
        "nodes": [{ "name": "floor", "mesh": 0 }, { "name": "lamp", "translation": [0, 3, 0], "mesh": 1 }],
        "meshes": [{ "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1, "material": 0 }] },
                   { "primitives": [{ "attributes": { "POSITION": 0 }, "indices": 1, "material": 1 }] }],
        "materials": [{ "name": "stone", "extensions": { "KHR_materials_clearcoat": { "clearcoatFactor": 1 } },
                        "extras": { "corf_radio": { "itu": "concrete", "thickness_m": 0.2, "scattering_coefficient": 0.4 } } },
                      { "name": "glow", "emissiveFactor": [1, 1, 1], "doubleSided": true,
                        "extras": { "corf_radio": { "itu": "concrete", "thickness_m": 0.2, "scattering_coefficient": 0.4 } } }],
        "accessors": [{ "bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3", "min": [-4, 0, -4], "max": [4, 0, 4] },
                      { "bufferView": 1, "componentType": 5121, "count": 6, "type": "SCALAR" }],
        "bufferViews": [{ "buffer": 0, "byteLength": 48 }, { "buffer": 0, "byteOffset": 48, "byteLength": 6 }],
        "buffers": [{ "byteLength": 54, "uri": "room.bin" }] }"#;
    let corners: [[f32; 3]; 4] = [[-4.0, 0.0, -4.0], [-4.0, 0.0, 4.0], [4.0, 0.0, 4.0], [4.0, 0.0, -4.0]];
    let mut bin: Vec<u8> = corners.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
    bin.extend([0u8, 1, 2, 0, 2, 3]);
    std::fs::write(folder.join("room.bin"), bin).unwrap();
    let mesh = folder.join("room.gltf");
    std::fs::write(&mesh, change(gltf.to_string())).unwrap();
    let scene = folder.join("room.toml");
    std::fs::write(
        &scene,
        "[scene]\nfile = \"room.gltf\"\n[transmitter]\nposition_m = [1, 1, 2]\n[receiver]\nrows = 1\ncols = 1\n\
         [trajectory]\nwaypoints_m = [[-1, -1], [-1, 1], [1, 1]]\nheight_m = 1.5\n",
    )
    .unwrap();
    (mesh, scene)
}

#[test]
fn generate_tells_what_it_does_not_read() {
    let folder = tempfile::tempdir().unwrap();
    let (mesh, scene) = small_model(folder.path(), |text| text);
    let config = folder.path().join("data.toml");
    let body = format!(
        "name = \"small\"\nscene = {:?}\nkeyframes = 2\nseed = 1\n[optical]\nwidth = 16\nheight = 12\nsamples_per_pixel = 1\n\
         max_bounces = 1\n[rf]\nwidth = 48\nheight = 32\npatch_size_m = 1.0\nphotons = 1000\n",
        scene.display().to_string()
    );
    std::fs::write(&config, body).unwrap();
    let output = corf(&["dataset", "generate", text(&config), "--out", text(&folder.path().join("out"))]);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    assert_eq!(stderr.matches("KHR_materials_clearcoat is not read").count(), 1, "{stderr}");
    for file in [&mesh, &scene] {
        for command in ["info", "validate"] {
            let reported = corf_ok(&["scene", command, text(file)]);
            assert_eq!(reported.matches("KHR_materials_clearcoat is not read").count(), 1, "{reported}");
        }
    }
}

#[test]
fn a_model_that_is_z_up_is_turned_by_the_scene_file() {
    let folder = tempfile::tempdir().unwrap();
    let (_, scene) = small_model(folder.path(), |text| text);
    let bounds = |scene: &Path| {
        let info: serde_json::Value = serde_json::from_str(&corf_ok(&["scene", "info", "--json", text(scene)])).unwrap();
        info["scene"]["bounds_m"][1].clone()
    };
    assert_eq!(bounds(&scene), serde_json::json!([4.0, 4.0, 3.0]));
    let body = std::fs::read_to_string(&scene).unwrap();
    std::fs::write(&scene, body.replace("[scene]\n", "[scene]\nup = \"z\"\n")).unwrap();
    assert_eq!(bounds(&scene), serde_json::json!([4.0, 3.0, 4.0]));
}

#[test]
fn files_outside_of_the_folder_need_a_word_of_the_user() {
    let folder = tempfile::tempdir().unwrap();
    let inner = folder.path().join("model");
    std::fs::create_dir(&inner).unwrap();
    let (mesh, scene) = small_model(&inner, |text| text.replace("room.bin", "../shared%20parts.bin"));
    std::fs::rename(inner.join("room.bin"), folder.path().join("shared parts.bin")).unwrap();
    for file in [&mesh, &scene] {
        for command in ["info", "validate"] {
            corf_refuses(
                &["scene", command, text(file)],
                &["buffers[0]", "../shared parts.bin", "allow_outside", "--allow-outside"],
            );
            corf_ok(&["scene", command, text(file), "--allow-outside"]);
        }
    }
    let body = std::fs::read_to_string(&scene).unwrap();
    std::fs::write(&scene, body.replace("[scene]\n", "[scene]\nallow_outside = true\n")).unwrap();
    corf_ok(&["scene", "info", text(&scene)]);
    corf_ok(&["paths", text(&scene), "--rx=-1,1,1", "--depth", "1"]);
}

#[cfg(unix)]
#[test]
fn data_sets_keep_to_their_folder() {
    use std::os::unix::fs::symlink;
    let folder = tempfile::tempdir().unwrap();
    let dataset = folder.path().join("dataset");
    crate::common::copy_folder(crate::common::tiny_dataset(), &dataset);
    corf_ok(&["dataset", "validate", text(&dataset)]);
    let spectrum = dataset.join("rf/spectra/00002.exr");
    let outside = folder.path().join("other.exr");
    let fails = |word: &str| {
        let output = corf(&["dataset", "validate", text(&dataset)]);
        let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
        assert!(output.status.code() != Some(0) && said.contains(word) && said.contains("00002"), "{said}");
        corf_refuses(&["reconstruct", text(&dataset), "--out", text(&folder.path().join(word))], &[word, "00002"]);
    };
    std::fs::rename(&spectrum, &outside).unwrap();
    symlink(&outside, &spectrum).unwrap();
    fails("symbolic link");
    std::fs::remove_file(&spectrum).unwrap();
    assert!(std::process::Command::new("mkfifo").arg(&spectrum).status().unwrap().success());
    fails("pipe");
    std::fs::remove_file(&spectrum).unwrap();
    symlink("00003.exr", &spectrum).unwrap();
    // A link within the data set is its own file, though not the recorded one.
    let output = corf(&["dataset", "validate", text(&dataset)]);
    assert!(String::from_utf8_lossy(&output.stdout).contains("SHA-256"));
    // A listed name that leads out.
    std::fs::remove_file(&spectrum).unwrap();
    std::fs::rename(&outside, &spectrum).unwrap();
    let json = dataset.join("dataset.json");
    let body = std::fs::read_to_string(&json).unwrap();
    std::fs::write(&json, body.replace("\"rf/spectra/00002.exr\"", "\"../rf/00002.exr\"")).unwrap();
    let output = corf(&["dataset", "validate", text(&dataset)]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() != Some(0) && said.contains("leads out"), "{said}");
}
