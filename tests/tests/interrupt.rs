//! Ctrl-C in the middle of every long command, then `--resume`: nothing is lost, nothing is half-written, the result is the same.

use crate::common::*;
use std::fs;
use std::path::Path;

fn files(folder: &Path) -> usize {
    fs::read_dir(folder).map_or(0, Iterator::count)
}

#[test]
fn dataset_generation_resumes_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let config = tiny_config(folder.path(), 8);
    let (whole, broken) = (folder.path().join("whole"), folder.path().join("broken"));
    corf_ok(&["dataset", "generate", text(&config), "--out", text(&whole)]);
    let arguments = ["dataset", "generate", text(&config), "--out", text(&broken)];
    let spectra = broken.join("rf/spectra");
    assert_eq!(interrupt_when(&arguments, || files(&spectra) >= 2), Some(130));
    assert!(!broken.join("dataset.json").exists(), "an unfinished dataset must not look finished");
    corf_ok(&[&arguments[..], &["--resume"]].concat());
    assert!(fs::read(whole.join("dataset.json")).unwrap() == fs::read(broken.join("dataset.json")).unwrap());
    corf_ok(&["dataset", "validate", text(&broken)]);
}

#[test]
fn reconstruction_resumes_to_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, broken) = (folder.path().join("whole"), folder.path().join("broken"));
    let dataset = text(tiny_dataset());
    let arguments = |out: &'static str| ["reconstruct", dataset, "--seed", "2", "--method", "corf-gs-frozen", "--out", out];
    let (whole_out, broken_out) = (text(&whole).to_owned(), text(&broken).to_owned());
    corf_ok(&arguments(Box::leak(whole_out.into_boxed_str())));
    let arguments = arguments(Box::leak(broken_out.into_boxed_str()));
    let code = interrupt_when(&arguments, || broken.join("config.json").exists());
    assert_eq!(code, Some(130));
    assert!(!broken.join("run.json").exists(), "an unfinished run must not look finished");
    corf_ok(&[&arguments[..], &["--resume"]].concat());
    assert!(fs::read(whole.join("coupled.ply")).unwrap() == fs::read(broken.join("coupled.ply")).unwrap());
}

#[test]
fn a_reconstruction_resumes_behind_its_checkpoint() {
    let folder = tempfile::tempdir().unwrap();
    let (whole, broken) = (folder.path().join("whole"), folder.path().join("broken"));
    let common =
        ["reconstruct", text(tiny_dataset()), "--seed", "4", "--device", "cpu", "--checkpoint-every", "2", "--fine-tune", "1"];
    corf_ok(&[&common[..], &["--out", text(&whole)]].concat());
    assert!(!whole.join("checkpoint").exists(), "a finished run needs none");
    let arguments = [&common[..], &["--out", text(&broken)]].concat();
    assert_eq!(interrupt_when(&arguments, || broken.join("checkpoint").exists()), Some(130));
    assert!(!broken.join("run.json").exists(), "an unfinished run must not look finished");
    // Another configuration is not what was interrupted.
    corf_refuses(&[&arguments[..], &["--resume", "--set", "rf_weight=0.2"]].concat(), &["checkpoint", "configuration"]);
    corf_ok(&[&arguments[..], &["--resume"]].concat());
    assert!(fs::read(whole.join("coupled.ply")).unwrap() == fs::read(broken.join("coupled.ply")).unwrap());
    let run: serde_json::Value = serde_json::from_slice(&fs::read(broken.join("run.json")).unwrap()).unwrap();
    let resumed = run["resumed_keyframes"].as_u64().unwrap();
    assert!(resumed >= 2, "{resumed} keyframes came from the checkpoint");
    let timings = run["keyframe_timings"].as_array().unwrap().len() as u64;
    assert_eq!(run["latency"]["keyframes"].as_u64(), Some(timings));
}

#[test]
fn a_comparison_resumes_behind_its_last_finished_cell() {
    let folder = tempfile::tempdir().unwrap();
    let plan = folder.path().join("plan.toml");
    let rows = "[[row]]\nlabel = \"nearest\"\nmethod = \"nearest\"\n[[row]]\nlabel = \"full\"\nmethod = \"corf-gs\"\n";
    // More than one seed: a cell takes half a second, and what interrupts may be that late on a busy machine.
    fs::write(&plan, format!("name = \"t\"\ndataset = {:?}\nseeds = [1, 2, 3]\n{rows}", tiny_dataset())).unwrap();
    let out = folder.path().join("out");
    let arguments = ["bench", "run", text(&plan), "--out", text(&out)];
    let first = out.join("cells/nearest-seed1.json");
    assert_eq!(interrupt_when(&arguments, || first.exists()), Some(130));
    let before = fs::metadata(&first).unwrap().modified().unwrap();
    assert!(!out.join("table.md").exists());
    corf_ok(&[&arguments[..], &["--resume"]].concat());
    assert_eq!(fs::metadata(&first).unwrap().modified().unwrap(), before, "a finished cell was run again");
    assert!(out.join("report.html").exists() && out.join("table.tex").exists());
}
