//! Splits that do not leak: blocks that are held out in folds, and data sets thinned until copying fails.

use crate::common::*;
use serde_json::Value;
use std::fs;

/// Trajectory indices of a record's frames.
fn frames(record: &Value) -> Vec<u64> {
    record["frames"].as_array().unwrap().iter().map(|f| f["index"].as_u64().unwrap()).collect()
}

fn read(path: &std::path::Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

/// A plan of both lookups and a quick field on the tiny lobby.
fn plan_of(protocol: &str, seeds: &str) -> String {
    format!(
        "name = \"blocks\"\ndataset = '{}'\nprotocol = \"{protocol}\"\nseeds = {seeds}\n[[row]]\nlabel = \"field\"\nmethod = \"corf-gs\"\n\
         config = {{ iterations_per_keyframe = 3 }}\n[[row]]\nlabel = \"nearest\"\nmethod = \"nearest\"\n",
        text(tiny_dataset())
    )
}

#[test]
fn blocks_are_held_out_in_folds_and_the_table_is_over_all_of_them() {
    let folder = tempfile::tempdir().unwrap();
    let (plan, out) = (folder.path().join("plan.toml"), folder.path().join("out"));
    fs::write(&plan, plan_of("trajectory:parts=5,gap_keyframes=1", "[1]")).unwrap();
    let run = |more: &[&str]| corf_ok(&[&["bench", "run", text(&plan), "--out", text(&out), "--device", "cpu"], more].concat());
    run(&[]);
    let mut held_out = Vec::new();
    for fold in 1..=5 {
        let record = read(&out.join(format!("cells/nearest-seed1-fold{fold}.json")));
        assert_eq!(record["split"].as_str(), Some(format!("trajectory:parts=5,gap_keyframes=1,fold={fold}").as_str()));
        held_out.extend(frames(&record));
    }
    assert_eq!(held_out, (0..10).collect::<Vec<_>>());
    let table = fs::read_to_string(out.join("table.md")).unwrap();
    assert_eq!(table.lines().filter(|line| line.starts_with("| nearest |")).count(), 1, "{table}");
    assert!(table.contains("5 contiguous segments") && table.contains("n = 10 held-out keyframes in 5 folds."), "{table}");
    let csv = fs::read_to_string(out.join("table.csv")).unwrap();
    assert!(csv.lines().count() == 11 && csv.contains("fold=4"), "{csv}");
    // What is packed says the same.
    let packed = folder.path().join("packed");
    corf_ok(&["bench", "pack", text(&out), "--out", text(&packed)]);
    let rows = |text: String| text.lines().filter(|line| line.starts_with('|')).map(str::to_owned).collect::<Vec<_>>();
    assert_eq!(rows(corf_ok(&["bench", "table", text(&packed)])), rows(table));
    // A fold that is lost is run again, and without it there is no mean.
    fs::remove_file(out.join("cells/nearest-seed1-fold2.json")).unwrap();
    corf_refuses(&["bench", "table", text(&out)], &["nearest-seed1-fold2.json is missing", "--resume"]);
    run(&["--resume"]);
    // The same cells, one by one.
    let apart = folder.path().join("apart");
    let listed: Value = serde_json::from_str(&corf_ok(&["bench", "plan", text(&plan), "--out", text(&apart), "--json"])).unwrap();
    assert_eq!(listed["cells"].as_array().unwrap().len(), 10);
    let id =
        listed["cells"].as_array().unwrap().iter().find(|c| c["row"] == "nearest").unwrap()["id"].as_str().unwrap().to_owned();
    corf_ok(&["bench", "cell", text(&apart), &id]);
    let collected = corf(&["bench", "collect", text(&apart)]);
    assert_eq!(collected.status.code(), Some(1), "cells are missing");
    let table = fs::read_to_string(apart.join("table.md")).unwrap();
    assert!(table.contains("FAILED: nearest, seed 1: fold 2: no record of cell"), "{table}");
}

#[test]
fn a_run_is_of_one_fold_and_its_gap_is_kept() {
    let folder = tempfile::tempdir().unwrap();
    let run = folder.path().join("run");
    let reconstruct = |protocol: &str| {
        ["reconstruct", text(tiny_dataset()), "--out", text(&run), "--method", "nearest", "--protocol", protocol]
            .map(str::to_owned)
    };
    let words = |args: [String; 8]| args.to_vec();
    let refused = |protocol: &str, said: &[&str]| {
        let args = words(reconstruct(protocol));
        corf_refuses(&args.iter().map(String::as_str).collect::<Vec<_>>(), said);
    };
    refused("along-y:parts=2", &["needs a gap", "help"]);
    refused("along-y:parts=2,gap_m=0.1", &["fold=1"]);
    refused("along-y:parts=2,gap_m=50,fold=1", &["smaller gap"]);
    let args = words(reconstruct("k-means:parts=3,gap_m=0.05,fold=2"));
    corf_ok(&args.iter().map(String::as_str).collect::<Vec<_>>());
    let record: Value = serde_json::from_str(&corf_ok(&["evaluate", text(&run), "--json"])).unwrap();
    assert_eq!(record["split"], "k-means:parts=3,gap_m=0.05,seed=0,fold=2");
    assert!((1..9).contains(&frames(&record).len()));
}

#[test]
fn density_says_where_a_field_overtakes_copying() {
    let folder = tempfile::tempdir().unwrap();
    let (plan, out) = (folder.path().join("plan.toml"), folder.path().join("out"));
    fs::write(&plan, plan_of("test", "[1, 2, 3]")).unwrap();
    let density = |more: &[&'static str]| {
        [&["bench", "density", text(&plan), "--out", text(&out), "--device", "cpu", "--spacing", "1,2"], more].concat()
    };
    let printed = corf_ok(&density(&[]));
    assert!(printed.contains("field") && printed.contains("against copying"), "{printed}");
    let results = read(&out.join("density.json"));
    let steps = results["steps"].as_array().unwrap();
    let trained: Vec<f64> = steps.iter().map(|s| s["train_keyframes"].as_f64().unwrap()).collect();
    assert_eq!(trained, [8.0, 5.0]);
    let distances: Vec<f64> = steps.iter().map(|s| s["nearest_training_m"].as_f64().unwrap()).collect();
    assert!(
        distances[0] > 0.0 && distances[1] == distances[0],
        "odd keyframes are left, neighbours of the even ones: {distances:?}"
    );
    // Held-out keyframes are those of the plan, whatever trains.
    for spacing in ["spacing-1", "spacing-2"] {
        assert_eq!(frames(&read(&out.join(spacing).join("cells/nearest-seed1.json"))), [0, 8]);
    }
    assert!(fs::read_to_string(out.join("density.svg")).unwrap().contains("nearest training pose"));
    assert_eq!(fs::read_to_string(out.join("density.csv")).unwrap().lines().count(), 1 + 2 * 2 * 2 * 3);
    let again = corf_ok(&density(&["--resume"]));
    assert_eq!(again, printed);
    fs::write(&plan, plan_of("test", "[1]").split("[[row]]\nlabel = \"nearest\"").next().unwrap()).unwrap();
    corf_refuses(&density(&["--resume"]), &["nearest or inverse-distance"]);
}

#[test]
fn a_spacing_moves_training_keyframes_away_and_stands_in_the_record() {
    let folder = tempfile::tempdir().unwrap();
    let (plan, out) = (folder.path().join("plan.toml"), folder.path().join("out"));
    let lookups = |protocol: &str| {
        let text = format!(
            "name = \"spacing\"\ndataset = '{}'\nprotocol = \"{protocol}\"\nseeds = [1]\n[[row]]\nlabel = \"nearest\"\nmethod = \"nearest\"\n",
            text(tiny_dataset())
        );
        fs::write(&plan, text).unwrap();
    };
    let run = |out: &str| corf_ok(&["bench", "run", text(&plan), "--out", out, "--device", "cpu"]);
    let record = |protocol: &str, name: &str| {
        lookups(protocol);
        let out = out.join(name);
        run(text(&out));
        read(&out.join("cells/nearest-seed1.json"))
    };
    let (all, few) = (record("test", "all"), record("test:spacing=4", "few"));
    assert_eq!((few["split"].as_str(), frames(&few)), (Some("test:spacing=4"), frames(&all)));
    let psnr = |record: &Value| record["means"]["psnr_rf_scalar"].as_f64().unwrap();
    assert_ne!(psnr(&few), psnr(&all), "the neighbours of held-out keyframes are gone");
    lookups("test:every=4");
    corf_refuses(&["bench", "run", text(&plan), "--out", text(&out.join("refused"))], &["no key every"]);
}
