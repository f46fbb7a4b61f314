//! Which keyframes train and which are evaluated, and constants compared on those that are not published.

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

#[test]
fn validation_looks_at_no_test_keyframe() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = folder.path().join("dataset");
    copy_folder(tiny_dataset(), &dataset);
    // Test keyframes 0 and 8 of 10 are not even read.
    for stem in ["00001", "00009"] {
        fs::write(dataset.join(format!("optical/images/{stem}.png")), b"").unwrap();
    }
    let run = folder.path().join("run");
    let quick = ["--set", "iterations_per_keyframe=5", "--no-verify", "--device", "cpu"];
    let all = [&["reconstruct", text(&dataset), "--out", text(&run), "--protocol", "validation"][..], &quick].concat();
    corf_ok(&all);
    let info = read(&run.join("run.json"));
    assert_eq!((info["protocol"].as_str(), info["keyframe_timings"].as_array().unwrap().len()), (Some("validation"), 7));
    let depth = &info["depth"];
    assert!(depth["all"]["share"] == 1.0 && depth["all"]["median"].as_f64().unwrap() < 0.2, "{depth}");
    let metrics: Value = serde_json::from_str(&corf_ok(&["evaluate", text(&run), "--no-verify", "--json"])).unwrap();
    assert_eq!((frames(&metrics), metrics["split"].as_str()), (vec![4], Some("validation")));
    // The run of another protocol is another run.
    let other = [&["reconstruct", text(&dataset), "--out", text(&run), "--resume"][..], &quick].concat();
    corf_refuses(&other, &["protocol"]);
}

#[test]
fn a_plan_evaluates_the_contiguous_segment_beside_the_test_keyframes() {
    let folder = tempfile::tempdir().unwrap();
    let plan = folder.path().join("plan.toml");
    let text_of = |extra: &str| {
        format!(
            "name = \"both splits\"\ndataset = '{}'\nseeds = [1]\nsegment = true\n{extra}\n[[row]]\nlabel = \"nearest\"\nmethod = \"nearest\"\n",
            text(tiny_dataset())
        )
    };
    fs::write(&plan, text_of("")).unwrap();
    let out = folder.path().join("out");
    let printed = corf_ok(&["bench", "run", text(&plan), "--out", text(&out)]);
    assert!(printed.contains("contiguous segment held out"), "{printed}");
    assert_eq!(frames(&read(&out.join("cells/nearest-seed1.json"))), [0, 8]);
    assert_eq!(frames(&read(&out.join("segment/cells/nearest-seed1.json"))), [5]);
    assert!(fs::read_to_string(out.join("segment/table.md")).unwrap().contains("contiguous segment"));
    fs::write(&plan, text_of("protocol = \"validation\"")).unwrap();
    corf_refuses(&["bench", "run", text(&plan), "--out", text(&out), "--resume"], &["segment", "test"]);
}

#[test]
fn a_sweep_compares_changes_on_validation_keyframes_of_every_dataset() {
    let folder = tempfile::tempdir().unwrap();
    copy_folder(tiny_dataset(), &folder.path().join("one"));
    copy_folder(tiny_dataset(), &folder.path().join("two"));
    let sweep = folder.path().join("sweep.toml");
    let text_of = |key: &str, second: &str| {
        format!(
            "name = \"tiny\"\ndatasets = [\"one\", \"{second}\"]\nseeds = [1, 2]\nmethod = \"corf-gs\"\n[base]\niterations_per_keyframe = 4\n\
             [[vary]]\nkey = \"{key}\"\nvalues = [0.9]\n[[change]]\nlabel = \"lookup\"\nmethod = \"nearest\"\nconfig = {{}}\n"
        )
    };
    let out = folder.path().join("out");
    let run = |resume: bool| {
        let mut args = vec!["bench", "sweep", text(&sweep), "--out", text(&out), "--device", "cpu"];
        args.extend(resume.then_some("--resume"));
        args.into_iter().map(str::to_owned).collect::<Vec<_>>()
    };
    let refused = |words: &[&str]| corf_refuses(&run(false).iter().map(String::as_str).collect::<Vec<_>>(), words);
    fs::write(&sweep, text_of("latest_probabilty", "two")).unwrap();
    refused(&["latest_probabilty"]);
    fs::write(&sweep, text_of("latest_probability", "../one/one")).unwrap();
    refused(&["named one"]);
    // A lookup has no iterations: what a base sets has to be a key of every method it is given to.
    fs::write(&sweep, text_of("latest_probability", "two")).unwrap();
    refused(&["iterations_per_keyframe"]);
    fs::write(&sweep, text_of("latest_probability", "two").replace("\"nearest\"", "\"corf-gs-uniform\"")).unwrap();
    let printed = corf_ok(&run(false).iter().map(String::as_str).collect::<Vec<_>>());
    assert!(printed.contains("latest\\_probability = 0.9") || printed.contains("latest_probability = 0.9"), "{printed}");
    let record = read(&out.join("two/cells/base-seed2.json"));
    assert_eq!((frames(&record), record["split"].as_str()), (vec![4], Some("validation")));
    let table = fs::read_to_string(out.join("sweep.md")).unwrap();
    assert!(table.contains("| lookup |") && table.contains("× "), "{table}");
    corf_ok(&run(true).iter().map(String::as_str).collect::<Vec<_>>());
    assert_eq!(fs::read_to_string(out.join("sweep.md")).unwrap(), table, "nothing was run again");
}
