//! The field that knows its array, as a user runs it: on spectra of all kinds, interrupted and gone on with, evaluated and rendered.

use crate::common::*;
use std::fs;
use std::path::{Path, PathBuf};

/// A tiny data set whose spectra are of a kind.
fn dataset(folder: &Path, name: &str, spectrum: &str) -> PathBuf {
    let config = tiny_config(folder, 8);
    let body = format!("{}{spectrum}\n", fs::read_to_string(&config).unwrap());
    fs::write(&config, body).unwrap();
    let out = folder.join(name);
    corf_ok(&["dataset", "generate", text(&config), "--out", text(&out)]);
    out
}

#[test]
fn beams_capons_spectra_and_lobes_go_the_whole_way() {
    let folder = tempfile::tempdir().unwrap();
    for (name, spectrum) in [
        ("beams", "spectrum = \"bartlett\""),
        ("capon", "spectrum = \"mvdr\"\nmvdr_loading = 0.05"),
        ("lobes", "lobe_width_deg = 2.0\ndiffuse = false"),
    ] {
        let data = dataset(folder.path(), name, spectrum);
        let place = |run: &str| folder.path().join(format!("{name}-{run}"));
        let common = ["reconstruct", text(&data), "--method", "corf-array", "--device", "cpu", "--checkpoint-every", "2"];
        let whole = place("whole");
        corf_ok(&[&common[..], &["--threads", "1", "--out", text(&whole)]].concat());
        let field = fs::read(whole.join("array")).unwrap();
        let left: Vec<_> = fs::read_dir(&whole).unwrap().map(|e| e.unwrap().file_name()).collect();
        assert!(!left.iter().any(|n| n.to_str().unwrap().starts_with("checkpoint")), "a finished run needs none: {left:?}");

        let broken = place("broken");
        let arguments = [&common[..], &["--threads", "2", "--out", text(&broken)]].concat();
        assert_eq!(interrupt_when(&arguments, || broken.join("checkpoint").exists()), Some(130));
        assert!(!broken.join("run.json").exists(), "an unfinished run must not look finished");
        corf_ok(&[&arguments[..], &["--resume"]].concat());
        let run: serde_json::Value = serde_json::from_slice(&fs::read(broken.join("run.json")).unwrap()).unwrap();
        assert!(run["resumed_keyframes"].as_u64().unwrap() >= 2, "keyframes came from the checkpoint");
        assert!(fs::read(broken.join("array")).unwrap() == field, "{name}: not the field of the run that was not interrupted");
        assert!(fs::read(whole.join("coupled.ply")).unwrap() == fs::read(broken.join("coupled.ply")).unwrap());

        // Looked at while it works, it is the same.
        if name == "lobes" {
            let watched = place("watched");
            corf_ok(&[&common[..], &["--evaluate-every", "2", "--out", text(&watched)]].concat());
            for file in ["array", "coupled.ply"] {
                assert!(fs::read(watched.join(file)).unwrap() == fs::read(whole.join(file)).unwrap(), "{file} differs");
            }
            let run: serde_json::Value = serde_json::from_slice(&fs::read(watched.join("run.json")).unwrap()).unwrap();
            let held_out =
                |point: &&serde_json::Value| point["held_out"]["psnr_rf_scalar"].as_f64().is_some_and(|psnr| psnr > 0.0);
            assert!(run["curve"].as_array().unwrap().iter().filter(held_out).count() >= 3, "{}", run["curve"]);
        }

        let metrics: serde_json::Value = serde_json::from_str(&corf_ok(&["evaluate", text(&whole), "--json"])).unwrap();
        let mean = |key: &str| metrics["means"][key].as_f64().unwrap();
        assert!(mean("psnr_opt") > 3.0 && mean("psnr_rf_jet") > 6.0 && mean("rmse_db") > 0.0);
        let (poses, views) = (data.join("trajectory.json"), place("views"));
        corf_ok(&["render", text(&whole), "--poses", text(&poses), "--out", text(&views), "--device", "cpu"]);
        assert!(["images/00008.png", "jet/00008.png", "db/00008.exr"].iter().all(|f| views.join(f).exists()));
    }
    // Splats are a picture of surfaces, and what a beam sees is none.
    let beams = folder.path().join("beams");
    let out = folder.path().join("refused");
    let arguments = ["reconstruct", text(&beams), "--method", "corf-array", "--set", "surface=\"splats\"", "--out", text(&out)];
    corf_refuses(&arguments, &["surface", "mpc"]);
    // A header without the settings that spectra were made with does not say Capon's loading.
    let capon = folder.path().join("capon");
    let mut header: serde_json::Value = serde_json::from_slice(&fs::read(capon.join("dataset.json")).unwrap()).unwrap();
    header["header"].as_object_mut().unwrap().remove("config").unwrap();
    fs::write(capon.join("dataset.json"), header.to_string()).unwrap();
    let arguments = ["reconstruct", text(&capon), "--method", "corf-array", "--no-verify", "--out", text(&out)];
    corf_refuses(&arguments, &["diagonal loading", "dataset.json"]);
    assert!(!out.exists());
}

#[test]
fn an_oracle_of_true_images_needs_the_data_sets_own_scene_and_says_what_it_is() {
    fn words(arguments: &[String]) -> Vec<&str> {
        arguments.iter().map(String::as_str).collect()
    }
    let folder = tempfile::tempdir().unwrap();
    let data = dataset(folder.path(), "beams", "spectrum = \"bartlett\"");
    let scene = root().join("scenes/lobby.toml");
    let reconstruct = |scene: &Path, out: &Path, more: &[&str]| {
        let key = format!("oracle_scene={:?}", text(scene));
        let common = ["reconstruct", text(&data), "--method", "corf-array", "--device", "cpu", "--set", &key, "--out", text(out)];
        [&common[..], more].concat().into_iter().map(str::to_owned).collect::<Vec<_>>()
    };
    let (run, broken) = (folder.path().join("run"), folder.path().join("broken"));
    corf_ok(&words(&reconstruct(&scene, &run, &[])));
    let metrics: serde_json::Value = serde_json::from_str(&corf_ok(&["evaluate", text(&run), "--json"])).unwrap();
    assert_eq!(metrics["uses_scene"], true, "an oracle must be owned up to");
    let arguments = reconstruct(&scene, &broken, &["--checkpoint-every", "2"]);
    assert_eq!(interrupt_when(&words(&arguments), || broken.join("checkpoint").exists()), Some(130));
    corf_ok(&words(&[&arguments[..], &["--resume".to_owned()]].concat()));
    assert!(
        fs::read(run.join("array")).unwrap() == fs::read(broken.join("array")).unwrap(),
        "not the field of the run that was not interrupted"
    );

    let refused = folder.path().join("refused");
    corf_refuses(
        &words(&reconstruct(&root().join("scenes/office.toml"), &refused, &[])),
        &["oracle_scene", "not the scene", "generated from"],
    );
    corf_refuses(&words(&reconstruct(&folder.path().join("none.toml"), &refused, &[])), &["oracle_scene", "none.toml"]);
    assert!(!refused.exists());
}

/// The data set as a capture in the plain layout, with or without `spectra.json`, imported with flags.
fn imported(data: &Path, folder: &Path, name: &str, stated: Option<&str>, flags: &[&str]) -> PathBuf {
    let (capture, out) = (folder.join(format!("{name}-capture")), folder.join(name));
    fs::create_dir_all(&capture).unwrap();
    copy_folder(&data.join("optical/images"), &capture.join("images"));
    fs::copy(data.join("trajectory.json"), capture.join("trajectory.json")).unwrap();
    // A camera is its numbers and nothing else.
    let header: serde_json::Value = serde_json::from_slice(&fs::read(data.join("dataset.json")).unwrap()).unwrap();
    fs::write(capture.join("camera.json"), header["header"]["optical_camera"].to_string()).unwrap();
    if let Some(stated) = stated {
        fs::write(capture.join("spectra.json"), stated).unwrap();
    }
    let mut trajectory: serde_json::Value = serde_json::from_slice(&fs::read(capture.join("trajectory.json")).unwrap()).unwrap();
    for (i, keyframe) in trajectory["keyframes"].as_array_mut().unwrap().iter_mut().enumerate() {
        keyframe["file"] = format!("{:05}", i + 1).into();
    }
    fs::write(capture.join("trajectory.json"), trajectory.to_string()).unwrap();
    let (spectra, depth) = (data.join("rf/spectra"), data.join("optical/depth"));
    let given =
        ["--from", "corf-folder", "--rf", text(&spectra), "--rf-camera", "90", "--depth", text(&depth), "--out", text(&out)];
    corf_ok(&[&["dataset", "import", text(&capture)], &given[..], flags].concat());
    out
}

#[test]
fn an_imported_capture_that_states_its_array_trains_as_what_it_was_recorded_from() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    let data = dataset(folder, "beams", "spectrum = \"bartlett\"");
    let quality = |data: &Path, name: &str| {
        let run = folder.join(format!("run-{name}"));
        let arguments =
            ["reconstruct", text(data), "--method", "corf-array", "--set", "light.depth.prior=\"exact\"", "--device", "cpu"];
        corf_ok(&[&arguments[..], &["--out", text(&run)]].concat());
        let metrics: serde_json::Value = serde_json::from_str(&corf_ok(&["evaluate", text(&run), "--json"])).unwrap();
        ["psnr_rf_jet", "rmse_db", "psnr_opt"].map(|key| metrics["means"][key].as_f64().unwrap())
    };
    let original = quality(&data, "original");
    let array = ["--rf-kind", "bartlett", "--rf-array", "8x8", "--rf-spacing", "0.5", "--rf-quantity", "beam-power"];
    let by_flags = imported(&data, folder, "flags", None, &array);
    let stated = r#"{ "spectrum": "bartlett", "receiver": { "rows": 8, "cols": 8, "spacing_wavelengths": 0.5 }, "quantity": "beam_power" }"#;
    let by_keys = imported(&data, folder, "keys", Some(stated), &[]);
    for (name, out, by) in [("flags", &by_flags, "--rf-array"), ("keys", &by_keys, "spectra.json: receiver.rows")] {
        let ours = quality(out, name);
        // The same numbers but for the last digits of poses.
        assert!(original.iter().zip(ours).all(|(a, b)| (a - b).abs() < 0.05), "{name}: {original:?} {ours:?}");
        let file: serde_json::Value = serde_json::from_slice(&fs::read(out.join("dataset.json")).unwrap()).unwrap();
        assert_eq!((&file["header"]["spectrum"], &file["header"]["receiver"]["cols"]), (&"bartlett".into(), &8.into()));
        assert!(file["header"]["imported"]["sensor"]["stated_by"].as_array().unwrap().contains(&by.into()), "{by}");
        assert!(file["conventions"]["spectrum"]["sensor"].as_str().unwrap().contains("8 rows x 8 columns"));
        let said = corf_ok(&["dataset", "validate", text(out)]);
        assert!(said.contains("passed") && !said.contains("lobes"), "{said}");
    }

    // Another array than that of the spectra shows in the width of their lobes, wider or narrower.
    for (elements, word) in [("16x16", "wider"), ("4x4", "narrower")] {
        let wrong = ["--rf-kind", "bartlett", "--rf-array", elements, "--rf-spacing", "0.5"];
        let out = imported(&data, folder, elements, None, &wrong);
        let output = corf(&["dataset", "validate", text(&out)]);
        let said = format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        assert!(said.contains(word) && said.contains("warning"), "{elements}: {said}");
    }
    // Without a statement the method says which flags make one; a flag that leaves the array open is refused.
    let silent = imported(&data, folder, "silent", None, &[]);
    let out = folder.join("refused");
    corf_refuses(&["reconstruct", text(&silent), "--method", "corf-array", "--out", text(&out)], &["--rf-kind", "--rf-array"]);
    let capture = folder.join("silent-capture");
    let spectra = data.join("rf/spectra");
    let common = ["dataset", "import", text(&capture), "--from", "corf-folder", "--out", text(&out)];
    let radio = ["--rf", text(&spectra), "--rf-camera", "90", "--rf-kind", "bartlett"];
    corf_refuses(&[&common[..], &radio[..]].concat(), &["--rf-array", "how many"]);
    corf_refuses(&[&common[..], &["--rf-kind", "bartlett"]].concat(), &["--rf-kind", "no spectra"]);
    assert!(!out.exists());
}
