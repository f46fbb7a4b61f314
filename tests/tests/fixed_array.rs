//! Data sets of the second kind: an array that stands still while the transmitter moves.

use crate::common::*;
use serde_json::Value;
use std::fs;
use std::path::Path;

/// A made set: a lobe whose azimuth follows the transmitter along y; every fourth of 24 places is held out.
fn made(folder: &Path) {
    fs::create_dir_all(folder.join("spectrum")).unwrap();
    let put = |name: &str, text: String| fs::write(folder.join(name), text).unwrap();
    put("gateway_info.yml", "gateway1:\n  position: [3.0, 0.0, 1.0]\n  orientation: [0, 0, 0, 1]\n".to_owned());
    let places: String = (0..24).map(|i| format!("0.0,{:.3},1.0\n", 0.01 * f64::from(i))).collect();
    put("tx_pos.csv", format!("x,y,z\n{places}"));
    let list = |test: bool| (0..24).filter(|i| (i % 4 == 1) == test).map(|i| format!("{:05}\n", i + 1)).collect::<String>();
    put("train_index.txt", list(false));
    put("test_index.txt", list(true));
    for i in 0..24usize {
        let level = |x: usize, y: usize| {
            (255.0 * (-((x as f64 - 100.0 - 5.0 * i as f64) / 20.0).powi(2) - (y as f64 / 40.0).powi(2)).exp()) as u8
        };
        let spectrum = corf_scene::Raster::from_fn(360, 90, level);
        fs::write(folder.join(format!("spectrum/{:05}.png", i + 1)), corf_scene::io::encode_png8(&spectrum).unwrap()).unwrap();
    }
}

fn same(a: &Path, b: &Path) {
    let mut names = Vec::new();
    for folder in ["", "spectrum"] {
        for entry in fs::read_dir(a.join(folder)).unwrap().map(|e| e.unwrap()).filter(|e| e.path().is_file()) {
            names.push(Path::new(folder).join(entry.file_name()));
        }
    }
    assert!(names.len() > 4);
    names
        .iter()
        .for_each(|name| assert_eq!(fs::read(a.join(name)).unwrap(), fs::read(b.join(name)).unwrap(), "{}", name.display()));
}

/// SSIM of a run's grey levels.
fn ssim(run: &Path) -> f64 {
    let record: Value = serde_json::from_str(&corf_ok(&["evaluate", text(run), "--json"])).unwrap();
    assert!(record["means"].get("rmse_db").is_none() && record["means"].get("peak_error_deg").is_none(), "no unit, no decibels");
    record["means"]["ssim_rf_scalar"].as_f64().unwrap()
}

#[test]
fn a_published_set_goes_in_and_out_unchanged_and_is_learnt() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    made(&at("set"));
    corf_ok(&["dataset", "import", text(&at("set")), "--from", "nerf2", "--out", text(&at("data"))]);
    corf_ok(&["dataset", "validate", text(&at("data"))]);
    corf_ok(&["dataset", "export", text(&at("data")), "--to", "nerf2", "--out", text(&at("back"))]);
    same(&at("set"), &at("back"));
    let header: Value = serde_json::from_slice(&fs::read(at("data/dataset.json")).unwrap()).unwrap();
    assert_eq!((header["kind"].as_str(), header["keyframes"].as_u64()), (Some("fixed array, moving transmitter"), Some(24)));
    // Lookups by the transmitter's place, and a field that reads it.
    let run = |method: &str, more: &[&str]| {
        let out = at(method);
        let said = corf_ok(
            &[&["reconstruct", text(&at("data")), "--method", method, "--device", "cpu", "--out", text(&out)], more].concat(),
        );
        assert!(said.contains("next: corf evaluate") && !said.contains("corf view"), "the viewer has no such sets: {said}");
        ssim(&out)
    };
    assert!(run("nearest", &[]) > 0.9);
    let quick = "iterations=40 rays=128 width=32 samples=16";
    let nerf2 = |more: &str| {
        let sets: Vec<&str> = quick.split(' ').chain(more.split_terminator(' ')).flat_map(|set| ["--set", set]).collect();
        let learnt = run("nerf2", &sets);
        fs::remove_dir_all(at("nerf2")).unwrap();
        learnt
    };
    let learnt = nerf2("");
    assert!((0.0..1.0).contains(&learnt), "{learnt}");
    // Rays are the published ones unless others are asked for; what a row of a plan says of them is what it did.
    assert!(learnt == nerf2("near_m=0 far_m=5") && learnt != nerf2("far_m=20"));
    corf_refuses(
        &["reconstruct", text(&at("data")), "--method", "nerf2", "--set", "near_m=6", "--out", text(&at("refused"))],
        &["near_m", "from 6 to 5 m"],
    );
    let config = quick.replace(' ', ", ");
    fs::write(
        at("plan.toml"),
        format!(
            "name = 'p'\ndataset = 'data'\nseeds = [1]\n[[row]]\nlabel = 'field'\nmethod = 'nerf2'\nconfig = {{ {config} }}\n"
        ),
    )
    .unwrap();
    corf_ok(&["bench", "run", text(&at("plan.toml")), "--device", "cpu", "--out", text(&at("bench"))]);
    let record: Value = serde_json::from_slice(&fs::read(at("bench/cells/field-seed1.json")).unwrap()).unwrap();
    assert_eq!((&record["config"]["near_m"], &record["config"]["far_m"]), (&Value::from(0.0), &Value::from(5.0)));
    assert_eq!(record["means"]["ssim_rf_scalar"].as_f64(), Some(learnt));
    // Gaussians over azimuth and elevation, deformed for the transmitter's place: they find the lobe where a blend of all spectra smears it.
    let few =
        "random_points=300 array_spread_m=2 density.until=0 iterations=600 width=32 layers=3 skip=1 rates.network=[4e-3,4e-3]";
    let drawn = run("wrf-gs-plus", &few.split(' ').flat_map(|set| ["--set", set]).collect::<Vec<_>>());
    let blend = run("inverse-distance", &["--set", "keyframes=200", "--set", "power=1"]);
    assert!(drawn > blend, "{drawn} against {blend}");
    // A size for receivers that move means nothing here.
    corf_refuses(
        &["reconstruct", text(&at("data")), "--method", "wrf-gs-plus", "--set", "random_extent=2", "--out", text(&at("refused"))],
        &["random_extent", "stands still"],
    );
    // What has no meaning here says so.
    for method in ["corf-gs", "corf-array", "rf-3dgs"] {
        corf_refuses(
            &["reconstruct", text(&at("data")), "--method", method, "--out", text(&at("refused"))],
            &["stands still", "nearest"],
        );
    }
    corf_refuses(&["view", text(&at("data"))], &["stands still"]);
    corf_refuses(&["dataset", "export", text(&at("data")), "--to", "numpy", "--out", text(&at("refused"))], &["--to nerf2"]);
    corf_refuses(
        &["dataset", "import", text(&at("set")), "--from", "nerf2", "--scale", "2", "--out", text(&at("refused"))],
        &["--scale"],
    );
    assert!(!at("refused").exists());
}

/// SSIM of the grey levels by lookups of a data set under a protocol, by row.
fn lookups(folder: &Path, data: &Path, protocol: &str) -> Vec<f64> {
    let plan = folder.join("plan.toml");
    let rows = "[[row]]\nlabel = 'nearest'\nmethod = 'nearest'\n[[row]]\nlabel = 'all'\nmethod = 'inverse-distance'\nconfig = { keyframes = 200, power = 4 }\n";
    fs::write(&plan, format!("name = 'p'\ndataset = '{}'\nprotocol = '{protocol}'\nseeds = [1]\n{rows}", text(data))).unwrap();
    let out = folder.join(protocol.replace([':', ',', '='], "-"));
    corf_ok(&["bench", "run", text(&plan), "--out", text(&out)]);
    let table = corf_ok(&["bench", "table", text(&out), "--format", "markdown", "--columns", "ssim_rf_scalar"]);
    assert!(table.contains("grey levels of a unit that is not known"), "{table}");
    let rows = table.lines().filter(|line| line.starts_with("| nearest") || line.starts_with("| all"));
    rows.map(|line| line.split('|').nth(2).unwrap().trim().trim_matches(['*', ' ']).parse().unwrap()).collect()
}

#[test]
fn blocks_show_what_a_random_split_hides_on_the_measured_set() {
    let Some(set) = shared("measured/rfid-s23") else { return };
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    corf_ok(&["dataset", "import", text(&set), "--from", "nerf2", "--out", text(&data)]);
    let published = lookups(folder.path(), &data, "test");
    // Own lookups of another program: 0.937 and 0.946; its windows end otherwise at the borders.
    assert!((published[0] - 0.937).abs() < 0.005 && (published[1] - 0.946).abs() < 0.005, "{published:?}");
    let fifths = lookups(folder.path(), &data, "along-y:parts=5,gap_m=0");
    assert!((fifths[1] - 0.768).abs() < 0.015 && fifths[0] < fifths[1], "{fifths:?}");
}
