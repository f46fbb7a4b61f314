//! Captures in, data sets out: what was exported comes back, and one modality by itself goes all the way.

use crate::common::{copy_folder, corf_ok, corf_refuses, text, tiny_dataset};
use corf_scene::dataset::{Dataset, stem};
use corf_scene::{Light, Raster, Rigid3, io};
use glam::{DMat3, DVec3};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// Poses pass through text with 17 digits and a quaternion.
const POSE_TOLERANCE: f64 = 1e-9;

fn same_pose(a: &Rigid3, b: &Rigid3) -> bool {
    a.to_rows().iter().flatten().zip(b.to_rows().iter().flatten()).all(|(a, b)| (a - b).abs() < POSE_TOLERANCE)
}

/// A `transforms.json` of the tiny data set in another world: y is up, units are 0.4 m, it is turned and moved, and names are others.
fn foreign_world(folder: &Path) -> (f64, Vec<String>) {
    let dataset = Dataset::open(tiny_dataset()).unwrap();
    let metres_per_unit = 0.4;
    // World z becomes y, after a turn about z.
    let y_up = DMat3::from_cols(DVec3::X, -DVec3::Z, DVec3::Y) * DMat3::from_rotation_z(0.7);
    let offset = DVec3::new(3.0, -20.0, 11.0);
    let (mut frames, mut names) = (Vec::new(), Vec::new());
    fs::create_dir_all(folder.join("photos")).unwrap();
    for pose in dataset.poses() {
        // Neither padded nor in step: 5, 12, 19 ... with another word for every third.
        let name = format!("photos/take{}_{}.png", 7 * pose.index + 5, ["left", "right", "up"][pose.index % 3]);
        fs::copy(tiny_dataset().join(format!("optical/images/{}.png", stem(pose.index))), folder.join(&name)).unwrap();
        let rotation = y_up * pose.world_from_camera.rotation;
        let translation = y_up * pose.world_from_camera.translation / metres_per_unit + offset;
        let rows = Rigid3 { rotation, translation }.to_rows().map(|[a, b, c, d]| [a, -b, -c, d]);
        frames.push(json!({ "file_path": name, "transform_matrix": rows }));
        names.push(name);
    }
    // The order in the file says nothing.
    frames.reverse();
    let c = dataset.light_camera();
    let json = json!({ "w": c.width, "h": c.height, "fl_x": c.fx, "fl_y": c.fy, "cx": c.cx, "cy": c.cy, "frames": frames });
    fs::write(folder.join("transforms.json"), json.to_string()).unwrap();
    (metres_per_unit, names)
}

#[test]
fn a_data_set_exported_as_colmap_comes_back_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let (out, ours) = (folder.path().join("out"), tiny_dataset());
    let path = |name: &str| ours.join(name).to_str().unwrap().to_owned();
    let (light, radio, depth) = (path("optical"), path("rf/spectra"), path("optical/depth"));
    let given = ["--rf", &radio, "--rf-camera", "90", "--rf-quantity", "power-per-steradian", "--depth", &depth];
    corf_ok(
        &[&["dataset", "import", &light, "--from", "colmap", "--out", text(&out), "--frequency-hz", "60e9"], &given[..]].concat(),
    );
    assert!(corf_ok(&["dataset", "validate", text(&out)]).contains("passed"));
    let (a, b) = (Dataset::open(ours).unwrap(), Dataset::open(&out).unwrap());
    assert_eq!(
        (a.len(), a.light_camera(), a.radio_camera(), a.db_range()),
        (b.len(), b.light_camera(), b.radio_camera(), b.db_range())
    );
    assert_eq!((a.train_indices(), a.test_indices()), (b.train_indices(), b.test_indices()));
    for i in 0..a.len() {
        let (a, b) = (a.keyframe(i).unwrap(), b.keyframe(i).unwrap());
        assert!(same_pose(&a.world_from_camera, &b.world_from_camera), "{i}");
        let seen = Light { surface: None, ..a.light.unwrap() };
        assert!(b.light == Some(seen) && a.radio == b.radio, "{i}");
    }
    let imported = b.header().imported.as_ref().unwrap();
    assert_eq!((imported.format.as_str(), imported.names[0].as_str()), ("colmap", "00001.png"));
    let image = fs::read(ours.join("optical/images/00001.png")).unwrap();
    assert_eq!(imported.sources["images/00001.png"], io::sha256_hex(&image));
    assert_eq!(imported.sources.len(), 3 + 3 * a.len(), "model, images, spectra, depth");
    // Points that others start from: those of the capture join those of its depth.
    let points = |dir: &Path| fs::read_to_string(dir.join("optical/sparse/0/points3D.txt")).unwrap().lines().count();
    assert!(points(&out) > points(ours));
    // The same capture makes the same bytes.
    let again = folder.path().join("again");
    corf_ok(
        &[&["dataset", "import", &light, "--from", "colmap", "--out", text(&again), "--frequency-hz", "60e9"], &given[..]]
            .concat(),
    );
    assert_eq!(Dataset::open(&again).unwrap().hash(), b.hash());
}

#[test]
fn a_turned_moved_and_scaled_world_comes_back_by_up_and_scale() {
    let folder = tempfile::tempdir().unwrap();
    let capture = folder.path().join("capture");
    let (metres_per_unit, names) = foreign_world(&capture);
    let out = folder.path().join("out");
    let scale = metres_per_unit.to_string();
    let import = ["dataset", "import", text(&capture), "--from", "nerfstudio", "--up=0,1,0", "--scale", &scale, "--split", "5"];
    corf_ok(&[&import[..], &["--out", text(&out)]].concat());
    let (a, b) = (Dataset::open(tiny_dataset()).unwrap(), Dataset::open(&out).unwrap());
    assert_eq!(b.header().imported.as_ref().unwrap().names, names, "in the order of their numbers");
    assert_eq!(b.test_indices(), [0, 5]);
    let height = b.poses()[0].world_from_camera.translation.z - a.poses()[0].world_from_camera.translation.z;
    for i in 0..a.len() {
        let [first_a, first_b] = [&a, &b].map(|d| d.poses()[0].world_from_camera);
        let [pose_a, pose_b] = [&a, &b].map(|d| d.poses()[i].world_from_camera);
        // What a heading and an origin cannot change: poses as the first camera sees them, heights, and what every camera says is up.
        assert!(same_pose(&first_a.inverse().compose(&pose_a), &first_b.inverse().compose(&pose_b)), "{i}");
        assert!((pose_b.translation.z - pose_a.translation.z - height).abs() < POSE_TOLERANCE);
        let up = |pose: &Rigid3| pose.inverse().transform_vector(DVec3::Z);
        assert!((up(&pose_a) - up(&pose_b)).length() < POSE_TOLERANCE);
        assert!(a.keyframe(i).unwrap().light.unwrap().image == b.keyframe(i).unwrap().light.unwrap().image);
    }
    // The cameras agree on it within their pitch.
    let by_cameras = folder.path().join("cameras");
    corf_ok(&["dataset", "import", text(&capture), "--from", "nerfstudio", "--up", "cameras", "--out", text(&by_cameras)]);
    let up = Dataset::open(&by_cameras).unwrap().header().imported.as_ref().unwrap().up.unwrap();
    assert!(DVec3::from(up).dot(DVec3::Y) > 0.99, "{up:?}");
}

/// Reconstructs, evaluates and renders a data set of one modality; returns the record, the printed table and the folder of views.
fn the_whole_way(dataset: &Path, folder: &Path, overrides: &[&str]) -> (Value, String, std::path::PathBuf) {
    let (run, views) = (folder.join("run"), folder.join("views"));
    corf_ok(&[&["reconstruct", text(dataset), "--out", text(&run), "--set", "iterations_per_keyframe=40"], overrides].concat());
    let record = serde_json::from_str(&corf_ok(&["evaluate", text(&run), "--json"])).unwrap();
    let table = corf_ok(&["evaluate", text(&run), "--columns", "all"]);
    corf_ok(&["render", text(&run), "--poses", text(&dataset.join("trajectory.json")), "--out", text(&views)]);
    (record, table, views)
}

/// Columns of a printed table whose one row has a number.
fn numbers(record: &Value) -> Vec<&str> {
    record["means"].as_object().unwrap().iter().filter(|(_, v)| v.is_number()).map(|(k, _)| k.as_str()).collect()
}

#[test]
fn light_alone_goes_the_whole_way_and_has_no_number_of_radio() {
    let folder = tempfile::tempdir().unwrap();
    let (out, run) = (folder.path().join("out"), folder.path().join("refused"));
    let light = tiny_dataset().join("optical");
    corf_ok(&["dataset", "import", text(&light), "--from", "colmap", "--out", text(&out)]);
    assert!(corf_ok(&["dataset", "validate", text(&out)]).contains("passed"));
    assert!(!out.join("rf").exists() && !out.join("optical/depth").exists());
    // What is missing is named with the flag that supplies it, before anything is begun.
    let reconstruct =
        |method: &'static str| ["reconstruct", text(&out), "--out", text(&run), "--method", method].map(str::to_owned);
    let refused = |method, words: &[&str]| {
        let arguments = reconstruct(method);
        corf_refuses(&arguments.iter().map(String::as_str).collect::<Vec<_>>(), words);
        assert!(!run.exists());
    };
    refused("corf-gs", &["depth.prior=none", "depth.folder", "--depth"]);
    refused("nerf2", &["nerf2 needs spectra", "--rf"]);
    refused("corf-gs-frozen", &["needs spectra"]);
    let without = folder.path().join("without");
    corf_ok(&[
        "reconstruct",
        text(&out),
        "--out",
        text(&without),
        "--set",
        "depth.prior=none",
        "--set",
        "iterations_per_keyframe=5",
    ]);
    // Measured depth can be the prior, and then the record says so.
    let (measured, depth) = (folder.path().join("measured"), light.join("depth"));
    corf_ok(&["dataset", "import", text(&light), "--from", "colmap", "--depth", text(&depth), "--out", text(&measured)]);
    let (record, table, views) = the_whole_way(&measured, folder.path(), &["--set", "depth.prior=\"exact\""]);
    assert!(record["uses_ground_truth_depth"].as_bool().unwrap() && record["depth_imported"].as_bool().unwrap());
    assert!(table.contains("imported capture") && !table.contains("ray tracer"), "{table}");
    let numbers = numbers(&record);
    assert!(
        numbers.contains(&"psnr_opt") && !numbers.iter().any(|k| k.contains("rf") || k.contains("db") || k.contains("beam")),
        "{numbers:?}"
    );
    assert!(record["means"]["psnr_opt"].as_f64().unwrap() > 10.0, "{record}");
    assert!(table.contains('–'), "{table}");
    assert!(views.join("images/00010.png").exists() && views.join("depth/00010.exr").exists());
    assert!(!views.join("jet").exists() && !views.join("linear").exists() && !views.join("db").exists());
    let run = folder.path().join("run");
    assert!(run.join("optical.ply").exists() && !run.join("rf.ply").exists());
    // Lookups know no radio either, and their predictions hold none.
    let (lookup, predictions) = (folder.path().join("lookup"), folder.path().join("predictions"));
    corf_ok(&["reconstruct", text(&out), "--out", text(&lookup), "--method", "nearest"]);
    corf_ok(&["evaluate", text(&lookup), "--write-predictions", text(&predictions)]);
    assert!(predictions.join("images").exists() && !predictions.join("linear").exists() && !predictions.join("jet").exists());
    corf_ok(&["evaluate", "--predictions", text(&predictions), "--dataset", text(&out)]);
}

#[test]
fn radio_alone_goes_the_whole_way_and_has_no_number_of_light() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    // Our folder of spectra is in RF-3DGS's layout, painted in Jet.
    let radio = tiny_dataset().join("rf");
    let range = Dataset::open(tiny_dataset()).unwrap().db_range().unwrap();
    let levels = format!("--rf-db={},{}", range.min_db, range.max_db);
    corf_refuses(&["dataset", "import", text(&radio), "--from", "rf-3dgs", "--out", text(&out)], &["--rf-db", "00001.png"]);
    assert!(!out.exists());
    corf_ok(&["dataset", "import", text(&radio), "--from", "rf-3dgs", &levels, "--out", text(&out)]);
    assert!(corf_ok(&["dataset", "validate", text(&out)]).contains("passed"));
    let (a, b) = (Dataset::open(tiny_dataset()).unwrap(), Dataset::open(&out).unwrap());
    assert_eq!((a.radio_camera(), a.db_range(), a.test_indices()), (b.radio_camera(), b.db_range(), b.test_indices()));
    assert!(b.header().imported.as_ref().unwrap().notes.iter().any(|n| n.contains("Jet")));
    for i in 0..a.len() {
        let scalars = [&a, &b].map(|d| d.keyframe(i).unwrap().radio.unwrap().spectrum.map(|&s| range.scalar(s)));
        let off = scalars[0].pixels().iter().zip(scalars[1].pixels()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        // Eight bits of Jet, and the part of it that is one colour.
        assert!(off < 0.012, "{i}: {off}");
    }
    let (record, _, views) = the_whole_way(&out, folder.path(), &["--set", "depth.prior=none"]);
    let numbers = numbers(&record);
    assert!(numbers.contains(&"psnr_rf_jet") && !numbers.iter().any(|k| k.ends_with("_opt")), "{numbers:?}");
    assert!(record["means"]["psnr_rf_jet"].as_f64().unwrap() > 8.0, "{record}");
    assert!(!numbers.iter().any(|k| k.contains("beam_top")), "the unit of the spectra is not known: {numbers:?}");
    assert!(views.join("jet/00010.png").exists() && views.join("linear/00010.exr").exists() && !views.join("images").exists());
    let run = folder.path().join("run");
    assert!(run.join("rf.ply").exists() && !run.join("optical.ply").exists());
}

#[test]
fn faulty_captures_are_refused_and_leave_nothing() {
    let folder = tempfile::tempdir().unwrap();
    let (light, radio) = (tiny_dataset().join("optical"), tiny_dataset().join("rf/spectra"));
    let out = folder.path().join("out");
    let import = |capture: &Path, more: &[&str], words: &[&str]| {
        corf_refuses(&[&["dataset", "import", text(capture), "--from", "colmap", "--out", text(&out)], more].concat(), words);
        assert!(!out.exists(), "{words:?}");
    };
    // A model with one thing changed.
    let changed = |name: &str, change: &dyn Fn(&Path)| {
        let capture = folder.path().join(name);
        copy_folder(&light.join("sparse"), &capture.join("sparse"));
        copy_folder(&light.join("images"), &capture.join("images"));
        change(&capture);
        capture
    };
    let replace = |file: &Path, from: &str, to: &str| {
        let text = fs::read_to_string(file).unwrap();
        assert!(text.contains(from));
        fs::write(file, text.replacen(from, to, 1)).unwrap();
    };
    let missing = changed("missing", &|c| fs::remove_file(c.join("images/00004.png")).unwrap());
    import(&missing, &[], &["00004.png", "missing", "--images"]);
    // The last of all, after others have been written.
    let size = changed("size", &|c| io::write_png(c.join("images/00010.png"), &Raster::filled(95, 54, [9; 3])).unwrap());
    import(&size, &[], &["00010.png", "95x54", "96x54"]);
    let model = changed("model", &|c| replace(&c.join("sparse/0/cameras.txt"), "PINHOLE", "SIMPLE_RADIAL_FISHEYE"));
    import(&model, &[], &["cameras.txt"]);
    let fisheye = changed("fisheye", &|c| {
        fs::write(c.join("sparse/0/cameras.txt"), "1 SIMPLE_RADIAL_FISHEYE 96 54 48 48 27 0.1\n").unwrap();
    });
    import(&fisheye, &[], &["SIMPLE_RADIAL_FISHEYE", "is not read", "image_undistorter"]);
    let pose = changed("pose", &|c| {
        let file = c.join("sparse/0/images.txt");
        let text = fs::read_to_string(&file).unwrap();
        let line = text.lines().find(|l| l.ends_with("00003.png")).unwrap().to_owned();
        let mut fields: Vec<&str> = line.split(' ').collect();
        fields[5] = "nan";
        fs::write(&file, text.replace(&line, &fields.join(" "))).unwrap();
    });
    import(&pose, &[], &["00003.png", "pose", "NaN"]);
    // Spectra.
    let spectra = folder.path().join("spectra");
    copy_folder(&radio, &spectra);
    let with = |more: &[&'static str]| [&["--rf", text(&spectra)], more].concat();
    import(&light, &with(&[]), &["--rf-camera", "field of view"]);
    import(&light, &with(&["--rf-camera", "200"]), &["--rf-camera", "200"]);
    import(&light, &with(&["--rf-camera", "90", "--rf-db=-200,-150"]), &["stated range", "-150"]);
    import(&light, &with(&["--rf-camera", "90", "--rf-db=-40,-110"]), &["--rf-db"]);
    fs::rename(spectra.join("00002.exr"), spectra.join("2.exr")).unwrap();
    import(&light, &with(&["--rf-camera", "90"]), &["00002.png has no spectrum"]);
    import(&light, &["--rf-db=-100,-40"], &["--rf-db", "--rf"]);
    import(&light, &["--no-images"], &["neither images nor spectra", "--rf"]);
    import(&light, &["--up=0,0,0"], &["--up", "no direction"]);
    import(&light, &["--scale", "0"], &["--scale"]);
    import(&light, &["--split", "none.txt"], &["none.txt"]);
    import(&light, &["--split", "1"], &["--split", "train"]);
    import(folder.path(), &[], &["sparse/0"]);
    // An array that stands nowhere.
    let gateway = folder.path().join("nerf2");
    fs::create_dir(&gateway).unwrap();
    fs::write(gateway.join("gateway_info.yml"), "gateway1: {}\n").unwrap();
    corf_refuses(
        &["dataset", "import", text(&gateway), "--from", "nerf2", "--out", text(&out)],
        &["position is there 0 times", "gateway_info.yml"],
    );
    assert!(!out.exists());
    // A mask that is named and missing is no mask that lets everything count.
    let masked = folder.path().join("masked");
    foreign_world(&masked);
    replace(&masked.join("transforms.json"), "\"file_path\"", "\"mask_path\":\"m.png\",\"file_path\"");
    let import = ["dataset", "import", text(&masked), "--from", "nerfstudio", "--out", text(&out)];
    corf_refuses(&import, &["m.png"]);
    assert!(!out.exists());
    // An occupied folder is refused and kept.
    fs::create_dir(&out).unwrap();
    fs::write(out.join("precious"), "x").unwrap();
    corf_refuses(&["dataset", "import", text(&light), "--from", "colmap", "--out", text(&out)], &["not empty"]);
    assert!(out.join("precious").exists());
    // A folder that was empty stays, and stays empty.
    fs::remove_file(out.join("precious")).unwrap();
    corf_refuses(&["dataset", "import", text(&size), "--from", "colmap", "--out", text(&out)], &["95x54"]);
    assert_eq!(fs::read_dir(&out).unwrap().count(), 0);
}

#[test]
fn a_capture_is_answered_with_the_command_that_imports_it() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    for (capture, layout) in [(tiny_dataset().join("optical"), "rf-3dgs"), (folder.path().join("transforms"), "nerfstudio")] {
        if layout == "nerfstudio" {
            foreign_world(&capture);
        }
        corf_refuses(
            &["reconstruct", text(&capture), "--out", text(&run)],
            &["no dataset.json", "corf dataset import", text(&capture), &format!("--from {layout}")],
        );
    }
    assert!(!run.exists());
}
