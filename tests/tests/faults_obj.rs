//! OBJ, MTL and image files that other programs wrote, or that are no such files: the right value, or a message that says where.

use crate::common::{corf_ok, corf_refuses, shared, text};
use corf_raytrace::bvh::Bvh;
use corf_raytrace::light::{LightFrame, LightSettings, LightTracer};
use corf_scene::config::SceneConfig;
use corf_scene::model::AlphaMode;
use corf_scene::{Pinhole, Rigid3, Scene, import, io};
use glam::DVec3;
use std::path::Path;

/// The scene of a scene file, as its commands see it.
fn load(path: &Path) -> Scene {
    let config = SceneConfig::load(path).unwrap();
    let (scene, _) = config.load_scene().unwrap();
    config.check_radio(&scene).unwrap();
    scene
}

/// A close view of the panel whose middle is (x, 0, 1.5), with light of two bounces.
fn panel(scene: &Scene, x: f64) -> LightFrame {
    view(scene, x, 2)
}

/// As [`panel`], of what shines by itself alone.
fn shine(scene: &Scene, x: f64) -> LightFrame {
    view(scene, x, 0)
}

fn view(scene: &Scene, x: f64, max_bounces: u32) -> LightFrame {
    let bvh = Bvh::build(scene);
    let camera = Pinhole::from_horizontal_fov(8, 8, 8.0);
    let pose = Rigid3::looking_at(DVec3::new(x, 3.0, 1.5), DVec3::new(x, 0.0, 1.5), DVec3::Z);
    let settings = LightSettings { samples_per_pixel: 256, max_bounces, ..LightSettings::default() };
    LightTracer::new(scene, &bvh).render(&camera, &pose, &settings, 0)
}

fn mean(frame: &LightFrame) -> [f64; 3] {
    let n = frame.radiance.pixels().len() as f64;
    std::array::from_fn(|c| frame.radiance.pixels().iter().map(|p| f64::from(p[c])).sum::<f64>() / n)
}

/// The scene without the triangles of one material.
fn without(scene: &Scene, material: &str) -> Scene {
    let mut bare = scene.clone();
    bare.triangles.retain(|t| scene.materials[t.material as usize].name != material);
    assert_eq!(bare.triangles.len() + 2, scene.triangles.len());
    bare
}

fn near(a: [f64; 3], b: [f64; 3], tolerance: f64) {
    assert!((0..3).all(|c| (a[c] - b[c]).abs() <= tolerance * b[c].max(0.02)), "{a:?} where {b:?} is due");
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn transparency_as_tr_and_as_d_are_one_and_cover_what_is_behind() {
    let Some(path) = shared("faults/obj/tr.toml") else { return };
    let scene = load(&path);
    let of = |name: &str| &scene.materials.iter().find(|m| m.name == name).unwrap().light;
    let (tr, d) = (of("tr1"), of("d03"));
    assert!((tr.alpha - 0.3).abs() < 1e-6 && (d.alpha - 0.3).abs() < 1e-6);
    assert_eq!((tr.alpha_mode, d.alpha_mode, of("red").alpha_mode), (AlphaMode::Blend, AlphaMode::Blend, AlphaMode::Opaque));
    // Of walls that shine by themselves seven tenths are seen through either panel, in their own colour, and nothing through the opaque one.
    let mut shining = scene.clone();
    let glow = [0.2, 0.5, 0.1];
    shining.materials.iter_mut().filter(|m| m.name == "wall").for_each(|m| m.light.emissive = glow);
    for (x, share) in [(0.054, 0.7), (0.934, 0.7), (-0.826, 0.0)] {
        near(mean(&shine(&shining, x)), glow.map(|g| share * f64::from(g)), 0.03);
    }
    // A mirror of 0.9, and a panel that shines in its texture's red, 200 and 40 of 255 in sRGB.
    let spec = of("spec");
    assert_eq!((spec.base_color, spec.metallic, spec.roughness), ([0.9; 3], 1.0, 0.0));
    assert!(panel(&scene, 1.814).albedo.pixels().iter().all(|a| (a[0] - 0.9).abs() < 0.02));
    let lamp = shine(&scene, 2.694);
    assert!(lamp.radiance.pixels().iter().all(|p| (p[0] - 0.5776).abs() < 0.002 && (p[1] - 0.0212).abs() < 0.001));
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn a_map_of_holes_shows_the_wall_behind() {
    let Some(path) = shared("faults/obj/mapd.toml") else { return };
    let scene = load(&path);
    let (seen, bare) = (panel(&scene, 0.054), panel(&without(&scene, "mapd"), 0.054));
    near(mean(&seen), mean(&bare), 1e-3);
    assert!(seen.depth_m.pixels().iter().all(|d| (d - 3.5).abs() < 1e-3), "the wall is 0.5 m behind the panel");
    // Radio meets the whole panel: its triangles are there.
    let mapd = scene.materials.iter().position(|m| m.name == "mapd").unwrap() as u32;
    assert_eq!(scene.triangles.iter().filter(|t| t.material == mapd).count(), 2);
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn continued_lines_options_of_maps_and_missing_libraries() {
    let faces = |scene: &Scene| (scene.triangles.len(), scene.bounds().unwrap().max.to_array());
    if let Some(path) = shared("faults/obj/cont.toml") {
        let scene = load(&path);
        assert_eq!(faces(&scene), (14, [7.0, 7.0, 3.0]));
        let red = scene.materials.iter().position(|m| m.name == "red").unwrap() as u32;
        let corners: Vec<_> = (0..14).filter(|t| scene.triangles[*t].material == red).flat_map(|t| scene.corners(t)).collect();
        assert!(corners.len() == 6 && corners.iter().all(|c| c.y == 0.0 && (0.55..1.31).contains(&c.x)));
    }
    if let Some(path) = shared("faults/obj/topt.toml") {
        let scene = load(&path);
        let map = scene.materials.iter().find(|m| m.name == "texopt").unwrap().light.base_color_texture.unwrap();
        // Coordinates twice as dense, counted from the bottom.
        assert_eq!(map.uv_from_uv.transform_point2(glam::Vec2::new(0.25, 1.0)), glam::Vec2::new(0.5, 1.0));
        assert_eq!(map.uv_from_uv.transform_point2(glam::Vec2::new(0.25, 0.5)), glam::Vec2::new(0.5, 0.0));
        let frame = panel(&scene, -0.826);
        let [r, g, _] = mean(&frame);
        assert!(r > 5.0 * g, "{r} {g}");
    }
    if let Some(path) = shared("faults/obj/nomtl.toml") {
        let scene = load(&path);
        assert_eq!(faces(&scene), (14, [7.0, 7.0, 3.0]));
        let names: Vec<&str> = scene.materials.iter().map(|m| m.name.as_str()).collect();
        assert_eq!(names, ["wall", "light", "concrete wall"]);
        let info = corf_ok(&["scene", "info", text(&path)]);
        assert!(info.contains("no library defines material \"concrete wall\""), "{info}");
    }
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn damaged_files_are_refused_and_odd_ones_read() {
    if let Some(path) = shared("faults/fuzz/kd.obj") {
        assert_eq!(import::load(path).unwrap().materials[0].light.base_color, [0.5; 3]);
    }
    if let Some(path) = shared("faults/fuzz/mixed.obj") {
        let scene = import::load(path).unwrap();
        assert_eq!((scene.triangles.len(), scene.objects.len()), (2, 1));
        assert!(scene.normals.iter().all(|n| *n == glam::Vec3::Z));
    }
    if let Some(path) = shared("faults/fuzz/pal.obj") {
        corf_refuses(&["scene", "info", text(&path)], &["pal.mtl:2", "palette.png", "palette has 4 bytes"]);
    }
    if let Some(path) = shared("faults/fuzz/bomb.exr") {
        let message = io::read_exr_u32(&path).unwrap_err().to_string();
        assert!(message.contains("bomb.exr") && message.contains("64 x 268435457 pixels (68.7 GB"), "{message}");
    }
    // As a user meets it: a scene whose texture cannot be what it says.
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.obj");
    std::fs::write(&path, "mtllib room.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n").unwrap();
    std::fs::write(folder.path().join("room.mtl"), "newmtl a\nKd .2 .3\n").unwrap();
    corf_refuses(&["scene", "info", text(&path)], &["room.mtl:2", "`Kd` with 2 numbers", "help"]);
    std::fs::write(&path, "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n").unwrap();
    corf_refuses(&["scene", "info", text(&path)], &["room.obj:4", "vertex 9, and there are 3"]);
}
