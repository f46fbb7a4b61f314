//! LPIPS as columns: where weights are given, where they are not, and where they are none.

use crate::common::*;
use std::fs;
use std::path::Path;

/// Columns of a plan that asks for LPIPS.
const COLUMNS: &str = "columns = ['short', 'lpips_alex_opt', 'lpips_alex_01_opt', 'lpips_alex_rf_jet', 'lpips_alex_01_rf_jet']";

/// A plan of one lookup with two seeds.
fn plan(folder: &Path, columns: &str) -> std::path::PathBuf {
    let path = folder.join("plan.toml");
    let row = "[[row]]\nlabel = \"nearest\"\nmethod = \"nearest\"\n";
    fs::write(&path, format!("name = \"lookup\"\ndataset = {:?}\nseeds = [1, 2]\n{columns}\n{row}", text(tiny_dataset())))
        .unwrap();
    path
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn weights_add_columns_and_the_record_says_which() {
    let Some(weights) = shared("weights/lpips") else { return };
    let folder = tempfile::tempdir().unwrap();
    let (plan, out) = (plan(folder.path(), COLUMNS), folder.path().join("out"));
    let run = ["bench", "run", text(&plan), "--out", text(&out)];
    let with_weights = [&run[..], &["--lpips", text(&weights)]].concat();
    let said = corf_ok(&with_weights);
    // The columns that the plan asks for, both inputs, by name.
    for heading in
        ["LPIPS-Alex [-1,1] opt ↓", "LPIPS-Alex [0,1] opt ↓", "LPIPS-Alex [-1,1] rf (Jet) ↓", "LPIPS-Alex [0,1] rf (Jet) ↓"]
    {
        assert!(said.contains(heading), "{heading}: {said}");
    }
    assert!(!said.contains("LPIPS-Squeeze") && !said.contains("not computed"), "{said}");
    let record: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(out.join("cells/nearest-seed1.json")).unwrap()).unwrap();
    let means = |key: &str| record["means"][key].as_f64().unwrap();
    for backbone in ["alex", "squeeze"] {
        let sha256 = record["lpips_weights"][backbone].as_str().unwrap();
        let file = fs::read(weights.join(format!("lpips_{backbone}.safetensors"))).unwrap();
        assert_eq!(sha256, corf_scene::io::sha256_hex(&file));
        for image in ["opt", "rf_jet"] {
            let (signed, unit) = (format!("lpips_{backbone}_{image}"), format!("lpips_{backbone}_01_{image}"));
            for key in [&signed, &unit] {
                let frames: Vec<f64> =
                    record["frames"].as_array().unwrap().iter().map(|f| f["lpips"][key].as_f64().unwrap()).collect();
                assert!(frames.iter().all(|v| (0.01..2.0).contains(v)), "{key}: {frames:?}");
                assert!((frames.iter().sum::<f64>() / frames.len() as f64 - means(key)).abs() < 1e-12);
            }
            assert_ne!(means(&signed), means(&unit));
        }
    }
    let csv = fs::read_to_string(out.join("table.csv")).unwrap();
    assert!(csv.lines().next().unwrap().contains("lpips_squeeze_01_rf_jet"), "{csv}");
    let report = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(report.contains("LPIPS-Squeeze [0,1] rf (Jet) ↓") && report.contains("LPIPS weights"));
    // What is there is gone on with under the same weights alone.
    assert_eq!(corf_ok(&[&with_weights[..], &["--resume"]].concat()), said);
    corf_refuses(&[&run[..], &["--resume"]].concat(), &["weights of LPIPS", "--lpips", "nearest-seed1.json"]);
}

#[test]
fn without_weights_it_is_said_and_nothing_else_changes() {
    let folder = tempfile::tempdir().unwrap();
    let (plan, out) = (plan(folder.path(), ""), folder.path().join("out"));
    let output = corf(&["bench", "run", text(&plan), "--out", text(&out)]);
    assert_eq!(output.status.code(), Some(0));
    assert!(String::from_utf8_lossy(&output.stderr).contains("LPIPS is not computed: no weights were given"));
    let record = fs::read_to_string(out.join("cells/nearest-seed1.json")).unwrap();
    assert!(!record.contains("lpips"), "{record}");
    for file in ["table.md", "table.csv", "table.tex"] {
        assert!(!fs::read_to_string(out.join(file)).unwrap().to_lowercase().contains("lpips"), "{file}");
    }
    assert!(fs::read_to_string(out.join("report.html")).unwrap().contains("LPIPS not computed: no weights were given"));
    // A table that asks for it has the column, empty, and the reason.
    let document = folder.path().join("page.md");
    fs::write(&document, "<!-- corf docs: table out psnr_opt,lpips_vgg_01_rf_jet -->\n<!-- corf docs: end -->\n").unwrap();
    corf_ok(&["docs", text(&document)]);
    let page = fs::read_to_string(&document).unwrap();
    assert!(page.contains("| LPIPS-VGG [0,1] rf (Jet) ↓ |") && page.contains(" | – | – |"), "{page}");
    assert!(page.contains("LPIPS not computed, for no weights were given") && page.contains(": nearest."), "{page}");
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn folders_without_weights_are_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let (plan, out) = (plan(folder.path(), ""), folder.path().join("out"));
    let weights = folder.path().join("weights");
    fs::create_dir(&weights).unwrap();
    let refused = |words: &[&str]| {
        corf_refuses(&["bench", "run", text(&plan), "--out", text(&out), "--lpips", text(&weights)], words);
        assert!(!out.exists());
    };
    refused(&["weights", "lpips_vgg.safetensors", "fetch_weights.py"]);
    fs::write(weights.join("lpips_squeeze.safetensors"), "no tensors").unwrap();
    refused(&["lpips_squeeze.safetensors", "not a readable safetensors file", "fetch_weights.py"]);
    // Found before a run is even looked for.
    corf_refuses(&["evaluate", "nowhere", "--lpips", text(&weights)], &["lpips_squeeze.safetensors"]);
    let Some(good) = shared("weights/lpips/lpips_squeeze.safetensors") else { return };
    let whole = fs::read(good).unwrap();
    fs::write(weights.join("lpips_squeeze.safetensors"), &whole[..whole.len() / 2]).unwrap();
    refused(&["cut short"]);
}
