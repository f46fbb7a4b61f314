//! From a glTF lobby to a table: every command once, in the order a researcher would use them.

use crate::common::*;
use std::fs;

#[test]
fn lobby_to_keyframes_to_field_to_table() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = text(tiny_dataset());
    assert!(corf_ok(&["dataset", "validate", dataset]).contains("passed"));

    let run = folder.path().join("run");
    corf_ok(&["reconstruct", dataset, "--out", text(&run), "--set", "iterations_per_keyframe=40"]);
    for file in ["run.json", "config.json", "coupled.ply", "optical.ply", "rf.ply"] {
        assert!(run.join(file).exists(), "{file}");
    }

    let metrics: serde_json::Value = serde_json::from_str(&corf_ok(&["evaluate", text(&run), "--json"])).unwrap();
    assert_eq!(metrics["status"], "done");
    assert!(metrics["uses_ground_truth_depth"].as_bool().unwrap(), "the simulated prior must be owned up to");
    assert_eq!(metrics["frames"].as_array().unwrap().len(), 2, "keyframes 0 and 8 of 10 are held out");
    assert!(metrics["means"]["psnr_rf_jet"].as_f64().unwrap() > 8.0);
    assert!(run.join("metrics.json").exists());
    for figure in ["beam.svg", "rate.svg", "outage.svg"] {
        let svg = fs::read_to_string(run.join(figure)).unwrap();
        assert!(svg.contains("<svg") && svg.contains("corf-gs"), "{figure}");
    }

    let views = folder.path().join("views");
    let poses = tiny_dataset().join("trajectory.json");
    corf_ok(&["render", text(&run), "--poses", text(&poses), "--out", text(&views)]);
    for file in ["images/00010.png", "jet/00010.png", "db/00010.exr", "linear/00010.exr", "depth/00010.exr"] {
        assert!(views.join(file).exists(), "{file}");
    }

    let plan = folder.path().join("plan.toml");
    let row = |label: &str, method: &str| format!("[[row]]\nlabel = \"{label}\"\nmethod = \"{method}\"\n");
    let rows = row("nearest", "nearest") + &row("blend", "inverse-distance");
    fs::write(&plan, format!("name = \"lookups\"\ndataset = {dataset:?}\nseeds = [1, 2]\n{rows}")).unwrap();
    let out = folder.path().join("bench");
    corf_ok(&["bench", "run", text(&plan), "--out", text(&out)]);
    let report = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(report.contains("<svg") && report.contains("data:image/png;base64,") && !report.contains("http://localhost"));
    let latex = corf_ok(&["bench", "table", text(&out), "--format", "latex"]);
    assert!(latex.contains("\\toprule") && latex.contains("blend"));
    corf_ok(&["bench", "report", text(&out)]);
}

#[test]
fn the_committed_lobby_is_what_the_builder_builds() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lobby.glb");
    corf_ok(&["scene", "build", "lobby", "--out", text(&path)]);
    assert!(fs::read(&path).unwrap() == fs::read(root().join("scenes/lobby.glb")).unwrap());
    assert!(corf_ok(&["scene", "validate", "scenes/lobby.toml"]).contains("passed"));
    let info: serde_json::Value = serde_json::from_str(&corf_ok(&["scene", "info", "scenes/lobby.toml", "--json"])).unwrap();
    assert!(info.is_object());
}

#[test]
fn paths_are_printed_with_the_reference_librarys_names() {
    let json: serde_json::Value =
        serde_json::from_str(&corf_ok(&["paths", "scenes/lobby.toml", "--rx", "7,4,1.6", "--depth", "1"])).unwrap();
    let text = json.to_string();
    for name in ["tau", "theta_r", "phi_r", "theta_t", "phi_t", "vertices"] {
        assert!(text.contains(name), "{name}");
    }
}
