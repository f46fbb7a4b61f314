//! The baselines from the command line: to a field, its metrics and its renders; interrupted and resumed; what their names promise.

use crate::common::*;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// A short RF-3DGS: all kinds of density control, both stages.
const SHORT: [&str; 9] = [
    "--device",
    "cpu",
    "--set",
    "optical_steps=160",
    "--set",
    "rf_steps=60",
    "--set",
    "density={ from = 40, every = 20, reset_every = 90, until = 140 }",
    "--seed=3",
];

fn rf_3dgs(method: &str, out: &Path, extra: &[&str]) -> Vec<String> {
    let mut all = vec!["reconstruct", text(tiny_dataset()), "--out", text(out), "--method", method];
    all.extend(SHORT);
    all.extend(extra);
    all.into_iter().map(str::to_owned).collect()
}

fn run(method: &str, out: &Path, extra: &[&str]) -> serde_json::Value {
    let arguments = rf_3dgs(method, out, extra);
    corf_ok(&arguments.iter().map(String::as_str).collect::<Vec<_>>());
    serde_json::from_slice(&fs::read(out.join("run.json")).unwrap()).unwrap()
}

fn bytes(run: &Path, file: &str) -> Vec<u8> {
    fs::read(run.join(file)).unwrap()
}

#[test]
fn both_rows_reconstruct_evaluate_and_render_and_differ_in_radio_alone() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| -> PathBuf { folder.path().join(name) };
    let info = run("rf-3dgs", &place("published"), &["--threads", "1"]);
    let stages: Vec<&str> = info["stages"].as_array().unwrap().iter().map(|s| s["name"].as_str().unwrap()).collect();
    assert_eq!(stages, ["points", "optical", "rf"]);
    assert!(info["stages"].as_array().unwrap().iter().all(|s| s["seconds"].as_f64().unwrap() > 0.0));
    assert_eq!(info["config"]["rf_background"], "black");
    run("rf-3dgs-corrected", &place("corrected"), &["--threads", "2"]);
    // On one thread and on two: the same seed, the same bytes, as far as the rows are one.
    for file in ["optical.ply", "initial_points.ply"] {
        assert!(bytes(&place("published"), file) == bytes(&place("corrected"), file), "{file}");
    }
    assert!(bytes(&place("published"), "rf.ply") != bytes(&place("corrected"), "rf.ply"));
    run("rf-3dgs", &place("begun"), &["--set", "optical_steps=2", "--set", "rf_steps=1"]);
    let [begun, published, corrected] = ["begun", "published", "corrected"].map(|name| -> serde_json::Value {
        serde_json::from_str(&corf_ok(&["evaluate", text(&place(name)), "--device", "cpu", "--json"])).unwrap()
    });
    let psnr = |metrics: &serde_json::Value, key: &str| metrics["means"][key].as_f64().unwrap();
    for metrics in [&published, &corrected] {
        assert_eq!(metrics["status"], "done");
        assert_eq!(metrics["uses_ground_truth_depth"], false, "points are triangulated");
        // So short a run is far from good, but it has moved; that the stages learn is tested where they are (`corf_baselines::rf_3dgs`).
        for (key, least_db) in [("psnr_opt", 0.02), ("psnr_rf_jet", 0.1)] {
            let change_db = (psnr(metrics, key) - psnr(&begun, key)).abs();
            assert!(change_db > least_db, "{key}: {}, {}", metrics["means"], begun["means"]);
        }
    }
    assert_eq!(psnr(&published, "psnr_opt"), psnr(&corrected, "psnr_opt"));
    let views = folder.path().join("views");
    let poses = tiny_dataset().join("trajectory.json");
    corf_ok(&["render", text(&place("published")), "--poses", text(&poses), "--out", text(&views), "--device", "cpu"]);
    assert!(views.join("jet/00010.png").exists() && views.join("images/00010.png").exists());
}

#[test]
fn an_interrupted_rf_3dgs_resumes_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, broken) = (folder.path().join("whole"), folder.path().join("broken"));
    run("rf-3dgs", &whole, &[]);
    assert!(!whole.join("checkpoint").exists(), "a finished run needs none");
    let arguments = rf_3dgs("rf-3dgs", &broken, &["--checkpoint-every", "15"]);
    let arguments: Vec<&str> = arguments.iter().map(String::as_str).collect();
    let mut child = start(&arguments);
    let begin = Instant::now();
    while !broken.join("checkpoint").exists() {
        assert!(
            child.try_wait().unwrap().is_none() && begin.elapsed() < Duration::from_secs(120),
            "it has not come to a checkpoint"
        );
        std::thread::sleep(Duration::from_millis(2));
    }
    std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert_eq!(child.wait().unwrap().code(), Some(130));
    assert!(!broken.join("run.json").exists(), "an unfinished run must not look finished");
    let resume = |more: &[&'static str]| [&arguments[..], &["--resume"], more].concat();
    corf_refuses(&resume(&["--set", "rates.sh_dc=1e-3"]), &["checkpoint", "configuration"]);
    corf_ok(&resume(&[]));
    for file in ["coupled.ply", "initial_points.ply", "field.json"] {
        assert!(bytes(&whole, file) == bytes(&broken, file), "{file}");
    }
    let info: serde_json::Value = serde_json::from_slice(&bytes(&broken, "run.json")).unwrap();
    assert!(info["resumed_steps"].as_u64().unwrap() >= 15);
}

#[test]
fn what_the_name_sets_and_what_is_out_of_range_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let refuses = |set: &str, words: &[&str]| {
        let out = folder.path().join("refused");
        corf_refuses(&["reconstruct", text(tiny_dataset()), "--out", text(&out), "--method", "rf-3dgs", "--set", set], words);
        assert!(!out.exists(), "nothing is written before");
    };
    refuses("rf_background=\"floor\"", &["rf_background", "rf-3dgs-corrected"]);
    refuses("optical_steps=0", &["`optical_steps`", "help"]);
    refuses("density.graident=1e-4", &["graident"]);
}
