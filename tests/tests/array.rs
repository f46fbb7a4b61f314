//! The field that knows its array, as a user runs it: on spectra of both kinds, interrupted and gone on with, evaluated and rendered.

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
fn beams_and_lobes_go_the_whole_way() {
    let folder = tempfile::tempdir().unwrap();
    for (name, spectrum) in [("beams", "spectrum = \"bartlett\""), ("lobes", "lobe_width_deg = 2.0\ndiffuse = false")] {
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
    assert!(!out.exists());
}
