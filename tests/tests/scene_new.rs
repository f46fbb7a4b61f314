//! A mesh becomes a scene, and the scenes of this repository are without fault, as a user runs the commands.

use crate::common::*;
use corf_raytrace::{Bvh, Ray};
use corf_scene::config::SceneConfig;
use corf_scene::trajectory;
use glam::{DVec2, Vec3};
use std::fs;
use std::path::{Path, PathBuf};

/// Scene files and meshes of the folder `scenes`, and data sets and plans beside them, which are none.
#[test]
fn every_scene_of_this_repository_is_valid_without_a_warning() {
    let mut scenes = 0;
    let mut files: Vec<PathBuf> = fs::read_dir(root().join("scenes")).unwrap().map(|entry| entry.unwrap().path()).collect();
    files.sort();
    for file in files {
        let ending = file.extension().unwrap().to_str().unwrap().to_owned();
        let is_scene = ending == "toml" && fs::read_to_string(&file).unwrap().contains("\n[transmitter]");
        if is_scene || ending == "glb" {
            let said = corf(&["scene", "validate", "--strict", text(&file)]);
            let said = String::from_utf8(said.stdout).unwrap() + &String::from_utf8_lossy(&said.stderr);
            assert!(said.ends_with("passed\n") && !said.contains("warning"), "{}:\n{said}", file.display());
            scenes += 1;
        }
    }
    assert!(scenes >= 5, "{scenes}");
}

/// An axis-aligned box whose faces look outwards, or, of a room, inwards; `without` leaves out faces of −x, +x, −y, +y, −z, +z.
fn add_box(obj: &mut String, name: &str, material: &str, min: [f64; 3], max: [f64; 3], inward: bool, without: &[usize]) {
    let first = obj.matches("\nv ").count() + 1;
    *obj += &format!("o {name}\nusemtl {material}\n");
    for i in 0..8 {
        let at = |axis: usize| if i >> axis & 1 == 1 { max[axis] } else { min[axis] };
        *obj += &format!("v {} {} {}\n", at(0), at(1), at(2));
    }
    let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
    for (k, mut quad) in quads.into_iter().enumerate() {
        if !without.contains(&k) {
            if inward {
                quad.reverse();
            }
            let corners = quad.map(|c| (first + c).to_string());
            *obj += &format!("f {}\n", corners.join(" "));
        }
    }
}

/// A room of 6 × 5 × 2.6 m with a table in the middle.
fn room_with_table(scale: f64, without: &[usize]) -> String {
    let mut obj = String::from("# a room\n");
    let scaled = |p: [f64; 3]| p.map(|v| v * scale);
    add_box(&mut obj, "room", "Wall_paint", [0.0; 3], scaled([6.0, 5.0, 2.6]), true, without);
    add_box(&mut obj, "table", "Material.001", scaled([2.4, 2.0, 0.0]), scaled([3.6, 3.0, 0.8]), false, &[]);
    obj
}

/// What a stub says is so: its loop goes round without touching anything, and encloses some floor.
fn assert_loop_is_free(file: &Path, least_area_m2: f64) {
    let config = SceneConfig::load(file).unwrap();
    let (scene, _) = config.load_scene().unwrap();
    let bvh = Bvh::build(&scene);
    let way = config.trajectory.as_ref().unwrap();
    let poses = trajectory::generate(way, 500).unwrap();
    let floor_m = config.trajectory.as_ref().unwrap().height_m - 1.5;
    for (pose, next) in poses.iter().zip(poses.iter().cycle().skip(1)) {
        let (here, there) = (pose.world_from_camera.translation, next.world_from_camera.translation);
        for height_m in [0.2, 0.5, 0.8, 1.1, 1.5] {
            let z = floor_m + height_m;
            let (a, b) = (here.with_z(z).as_vec3(), there.with_z(z).as_vec3());
            assert!(!bvh.occluded(&Ray::segment(a, b)), "something stands between {a} and {b}");
            for k in 0..36 {
                let side = DVec2::from_angle(k as f64 * std::f64::consts::TAU / 36.0).extend(0.0).as_vec3();
                assert!(!bvh.occluded(&Ray::segment(a, a + 0.15 * side)), "{a} is nearer than 15 cm to something");
            }
        }
        assert!(bvh.intersect(&Ray::new(here.as_vec3(), Vec3::NEG_Z)).is_some(), "no floor under {here}");
    }
    let corners: Vec<DVec2> = way.waypoints_m.iter().map(|p| DVec2::from_array(*p)).collect();
    let doubled: f64 = (0..corners.len()).map(|i| corners[i].perp_dot(corners[(i + 1) % corners.len()])).sum();
    assert!(0.5 * doubled.abs() > least_area_m2, "the loop encloses {} m²", 0.5 * doubled.abs());
    let tx = config.transmitter.position();
    assert!(poses.iter().all(|p| p.world_from_camera.translation.distance(tx) > 0.4), "{tx}");
}

/// A stub of the plain room in a folder: the mesh's and the scene file's paths, and what was said.
fn stub_of_room(folder: &Path) -> (PathBuf, PathBuf, String) {
    for name in ["room.obj", "room.mtl"] {
        fs::copy(root().join("scenes").join(name), folder.join(name)).unwrap();
    }
    let (mesh, scene) = (folder.join("room.obj"), folder.join("room.toml"));
    let said = corf_ok(&["scene", "new", text(&mesh)]);
    (mesh, scene, said)
}

#[test]
fn a_mesh_becomes_a_scene_with_a_free_loop_and_a_picture() {
    let folder = tempfile::tempdir().unwrap();
    let (mesh, scene, said) = stub_of_room(folder.path());
    assert!(said.contains(&format!("next: corf scene validate {}", scene.display())), "{said}");
    corf_ok(&["scene", "validate", "--strict", text(&scene)]);
    assert_loop_is_free(&scene, 3.0);
    let written = fs::read_to_string(&scene).unwrap();
    for material in ["plaster", "clay", "wood", "white", "cloth", "lamp"] {
        assert!(written.contains(&format!("[radio_materials.\"{material}\"]")), "{material}:\n{written}");
    }
    assert!(written.contains("file = \"room.obj\"") && written.matches("TO BE FILLED IN").count() == 1, "{written}");
    let picture = fs::read(folder.path().join("room-preview.png")).unwrap();
    let preview = corf_scene::io::decode_rgba(&picture, "preview").unwrap();
    let colours: std::collections::BTreeSet<[u8; 4]> = preview.pixels().iter().copied().collect();
    assert!(preview.width() > 1000 && colours.len() > 1000, "a picture of {} colours", colours.len());
    // What is there stays.
    corf_refuses(&["scene", "new", text(&mesh)], &["room.toml", "there already"]);
    assert_eq!(fs::read_to_string(&scene).unwrap(), written);
}

#[cfg(feature = "slow")]
#[test]
fn a_stub_becomes_a_data_set_and_a_run_by_the_commands_that_are_said() {
    let folder = tempfile::tempdir().unwrap();
    stub_of_room(folder.path());
    let [tiny, data, run] = ["room-tiny.toml", "data", "my run"].map(|name| folder.path().join(name));
    corf_ok(&["dataset", "generate", text(&tiny), "--keyframes", "16", "--out", text(&data), "--device", "cpu"]);
    // Keys and values that were meant otherwise.
    let wrong = |set: &str, meant: &str| {
        let arguments = ["reconstruct", text(&data), "--out", text(&run), "--device", "cpu", "--set", set];
        corf_refuses(&arguments, &["help: did you mean", meant]);
    };
    wrong("iterations_per_keyfram=3", "`iterations_per_keyframe`");
    wrong("depth.prio=none", "`prior`");
    wrong("depth.prior=non", "`none`");
    // A run ends with where it is and what to type next, and once that was typed with what it is worth.
    let reconstruct = ["reconstruct", text(&data), "--out", text(&run), "--method", "nearest", "--resume"];
    let said = corf_ok(&reconstruct);
    let next = format!("next: corf evaluate '{}'", run.display());
    assert!(said.contains(&format!("run:  {}\n", run.display())) && said.contains(&next), "{said}");
    let table = corf_ok(&["evaluate", text(&run)]);
    let said = corf_ok(&reconstruct);
    assert!(said.contains(table.trim_end()) && !said.contains("corf evaluate") && said.contains("next: corf view"), "{said}");
}

#[test]
fn a_mesh_exported_from_the_lobby_becomes_a_scene() {
    let folder = tempfile::tempdir().unwrap();
    let (mesh, scene) = (folder.path().join("hall.glb"), folder.path().join("files/hall.toml"));
    fs::create_dir(folder.path().join("files")).unwrap();
    corf_ok(&["scene", "build", "lobby", "--out", text(&mesh)]);
    corf_ok(&["scene", "new", text(&mesh), "--out", text(&scene)]);
    corf_ok(&["scene", "validate", "--strict", text(&scene)]);
    assert_loop_is_free(&scene, 30.0);
    // Its materials know themselves.
    let written = fs::read_to_string(&scene).unwrap();
    assert!(written.contains("file = \"../hall.glb\"") && written.contains("# \"Oak\": the mesh file itself says"), "{written}");
    assert!(!written.contains("[radio_materials."), "{written}");
}

#[test]
fn meshes_that_are_no_rooms_in_metres_are_refused_with_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let mesh = folder.path().join("mesh.obj");
    let refused = |obj: &str, more: &[&str], words: &[&str]| {
        fs::write(&mesh, obj).unwrap();
        corf_refuses(&[&["scene", "new", text(&mesh)], more].concat(), words);
        let left: Vec<PathBuf> = fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path()).collect();
        assert_eq!(left, std::slice::from_ref(&mesh), "something was written");
    };
    refused(&room_with_table(1000.0, &[]), &[], &["mesh.obj", "diagonal", "metres"]);
    refused(&room_with_table(0.1, &[]), &[], &["diagonal", "metres"]);
    // Centimetres, in which no loop is found: the height says what is wrong.
    refused(&room_with_table(100.0, &[]), &[], &["260.00 m are between floor and ceiling", "another unit", "--height"]);
    refused(&room_with_table(1.0, &[]), &["--height", "50"], &["--height"]);
    refused(&room_with_table(1.0, &[]), &["--height", "2.55"], &["between floor and ceiling"]);
    refused(&room_with_table(1.0, &[]), &["--out", "room.txt"], &["room.txt", ".toml"]);
    let mut walls = String::from("# walls\n");
    add_box(&mut walls, "walls", "wall", [0.0; 3], [6.0, 5.0, 2.6], true, &[4, 5]);
    refused(&walls, &[], &["no floor", "--up"]);
    // A sheet of floor is as high as nothing, and the sensor stands over it as anywhere.
    let mut sheet = String::from("# a floor\n");
    add_box(&mut sheet, "floor", "wood", [0.0; 3], [6.0, 5.0, 0.0], true, &[0, 1, 2, 3, 5]);
    let floor = folder.path().join("floor.obj");
    fs::write(&floor, sheet).unwrap();
    corf_ok(&["scene", "new", text(&floor)]);
    assert!(fs::read_to_string(folder.path().join("floor.toml")).unwrap().contains("\nheight_m = 1.5\n"));
    // Without a ceiling it is told; the table in the middle is gone round.
    let (open, scene) = (folder.path().join("open.obj"), folder.path().join("open.toml"));
    fs::write(&open, room_with_table(1.0, &[5])).unwrap();
    let said = corf(&["scene", "new", text(&open)]);
    let words = String::from_utf8_lossy(&said.stderr).into_owned();
    assert!(said.status.success() && words.contains("no ceiling") && words.contains("Material.001"), "{words}");
    assert_loop_is_free(&scene, 3.0);
    assert!(fs::read_to_string(&scene).unwrap().contains("GUESSED by \"wall\""));
}
