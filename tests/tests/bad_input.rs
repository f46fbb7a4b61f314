//! Bad input is answered with what, where and what to do; exit code 2; nothing half-written.

use crate::common::*;
use std::fs;

#[test]
fn a_missing_scene_is_named() {
    corf_refuses(&["scene", "info", "no/such/room.glb"], &["no/such/room.glb"]);
    corf_refuses(&["paths", "no/such/room.toml", "--rx", "1,2,3"], &["no/such/room.toml"]);
    let mesh = root().join("scenes/lobby.glb");
    corf_refuses(&["paths", text(&mesh), "--rx", "1,2,3"], &["lobby.glb", "no UTF-8 text", ".toml"]);
}

#[test]
fn a_truncated_glb_is_refused_at_any_length() {
    let folder = tempfile::tempdir().unwrap();
    let whole = fs::read(root().join("scenes/lobby.glb")).unwrap();
    let path = folder.path().join("cut.glb");
    for length in [0, 3, 11, 19, 500, whole.len() / 2, whole.len() - 1] {
        fs::write(&path, &whole[..length]).unwrap();
        corf_refuses(&["scene", "info", text(&path)], &["cut.glb", "help"]);
    }
}

#[test]
fn a_typo_in_a_configuration_is_named_with_its_line() {
    let folder = tempfile::tempdir().unwrap();
    let config = tiny_config(folder.path(), 4);
    let body = fs::read_to_string(&config).unwrap().replace("samples_per_pixel", "samples_per_pixle");
    fs::write(&config, body).unwrap();
    let out = folder.path().join("out");
    let words = ["tiny.toml", "samples_per_pixle", "samples_per_pixel"];
    corf_refuses(&["dataset", "generate", text(&config), "--out", text(&out)], &words);
    assert!(!out.exists());
}

#[test]
fn an_unknown_key_of_a_method_is_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("run");
    let dataset = text(tiny_dataset());
    let args = ["reconstruct", dataset, "--out", text(&out), "--set", "iterations=3"];
    corf_refuses(&args, &["iterations", "iterations_per_keyframe"]);
    assert!(!out.exists());
    corf_refuses(&["reconstruct", dataset, "--out", text(&out), "--method", "corfgs"], &["corfgs", "corf-gs-frozen"]);
}

#[test]
fn a_configuration_that_the_keyframes_do_not_suit_leaves_nothing_in_the_way_of_another() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let dataset = text(tiny_dataset());
    let levels = ["--set", "pyramid_levels=6"];
    corf_refuses(&[&["reconstruct", dataset, "--out", text(&out)][..], &levels].concat(), &["below 8 pixels", "help"]);
    assert!(!out.exists());
    let live = folder.path().join("live");
    corf_ok(&["dataset", "play", dataset, "--to", text(&live), "--rate", "10000"]);
    corf_refuses(&[&["reconstruct", "--follow", text(&live), "--out", text(&out)][..], &levels].concat(), &["below 8 pixels"]);
    assert!(!out.exists());
    // What is wrong with any row of a plan is known before the first is run.
    let plan = folder.path().join("plan.toml");
    let row = |config: &str| format!("[[row]]\nlabel = \"b\"\nmethod = \"corf-gs\"\n[row.config]\n{config}\n");
    let write = |config: &str| {
        let rows = "[[row]]\nlabel = \"a\"\nmethod = \"nearest\"\n".to_owned() + &row(config);
        std::fs::write(&plan, format!("name = \"x\"\ndataset = {:?}\nseeds = [1]\n{rows}", tiny_dataset())).unwrap();
    };
    write("pyramid_levels = 6");
    corf_refuses(&["bench", "run", text(&plan), "--out", text(&out)], &["row \"b\"", "below 8 pixels"]);
    assert!(!out.exists());
    // And a cell that failed does not hold up one with other settings.
    write("iterations_per_keyframe = 5");
    let run = ["bench", "run", text(&plan), "--out", text(&out), "--device", "cpu"];
    corf_ok(&run);
    let cell = out.join("cells/b-seed1.json");
    let mut record: serde_json::Value = serde_json::from_slice(&std::fs::read(&cell).unwrap()).unwrap();
    record["status"] = "failed".into();
    record["error"] = "out of memory".into();
    record["config"]["reconstruction"]["iterations_per_keyframe"] = 75.into();
    std::fs::write(&cell, record.to_string()).unwrap();
    corf_ok(&[&run[..], &["--resume"]].concat());
    assert!(std::fs::read_to_string(&cell).unwrap().contains("\"done\""));
}

#[test]
fn a_reference_that_cannot_be_sampled_is_refused_before_any_work() {
    let config = root().join("scenes/lobby-mini.toml");
    let bench = |more: &[&'static str]| [&["bench", "radio", text(&config), "--spectrum", "bartlett"], more].concat();
    corf_refuses(&bench(&["--reference-directions", "5"]), &["`directions`", "5", "100"]);
    corf_refuses(&bench(&["--reference-directions", "90000", "--replicas", "1"]), &["--reference-directions", "--replicas 2"]);
}

#[test]
fn what_would_be_a_silent_number_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let scene = root().join("scenes/lobby.toml");
    let (scene, out) = (text(&scene), folder.path().join("out"));
    let out = text(&out);
    for fov in ["200", "180", "-20", "nan"] {
        corf_refuses(&["spectrum", scene, "--rx", "7,4,1.6", "--fov-deg", fov, "--out", out], &["fov_deg", "180 degrees"]);
    }
    corf_refuses(&["diffuse", scene, "--rx", "7,4,1.6", "--replicas", "0"], &["--replicas"]);
    // The transmitter itself.
    corf_refuses(&["diffuse", scene, "--rx", "12.4,4.5,2"], &["coincides", "12.4, 4.5, 2"]);
    corf_refuses(&["paths", scene, "--rx", "7,4,1.6", "--diffuse", "--format", "sionna"], &["--diffuse", "--format json"]);
    let floor = ["coverage", scene, "--plane", "6,3,0", "9,3,0", "6,6,0", "--cell", "1", "--depth", "0", "--out", out];
    corf_refuses(&floor, &["no cell has a value", "all 9", "--height"]);
    let link = folder.path().join("link.toml");
    fs::write(&link, "min_gain_db = nan").unwrap();
    corf_refuses(&["paths", scene, "--rx", "7,4,1.6", "--config", text(&link)], &["min_gain_db"]);
    fs::write(folder.path().join("precious"), "x").unwrap();
    corf_refuses(&["coverage", scene, "--out", text(folder.path())], &["not empty", "another --out"]);
}

#[test]
fn a_material_without_radio_properties_is_named() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("m.mtl"), "newmtl mystery_foam\nKd 0.5 0.5 0.5\n").unwrap();
    let obj = "mtllib m.mtl\nusemtl mystery_foam\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    fs::write(folder.path().join("m.obj"), obj).unwrap();
    let scene = folder.path().join("m.toml");
    fs::write(&scene, "[scene]\nfile = \"m.obj\"\n[transmitter]\nposition_m = [0.0, 0.0, 2.0]\n").unwrap();
    corf_refuses(&["paths", text(&scene), "--rx", "1,1,1"], &["mystery_foam", "radio_materials"]);
    // Describing such a scene works, and says what is missing.
    assert!(corf_ok(&["scene", "info", text(&scene)]).contains("mystery_foam"));
    assert_eq!(corf(&["scene", "validate", text(&scene)]).status.code(), Some(1));
    // An ITU name that does not exist, and one that is not defined at 60 GHz.
    for (itu, words) in [("concreet", ["concreet", "concrete"]), ("brick", ["brick", "GHz"])] {
        let mapped = format!(
            "[scene]\nfile = \"m.obj\"\n[transmitter]\nposition_m = [0.0, 0.0, 2.0]\n\
             [radio_materials.mystery_foam]\nid = \"foam\"\nitu = \"{itu}\"\nthickness_m = 0.1\nscattering_coefficient = 0.0\n"
        );
        fs::write(&scene, mapped).unwrap();
        corf_refuses(&["paths", text(&scene), "--rx", "1,1,1"], &words);
    }
}

#[test]
fn an_output_folder_with_content_is_refused_and_left_alone() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    fs::create_dir(&out).unwrap();
    fs::write(out.join("precious.txt"), "mine").unwrap();
    let config = tiny_config(folder.path(), 4);
    corf_refuses(&["dataset", "generate", text(&config), "--out", text(&out)], &["--resume"]);
    corf_refuses(&["reconstruct", text(tiny_dataset()), "--out", text(&out)], &["--resume"]);
    corf_refuses(&["demo", "--out", text(&out)], &["--resume"]);
    assert_eq!(fs::read_dir(&out).unwrap().count(), 1);
}

#[test]
fn an_output_that_cannot_be_written_is_refused_before_the_work() {
    let config = tempfile::tempdir().unwrap();
    let tiny = tiny_config(config.path(), 4);
    // A folder below a file can be made by nobody, not even by root.
    let blocked = text(&tiny).to_owned() + "/out";
    corf_refuses(&["dataset", "generate", text(&tiny), "--out", &blocked], &["out"]);
    corf_refuses(&["reconstruct", text(tiny_dataset()), "--out", &blocked], &["out", "help"]);
}

#[test]
fn a_nan_in_a_pose_is_located() {
    let folder = tempfile::tempdir().unwrap();
    let broken = folder.path().join("dataset");
    copy_folder(tiny_dataset(), &broken);
    let path = broken.join("trajectory.json");
    let mut json: serde_json::Value = serde_json::from_str(&fs::read_to_string(&path).unwrap()).unwrap();
    json["keyframes"][3]["world_from_camera"][1][3] = serde_json::json!("NaN");
    // JSON has no NaN: writers that emit one produce this token, and readers must not take it for a number.
    fs::write(&path, json.to_string().replace("\"NaN\"", "NaN")).unwrap();
    corf_refuses(&["reconstruct", text(&broken), "--out", text(&folder.path().join("run"))], &["trajectory.json"]);
    fs::write(&path, json.to_string().replace("\"NaN\"", "1e400")).unwrap();
    corf_refuses(&["reconstruct", text(&broken), "--out", text(&folder.path().join("run"))], &["trajectory.json"]);
    // A number, and no place.
    fs::write(&path, json.to_string().replace("\"NaN\"", "1e300")).unwrap();
    let never = folder.path().join("run");
    let args = ["reconstruct", text(&broken), "--out", text(&never), "--no-verify"];
    corf_refuses(&args, &["trajectory.json: keyframe 3", "1e300", "1e6"]);
    let poses = folder.path().join("poses.json");
    fs::write(&poses, "[[[1,0,0,0],[0,1,0,0],[0,0,2,0],[0,0,0,1]]]").unwrap();
    let run = folder.path().join("nearest");
    corf_ok(&["reconstruct", text(tiny_dataset()), "--out", text(&run), "--method", "nearest"]);
    let out = folder.path().join("views");
    corf_refuses(&["render", text(&run), "--poses", text(&poses), "--out", text(&out)], &["poses.json: pose 0", "rotation"]);
    fs::write(&poses, "[[[1,0,0,1e300],[0,1,0,0],[0,0,1,0],[0,0,0,1]]]").unwrap();
    corf_refuses(&["render", text(&run), "--poses", text(&poses), "--out", text(&out)], &["poses.json: pose 0", "1e300", "1e6"]);
    assert!(!out.exists());
}

#[test]
fn a_spectrum_of_the_wrong_size_and_a_truncated_image_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let broken = folder.path().join("dataset");
    copy_folder(tiny_dataset(), &broken);
    let spectrum = broken.join("rf/spectra/00003.exr");
    let wrong = corf_scene::io::encode_exr_f32(&corf_scene::Raster::filled(10, 10, 1.0), "Y").unwrap();
    fs::write(&spectrum, wrong).unwrap();
    let run = folder.path().join("run");
    corf_refuses(&["reconstruct", text(&broken), "--out", text(&run)], &["00003.exr", "SHA-256"]);
    corf_refuses(&["reconstruct", text(&broken), "--out", text(&run), "--no-verify"], &["00003.exr", "10"]);
    assert!(!run.join("run.json").exists());
    copy_folder(&tiny_dataset().join("rf"), &broken.join("rf"));
    let image = broken.join("optical/images/00005.png");
    let bytes = fs::read(&image).unwrap();
    fs::write(&image, &bytes[..bytes.len() / 2]).unwrap();
    let second = folder.path().join("run2");
    corf_refuses(&["reconstruct", text(&broken), "--out", text(&second), "--no-verify"], &["00005.png"]);
    assert_eq!(corf(&["dataset", "validate", text(&broken)]).status.code(), Some(1));
}

#[test]
fn an_antenna_inside_of_a_body_is_located() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    let around = "[trajectory]\nheight_m = 1.5\nwaypoints_m = [[1, 1], [5, 1], [5, 4], [1, 4]]\n";
    let inside = room_with_pillar(folder.path(), [2.3, 2.3, 2.0], around);
    corf_refuses(&["paths", text(&inside), "--rx", "5,4,1.5"], &["transmitter", "2.3", "\"pillar\""]);
    corf_refuses(&["coverage", text(&inside), "--height", "1.5", "--out", text(&out)], &["transmitter", "\"pillar\""]);
    let dataset = tiny_config(folder.path(), 4);
    let body = fs::read_to_string(&dataset).unwrap();
    let scene_line = body.lines().find(|l| l.starts_with("scene")).unwrap().to_owned();
    fs::write(&dataset, body.replace(&scene_line, "scene = \"room.toml\"")).unwrap();
    corf_refuses(&["dataset", "generate", text(&dataset), "--out", text(&out)], &["transmitter.position_m", "\"pillar\""]);
    assert_eq!(corf(&["scene", "validate", text(&inside)]).status.code(), Some(1));
    let sound = room_with_pillar(folder.path(), [1.0, 2.5, 2.0], around);
    corf_refuses(&["paths", text(&sound), "--rx", "2.3,2.3,1.5"], &["receiver", "\"pillar\""]);
    corf_refuses(&["paths", text(&sound), "--rx", "1,2.5,2"], &["receiver", "coincides"]);
    corf_refuses(&["paths", text(&sound), "--rx", "9,2.5,2"], &["\"room\""]);
    let through = around.replace("[5, 1], [5, 4]", "[2.3, 2.3], [5, 4]");
    let through = room_with_pillar(folder.path(), [1.0, 2.5, 2.0], &through);
    corf_refuses(&["dataset", "generate", text(&dataset), "--out", text(&out)], &["trajectory.waypoints_m", "\"pillar\""]);
    assert_eq!(corf(&["scene", "validate", text(&through)]).status.code(), Some(1));
    assert!(!out.exists());
}

#[test]
fn all_radio_faults_of_a_scene_are_said_at_once() {
    let folder = tempfile::tempdir().unwrap();
    let scene = room_with_pillar(folder.path(), [1.0, 1.0, 2.0], "");
    let sound = fs::read_to_string(&scene).unwrap();
    let faulty = sound.replace("thickness_m = 0.013", "thickness_m = 0.0").replace("itu = \"concrete\"", "itu = \"brick\"");
    fs::write(&scene, faulty).unwrap();
    let validate = corf(&["scene", "validate", text(&scene)]);
    let said = String::from_utf8_lossy(&validate.stdout).into_owned();
    assert_eq!(validate.status.code(), Some(1), "{said}");
    for words in ["thickness_m = 0", "1 to 40 GHz", "radio_materials.\"wall\"", "\"stone\""] {
        assert!(said.contains(words), "{words}\n{said}");
    }
    corf_refuses(&["paths", text(&scene), "--rx", "5,4,1.5"], &["thickness_m = 0", "wall"]);
    // Out of its range: an error where a triangle has it, and none where none has.
    fs::write(&scene, sound.replace("itu = \"concrete\"", "itu = \"brick\"")).unwrap();
    corf_refuses(&["paths", text(&scene), "--rx", "5,4,1.5"], &["stone", "brick", "1 to 40 GHz", "60 GHz"]);
    fs::write(&scene, sound.replace("frequency_hz", "")).unwrap();
    let obj = folder.path().join("room.obj");
    let all_walls = fs::read_to_string(&obj).unwrap().replace("usemtl stone", "usemtl wall");
    fs::write(&obj, all_walls).unwrap();
    fs::write(&scene, sound.replace("itu = \"concrete\"", "itu = \"brick\"")).unwrap();
    let output = corf(&["paths", text(&scene), "--rx", "5,4,1.5"]);
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    // The importer may leave out a material that nothing uses; then its entry is refused by name.
    assert!(output.status.code() == Some(0) || stderr.contains("no material of this name"), "{stderr}");
}

#[test]
fn an_open_body_is_warned_of_and_refused_where_asked() {
    let folder = tempfile::tempdir().unwrap();
    let lidless = [true, true, true, true, true, false];
    let boxes: Boxes<'_> = &[
        ("room", "wall", [0.0; 3], [6.0, 5.0, 3.0], CLOSED),
        ("crate", "stone", [3.0, 3.0, 0.5], [4.0, 4.0, 1.5], lidless),
        ("screen", "pane", [2.0, 1.0, 0.0], [2.008, 3.0, 2.0], CLOSED),
    ];
    let scene = boxes_scene(folder.path(), boxes, [1.0, 1.0, 2.0], "");
    let output = corf(&["paths", text(&scene), "--rx", "5,4,1.5"]);
    assert_eq!(output.status.code(), Some(0));
    assert!(String::from_utf8_lossy(&output.stderr).contains("\"crate\": a body of 5.00 m² with a hole: 4 open edges"));
    // Where nothing is transmitted nothing depends on it.
    let opaque = corf(&["paths", text(&scene), "--rx", "5,4,1.5", "--no-transmission"]);
    assert!(!String::from_utf8_lossy(&opaque.stderr).contains("hole"));
    let said = corf_ok(&["scene", "validate", text(&scene)]);
    // Two panes of 4 mm make the screen's 8 mm.
    assert!(said.contains("\"crate\"") && !said.contains("\"screen\""), "{said}");
    assert_eq!(corf(&["scene", "validate", "--strict", text(&scene)]).status.code(), Some(1));
}

#[test]
fn names_of_outputs_say_what_is_written_and_a_tables_key_is_no_value() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let refused = |arguments: &[&str], out: &str, words: &[&str]| {
        corf_refuses(&[arguments, &["--out", text(&at(out))]].concat(), words);
        assert!(fs::read_dir(folder.path()).unwrap().next().is_none(), "{arguments:?} wrote something");
    };
    let paths = ["paths", "scenes/room.toml", "--rx", "1.5,1.5,1.2"];
    refused(&paths, ".csv", &["ending without a name", "NAME.csv"]);
    refused(&paths, ".json", &["ending without a name"]);
    refused(&paths, "links.xlsx", &["links.xlsx", "ending", ".csv", "--format"]);
    let spectrum = ["spectrum", "scenes/room.toml", "--rx", "1.5,1.5,1.2", "--no-diffuse"];
    refused(&spectrum, "spectrum.exr", &["spectrum.exr", "folder", "without the ending .exr"]);
    refused(&["scene", "build", "lobby"], "lobby.obj", &["binary glTF", "NAME.glb"]);
    refused(&["dataset", "generate", "scenes/room-tiny.toml"], "data.npz", &["data.npz", "folder"]);
    let generate = ["dataset", "generate", "scenes/room-tiny.toml", "--set"];
    refused(&[&generate[..], &["optical=4"]].concat(), "data", &["optical is a table", "help: ", "effort", "width"]);
    let reconstruct = ["reconstruct", text(tiny_dataset()), "--set", "optimizer=fast"];
    refused(&reconstruct, "run", &["optimizer is a table", "ssim_weight"]);
    refused(&["reconstruct", text(tiny_dataset()), "--seed", "-5"], "run", &["invalid value '-5' for '--seed"]);
}
