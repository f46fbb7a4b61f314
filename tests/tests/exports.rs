//! Data sets in the layouts of other programs, and what refuses to be written in them.

use crate::common::{corf_ok, corf_refuses, room_with_pillar, text, tiny_dataset};
use corf_scene::Raster;
use corf_scene::dataset::Dataset;
use serde_json::Value;
use std::fs;
use std::path::Path;

fn export(form: &str, out: &Path) {
    corf_ok(&["dataset", "export", text(tiny_dataset()), "--to", form, "--out", text(out)]);
}

/// Half of a millimetre, and what a float32 of some metres rounds.
const DEPTH_TOLERANCE_M: f32 = 5.01e-4;

#[test]
fn a_nerfstudio_folder_comes_back_with_its_depth_and_names_its_points() {
    let folder = tempfile::tempdir().unwrap();
    let (out, back) = (folder.path().join("ns"), folder.path().join("back"));
    export("nerfstudio", &out);
    corf_ok(&["dataset", "import", text(&out), "--from", "nerfstudio", "--out", text(&back)]);
    let (a, b) = (Dataset::open(tiny_dataset()).unwrap(), Dataset::open(&back).unwrap());
    assert_eq!((a.light_camera(), a.train_indices(), a.test_indices()), (b.light_camera(), b.train_indices(), b.test_indices()));
    for i in 0..a.len() {
        let (a, b) = (a.keyframe(i).unwrap(), b.keyframe(i).unwrap());
        assert_eq!(a.world_from_camera.to_rows(), b.world_from_camera.to_rows(), "{i}");
        let (a, b) = (a.light.unwrap(), b.light.unwrap());
        assert!(a.image == b.image, "{i}");
        let (a, b) = (a.depth_m.unwrap(), b.depth_m.unwrap());
        assert!(a.pixels().iter().zip(b.pixels()).all(|(a, b)| (a - b).abs() < DEPTH_TOLERANCE_M), "{i}");
    }
    // The points of the COLMAP model, 27 bytes each behind the header.
    let transforms: Value = serde_json::from_slice(&fs::read(out.join("transforms.json")).unwrap()).unwrap();
    let cloud = fs::read(out.join(transforms["ply_file_path"].as_str().unwrap())).unwrap();
    let end = cloud.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let model = fs::read_to_string(tiny_dataset().join("optical/sparse/0/points3D.txt")).unwrap();
    let first: Vec<f64> = model.lines().nth(1).unwrap().split(' ').skip(1).take(3).map(|v| v.parse().unwrap()).collect();
    let read: Vec<f64> = cloud[end..end + 24].chunks(8).map(|b| f64::from_le_bytes(b.try_into().unwrap())).collect();
    assert_eq!((cloud.len() - end, read), (27 * (model.lines().count() - 1), first));
    // A folder that is there is left alone.
    corf_refuses(&["dataset", "export", text(tiny_dataset()), "--to", "nerfstudio", "--out", text(&out)], &["not empty"]);
}

/// Of decibels: half of what Jet shows in one colour, and a step of eight bits.
const JET_TOLERANCE: f64 = 0.5 * 0.015 + 1.0 / 255.0;

#[test]
fn an_rf_3dgs_folder_has_one_camera_and_its_spectra_are_those_of_its_rays() {
    let folder = tempfile::tempdir().unwrap();
    let (out, back) = (folder.path().join("rf3"), folder.path().join("back"));
    export("rf-3dgs", &out);
    let ours = Dataset::open(tiny_dataset()).unwrap();
    let range = ours.db_range().unwrap();
    let levels = format!("--rf-db={},{}", range.min_db, range.max_db);
    corf_ok(&["dataset", "import", text(&out), "--from", "rf-3dgs", &levels, "--out", text(&back)]);
    let theirs = Dataset::open(&back).unwrap();
    assert_eq!((ours.light_camera(), ours.train_indices()), (theirs.light_camera(), theirs.train_indices()));
    // 96x54 in front of 48x32: of the spectra's 32 rows the images show the middle 27, from half of row 2 to half of row 29.
    let camera = theirs.radio_camera();
    assert_eq!((camera.width, camera.height, camera.cy, camera.fy), (48, 27, 13.5, ours.radio_camera().fy));
    for i in 0..ours.len() {
        let (a, b) = (ours.keyframe(i).unwrap(), theirs.keyframe(i).unwrap());
        assert!(a.light.unwrap().image == b.light.unwrap().image, "{i}");
        let (a, b) = (a.radio.unwrap().spectrum, b.radio.unwrap().spectrum);
        let expected = Raster::from_fn(48, 27, |x, y| 0.5 * (a[(x, y + 2)] + a[(x, y + 3)]));
        for (wanted, read) in expected.pixels().iter().zip(b.pixels()) {
            let off = f64::from(range.scalar(*wanted) - range.scalar(*read)).abs();
            assert!(off < JET_TOLERANCE, "{i}: {wanted} {read}");
        }
    }
}

#[cfg(feature = "slow")]
#[test]
fn a_nerf2_set_is_traced_anew_with_the_array_standing_still() {
    let folder = tempfile::tempdir().unwrap();
    let trajectory = "[trajectory]\nwaypoints_m = [[4, 0.8], [5, 1.6], [4.6, 0.9]]\nheight_m = 1.5\n";
    let scene = room_with_pillar(folder.path(), [1.0, 2.0, 1.5], trajectory);
    let config = folder.path().join("data.toml");
    let body = format!(
        "name = \"room\"\nscene = {scene:?}\nkeyframes = 16\n[optical]\nwidth = 16\nheight = 12\nmethod = \"path\"\nsamples_per_pixel = 1\n\
         [rf]\nwidth = 16\nheight = 12\ndiffuse = false\n"
    );
    fs::write(&config, body).unwrap();
    let (data, out) = (folder.path().join("data"), folder.path().join("nerf2"));
    corf_ok(&["dataset", "generate", text(&config), "--out", text(&data)]);
    corf_ok(&["dataset", "export", text(&data), "--to", "nerf2", "--scene", text(&scene), "--out", text(&out)]);
    let read = |name: &str| fs::read_to_string(out.join(name)).unwrap();
    let places: Vec<String> = read("tx_pos.csv").lines().map(str::to_owned).collect();
    assert!(places[0] == "x,y,z" && places.len() == 17, "{places:?}");
    assert!(read("gateway_info.yml").contains("position: [1, 2, 1.5]"), "{}", read("gateway_info.yml"));
    assert_eq!((read("test_index.txt").as_str(), read("train_index.txt").lines().count()), ("00001\n00009\n", 14));
    // The array looks along +x: its y is the gateway's x, up the gateway's y. The strongest pixel of each spectrum is where the transmitter is.
    for (i, place) in places[1..].iter().enumerate() {
        let at: Vec<f64> = place.split(',').map(|v| v.parse().unwrap()).collect();
        let way = glam::DVec3::new(at[0] - 1.0, at[1] - 2.0, at[2] - 1.5).normalize();
        let file = format!("spectrum/{}.png", corf_scene::dataset::stem(i));
        let image = corf_scene::io::read_png16(out.join(file)).unwrap();
        assert_eq!((image.width(), image.height()), (360, 90));
        let peak = (0..360 * 90).max_by_key(|&k| (image.pixels()[k][0], std::cmp::Reverse(k))).unwrap();
        let [azimuth, elevation] = [peak % 360 + 1, peak / 360 + 1].map(|v| (v as f64).to_radians());
        let seen = glam::DVec3::new(elevation.sin(), elevation.cos() * azimuth.cos(), elevation.cos() * azimuth.sin());
        assert!(seen.angle_between(way).to_degrees() < 1.5, "{i}: {seen} {way}");
    }
    // Another scene, none, and flags of another form.
    let other = folder.path().join("other");
    fs::create_dir_all(&other).unwrap();
    let elsewhere = room_with_pillar(&other, [1.0, 2.5, 1.5], trajectory);
    let refused = folder.path().join("refused");
    let call = ["dataset", "export", text(&data), "--out", text(&refused), "--to"];
    corf_refuses(&[&call[..], &["nerf2", "--scene", text(&elsewhere)]].concat(), &["not the scene", "generated from"]);
    corf_refuses(&[&call[..], &["nerf2"]].concat(), &["--scene SCENE.toml"]);
    corf_refuses(&[&call[..], &["numpy", "--scene", text(&scene)]].concat(), &["--scene", "--to nerf2"]);
    assert!(!refused.exists());
}

#[test]
fn an_imported_capture_is_not_relabelled_for_nerf2() {
    let folder = tempfile::tempdir().unwrap();
    let (out, refused) = (folder.path().join("out"), folder.path().join("refused"));
    corf_ok(&["dataset", "import", text(&tiny_dataset().join("optical")), "--from", "colmap", "--out", text(&out)]);
    corf_refuses(&["dataset", "export", text(&out), "--to", "nerf2", "--out", text(&refused)], &["imported", "no scene"]);
    corf_refuses(&["dataset", "export", text(&out), "--to", "rf-3dgs", "--out", text(&refused)], &["both images and spectra"]);
    assert!(!refused.exists());
}

#[test]
fn a_deepmimo_scenario_is_whole_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let scene = room_with_pillar(folder.path(), [1.0, 1.0, 2.0], "");
    let out = folder.path().join("room_60");
    let call = ["paths", text(&scene), "--rx", "5,4,1.5", "--rx", "4,1,1", "--format", "deepmimo"];
    corf_ok(&[&call[..], &["--out", text(&out)]].concat());
    let names: Vec<String> = fs::read_dir(&out).unwrap().map(|f| f.unwrap().file_name().into_string().unwrap()).collect();
    let matrices = names.iter().filter(|n| n.ends_with("_t000_tx000_r001.npz")).count();
    assert_eq!((matrices, names.len()), (11, 16), "{names:?}");
    let params: Value = serde_json::from_slice(&fs::read(out.join("params.json")).unwrap()).unwrap();
    assert_eq!(params["txrx_sets"]["txrx_set_1"]["num_points"], 2);
    assert_eq!((&params["scene"]["n_triangular_faces"], &params["rt_params"]["frequency"]), (&24.into(), &60e9.into()));
    assert_eq!(params["materials"].as_object().unwrap().len(), 2);
    // DeepMIMO's Doppler shifts need one terrain: the floor, cut off the room.
    let objects: Value = serde_json::from_slice(&fs::read(out.join("objects.json")).unwrap()).unwrap();
    let described: Vec<[&Value; 3]> = objects.as_array().unwrap().iter().map(|o| [&o["name"], &o["label"], &o["id"]]).collect();
    let expected = [("room", "objects"), ("pillar", "objects"), ("room (ground)", "terrain")];
    for (i, (found, (name, label))) in described.iter().zip(expected).enumerate() {
        assert_eq!(found, &[&Value::from(name), &Value::from(label), &Value::from(i)], "{objects}");
    }
    assert_eq!((described.len(), &params["scene"]["n_objects"]), (3, &3.into()));
    assert!((params["materials"]["material_0"]["permittivity"].as_f64().unwrap() - 2.73).abs() < 0.01, "plasterboard");
    for (more, words) in [
        (&["--out", text(&folder.path().join("Room"))][..], &["capital letters"][..]),
        (&[], &["--out FOLDER"]),
        (&["--out", text(&out)], &["not empty"]),
        (&["--out", text(&folder.path().join("a")), "--bandwidth", "1e8"], &["--bandwidth", "compute_channels"]),
        (&["--out", text(&folder.path().join("a")), "--rx-array", "2x2"], &["[receiver]", "ue_antenna"]),
        (&["--out", text(&folder.path().join("a")), "--diffuse"], &["--diffuse", "no coefficient"]),
        (&["--out", text(&folder.path().join("a")), "--velocity", "1,0,0"], &["--velocity", "rx_vel", "set_doppler"]),
        (&["--out", text(&folder.path().join("a")), "--tx-velocity", "0,0,1"], &["--tx-velocity", "no velocities"]),
    ] {
        corf_refuses(&[&call[..], more].concat(), words);
    }
    assert!(!folder.path().join("a").exists() && !folder.path().join("Room").exists());
}
