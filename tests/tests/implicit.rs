//! The baselines of the spectrum alone, NeRF² and WRF-GS+, as a user runs them: trained, evaluated, rendered, compared, interrupted and resumed.

use crate::common::*;
use std::fs;
use std::time::{Duration, Instant};

/// A network that trains in a second.
const TINY: [&str; 10] =
    ["--set", "rays=64", "--set", "samples=8", "--set", "width=16", "--set", "frequencies=4", "--set", "iterations=40"];

#[test]
fn a_field_of_spectra_alone_goes_the_whole_way() {
    let folder = tempfile::tempdir().unwrap();
    let (dataset, run) = (text(tiny_dataset()), folder.path().join("run"));
    let common = ["reconstruct", dataset, "--method", "nerf2-corrected", "--device", "cpu"];
    corf_ok(&[&common[..], &TINY, &["--out", text(&run)]].concat());
    let metrics: serde_json::Value = serde_json::from_str(&corf_ok(&["evaluate", text(&run), "--json"])).unwrap();
    let means = metrics["means"].as_object().unwrap();
    assert!(means["psnr_rf_jet"].as_f64().unwrap() > 5.0 && means["rmse_db"].as_f64().unwrap() > 0.0);
    assert!(!means.contains_key("psnr_opt") && !means.contains_key("ssim_opt"), "it predicts no image");

    let views = folder.path().join("views");
    let poses = tiny_dataset().join("trajectory.json");
    let arguments = ["render", text(&run), "--poses", text(&poses), "--out", text(&views), "--device", "cpu"];
    corf_ok(&arguments);
    assert!(views.join("jet/00010.png").exists() && views.join("db/00010.exr").exists());
    assert!(!views.join("images/00010.png").exists() && !views.join("depth/00010.exr").exists());
    let written = || fs::metadata(views.join("db/00010.exr")).unwrap().modified().unwrap();
    let before = written();
    corf_ok(&[&arguments[..], &["--resume"]].concat());
    assert_eq!(written(), before, "a finished pose was rendered again");

    let plan = folder.path().join("plan.toml");
    let settings = "rays = 64\nsamples = 8\nwidth = 16\nfrequencies = 4\niterations = 20\n";
    let rows = format!(
        "[[row]]\nlabel = \"nearest\"\nmethod = \"nearest\"\n[[row]]\nlabel = \"implicit\"\nmethod = \"nerf2\"\n[row.config]\n{settings}"
    );
    fs::write(&plan, format!("name = \"t\"\ndataset = {dataset:?}\nseeds = [1, 2]\n{rows}")).unwrap();
    let out = folder.path().join("bench");
    corf_ok(&["bench", "run", text(&plan), "--out", text(&out), "--device", "cpu"]);
    let table = fs::read_to_string(out.join("table.md")).unwrap();
    let cells = |line: &str| line.split('|').map(|cell| cell.trim().to_owned()).collect::<Vec<_>>();
    let headings = cells(table.lines().find(|l| l.starts_with("| method")).unwrap());
    let row = cells(table.lines().find(|l| l.starts_with("| implicit")).unwrap());
    let under = |heading: &str| row[headings.iter().position(|h| h.starts_with(heading)).unwrap()].as_str();
    assert_eq!((under("PSNR opt"), under("SSIM opt")), ("–", "–"), "{table}");
    assert!(under("PSNR rf (dB)") != "–" && under("PSNR rf (Jet)") != "–", "{table}");
    let report = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(report.contains("spectrum, predicted"), "the report shows what there is");
}

/// A field of few Gaussians and a small network, with all kinds of density control.
const TINY_WRF: [&str; 12] = [
    "--set",
    "random_points=600",
    "--set",
    "width=16",
    "--set",
    "layers=3",
    "--set",
    "skip=1",
    "--set",
    "iterations=60",
    "--set",
    // So few Gaussians are wider than the 0.2 m that the published size leaves.
    "density={ from = 10, every = 10, reset_every = 35, until = 50, prune_fraction = 5.0 }",
];

#[test]
fn deformed_gaussians_go_the_whole_way() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| folder.path().join(name);
    let run = |method: &str, out: &str, threads: &str| {
        let arguments = ["reconstruct", text(tiny_dataset()), "--method", method, "--device", "cpu", "--threads", threads];
        corf_ok(&[&arguments[..], &TINY_WRF, &["--out", text(&place(out))]].concat());
        fs::read(place(out).join("wrf-gs-plus")).unwrap()
    };
    let published = run("wrf-gs-plus", "published", "1");
    assert!(run("wrf-gs-plus", "again", "2") == published, "the same bytes on any number of threads");
    assert!(run("wrf-gs-plus-corrected", "corrected", "2") != published);
    for name in ["published", "corrected"] {
        let metrics: serde_json::Value = serde_json::from_str(&corf_ok(&["evaluate", text(&place(name)), "--json"])).unwrap();
        let means = metrics["means"].as_object().unwrap();
        assert!(means["psnr_rf_jet"].as_f64().unwrap() > 5.0 && means["rmse_db"].as_f64().unwrap() > 0.0);
        assert!(!means.contains_key("psnr_opt"), "it predicts no image");
        assert_eq!(metrics["uses_ground_truth_depth"], false);
    }
    let info: serde_json::Value = serde_json::from_slice(&fs::read(place("corrected").join("run.json")).unwrap()).unwrap();
    assert_eq!(info["config"]["move_positions"], true);
    assert!(info["gaussians"].as_u64().unwrap() > 16, "{info}");
    let (views, poses) = (place("views"), tiny_dataset().join("trajectory.json"));
    corf_ok(&["render", text(&place("published")), "--poses", text(&poses), "--out", text(&views), "--device", "cpu"]);
    assert!(views.join("jet/00010.png").exists() && !views.join("images/00010.png").exists());
    let mut damaged = published;
    damaged[200] ^= 1;
    fs::write(place("published").join("wrf-gs-plus"), damaged).unwrap();
    corf_refuses(&["evaluate", text(&place("published"))], &["wrf-gs-plus", "damaged"]);
}

/// Interrupts a training with a checkpoint behind it, has it resumed, and holds `file` of its run against that of one that was left alone; `setting`
/// changes its configuration.
fn resumes_to_the_same_bytes(method: &str, settings: &[&str], file: &str, setting: &str) {
    let folder = tempfile::tempdir().unwrap();
    let (whole, broken) = (folder.path().join("whole"), folder.path().join("broken"));
    let common = ["reconstruct", text(tiny_dataset()), "--method", method, "--device", "cpu", "--checkpoint-every", "5"];
    // Long enough to be caught in the middle.
    let common = [&common[..], settings, &["--set", "iterations=300"]].concat();
    corf_ok(&[&common[..], &["--out", text(&whole)]].concat());
    assert!(!whole.join("checkpoint").exists(), "a finished run needs none");
    let arguments = [&common[..], &["--out", text(&broken)]].concat();
    let mut child = start(&arguments);
    let begin = Instant::now();
    while !broken.join("checkpoint").exists() {
        assert!(begin.elapsed() < Duration::from_secs(60), "no checkpoint came");
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!broken.join("run.json").exists(), "an unfinished run must not look finished");
    corf_refuses(&[&arguments[..], &["--resume", "--set", setting]].concat(), &["checkpoint", "configuration"]);
    corf_refuses(&[&arguments[..], &["--resume", "--seed", "2"]].concat(), &["checkpoint", "configuration"]);
    corf_ok(&[&arguments[..], &["--resume"]].concat());
    assert!(fs::read(whole.join(file)).unwrap() == fs::read(broken.join(file)).unwrap());
}

#[test]
fn an_interrupted_training_resumes_to_the_same_bytes() {
    resumes_to_the_same_bytes("nerf2", &TINY, "nerf2", "rate=1e-3");
    resumes_to_the_same_bytes("wrf-gs-plus", &TINY_WRF, "wrf-gs-plus", "rates.sh_dc=1e-3");
}

#[test]
fn what_cannot_be_is_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    for (method, setting, words) in [
        ("nerf2", "samples=1", ["samples", "2 to 4096"]),
        ("nerf2", "width=100000", ["width", "4096"]),
        ("nerf2", "skip=8", ["skip", "layers"]),
        ("nerf2", "far_m=-1.0", ["far_m", "near_m"]),
        ("nerf2", "breadth=8", ["breadth", "nerf2"]),
        ("wrf-gs-plus", "iterations=0", ["`iterations`", "10 000"]),
        ("wrf-gs-plus", "rates.network=[1e-3, -1.0]", ["`rates.network`", "positive"]),
        ("wrf-gs-plus", "move_positions=true", ["move_positions", "wrf-gs-plus-corrected"]),
        ("wrf-gs-plus", "breadth=8", ["breadth", "wrf-gs-plus"]),
    ] {
        let arguments = ["reconstruct", text(tiny_dataset()), "--method", method, "--out", text(&out), "--set", setting];
        corf_refuses(&arguments, &words);
        assert!(!out.exists(), "{setting}");
    }
}
