//! Spectra of every kind, from the command line and in datasets.

use crate::common::*;
use corf_scene::dataset::Dataset;
use corf_scene::io;
use std::fs;

/// Small enough for a test: few directions and photons.
const COARSE: &str = "directions = 20000\nphotons = 20000\n";

#[test]
fn one_pose_in_every_kind_on_both_grids() {
    let folder = tempfile::tempdir().unwrap();
    for (grid, size, pixels) in [("pinhole", "24x16", 24 * 16), ("sphere", "36x18", 36 * 18)] {
        let out = folder.path().join(grid);
        let arguments =
            ["spectrum", "scenes/lobby.toml", "--rx", "7.4,1.95,1.6", "--out", text(&out), "--grid", grid, "--size", size];
        let more = ["--kind", "mpc,bartlett,bartlett-coherent,mvdr", "--depth", "2", "--no-diffuse", "--json"];
        let summary: serde_json::Value = serde_json::from_str(&corf_ok(&[&arguments[..], &more[..]].concat())).unwrap();
        assert_eq!(summary["spectra"].as_array().unwrap().len(), 4);
        for kind in ["mpc", "bartlett", "bartlett-coherent", "mvdr"] {
            let linear = io::read_exr_f32(out.join(format!("{kind}.exr"))).unwrap();
            let db = io::read_exr_f32(out.join(format!("{kind}-db.exr"))).unwrap();
            assert_eq!(linear.pixels().len(), pixels);
            let peak = linear.pixels().iter().copied().fold(0f32, f32::max);
            assert!(peak > 0.0 && (10.0 * peak.log10() - db.pixels().iter().copied().fold(f32::MIN, f32::max)).abs() < 1e-3);
            assert!(out.join(format!("{kind}-jet.png")).exists());
        }
        // The platform looks at the transmitter, which it sees: the beam's strongest direction is straight ahead.
        let beam = io::read_exr_f32(out.join("bartlett.exr")).unwrap();
        let peak = (0..pixels).max_by(|a, b| beam.pixels()[*a].total_cmp(&beam.pixels()[*b])).unwrap();
        let (x, y) = (peak % beam.width(), peak / beam.width());
        assert!(x.abs_diff(beam.width() / 2) <= 1 && y.abs_diff(beam.height() / 2) <= 1, "{x}, {y}");
    }
    let out = folder.path().join("bad");
    let bad = |option: &str, value: &str, words: &[&str]| {
        corf_refuses(&["spectrum", "scenes/lobby.toml", "--rx", "7.4,1.95,1.6", "--out", text(&out), option, value], words);
    };
    bad("--kind", "mdvr", &["mvdr"]);
    bad("--size", "300", &["WIDTHxHEIGHT"]);
    bad("--bandwidth", "1", &["bandwidth", "1e9"]);
    bad("--transmitter", "east", &["east"]);
    bad("--towards", "7.4,1.95,1.6", &["--towards"]);
    bad("--loading", "0.5", &["--loading", "mvdr"]);
    assert!(!out.exists());
}

/// Side lobes bring into a beam what lies outside the frame: sampled as sparsely there as lobes of a degree allow, the worst of these
/// pixels is off by 2 dB.
#[test]
fn an_arrays_spectrum_is_as_good_as_its_samples_of_the_whole_sphere() {
    let arguments =
        ["bench", "radio", "scenes/lobby-mini.toml", "--spectrum", "bartlett", "--positions", "6", "--depth", "2", "--json"];
    let sampling = ["--directions", "60000", "--photons", "300000", "--replicas", "3", "--error-positions", "6"];
    let answer: serde_json::Value = serde_json::from_str(&corf_ok(&[&arguments[..], &sampling[..]].concat())).unwrap();
    assert_eq!(answer["spectrum"], "bartlett");
    let error = |key: &str| answer["standard_error"][key].as_f64().unwrap();
    assert!(error("pixels") > 20_000.0 && error("pixel_median_db") > 0.0, "{answer}");
    assert!(error("pixel_share_as_wanted") > 0.97 && error("pixel_worst_db") < 1.2, "{answer}");
    corf_refuses(
        &["bench", "radio", "scenes/lobby-mini.toml", "--spectrum", "bartlett", "--powers"],
        &["--spectrum", "--powers"],
    );
}

#[test]
fn a_dataset_holds_every_view_it_is_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let config = tiny_config(folder.path(), 3);
    let radio = "write_db = true\nwrite_paths = true\nsphere = [36, 18]\nspectrum = \"mvdr\"\n";
    let body = fs::read_to_string(&config).unwrap() + COARSE + radio;
    fs::write(&config, &body).unwrap();
    let out = folder.path().join("dataset");
    corf_ok(&["dataset", "generate", text(&config), "--out", text(&out)]);
    let said = corf_ok(&["dataset", "validate", text(&out)]);
    assert!(said.contains("passed") && said.contains("falls into the RF frame") && said.contains("standard error"), "{said}");
    for file in ["rf/db/00003.exr", "rf/sphere/00003.exr"] {
        assert!(out.join(file).exists(), "{file}");
    }
    let dataset = Dataset::open(&out).unwrap();
    assert!(dataset.share_in_frame().iter().all(|s| s.is_some_and(|s| s > 0.0 && s < 1.0)));
    assert_eq!(serde_json::to_value(dataset.header().quantity).unwrap(), "capon_power");
    assert!(dataset.header().materials.iter().all(|m| m.relative_permittivity >= 1.0 && !m.source.is_empty()));
    assert!(dataset.header().sampling_error.is_some_and(|e| e.total_db > 0.0 && e.total_db < 1.0));
    // Paths in Sionna's terms, and the diffuse power in the last line.
    let lines = io::read_gzip_text(out.join("rf/paths/00001.jsonl.gz")).unwrap();
    let all: Vec<serde_json::Value> = lines.lines().map(|l| serde_json::from_str(l).unwrap()).collect();
    let (last, paths) = all.split_last().unwrap();
    assert!(paths.iter().all(|p| p["interactions"].is_array() && p["a"].as_array().unwrap().len() == 2 && p["tau"].is_f64()));
    assert!(last["diffuse"]["power"].as_f64().unwrap() > 0.0);

    // A transmitter that is not there is named before anything is written.
    fs::write(&config, format!("transmitter = \"attic\"\n{body}")).unwrap();
    let other = folder.path().join("other");
    corf_refuses(&["dataset", "generate", text(&config), "--out", text(&other)], &["attic", "tiny.toml: transmitter"]);
    assert!(!other.exists());
}

#[test]
fn several_transmitters_are_seen_from_one_pose() {
    let folder = tempfile::tempdir().unwrap();
    let extra = "[transmitters.left]\nposition_m = [1.0, 4.0, 2.0]\n[transmitters.right]\nposition_m = [5.0, 4.0, 2.0]\n";
    let scene = room_with_pillar(folder.path(), [1.0, 1.0, 2.0], extra);
    let out = |name: &str| folder.path().join(name);
    let spectra = |name: &str, more: &[&str]| -> serde_json::Value {
        let folder = out(name);
        let arguments =
            ["spectrum", text(&scene), "--rx", "4,1,1.5", "--out", text(&folder), "--size", "24x16", "--no-diffuse", "--json"];
        serde_json::from_str(&corf_ok(&[&arguments[..], more].concat())).unwrap()
    };
    let towards = ["--towards", "3,4,2"];
    let both = spectra("both", &[&towards[..], &["--transmitter", "left", "--transmitter", "right"]].concat());
    for (number, name) in ["left", "right"].into_iter().enumerate() {
        let alone = spectra(name, &[&towards[..], &["--transmitter", name]].concat());
        assert_eq!(both["transmitters"][number], alone, "{name}");
        let file = |folder: std::path::PathBuf| fs::read(folder.join("mpc.exr")).unwrap();
        assert!(file(out("both").join(format!("tx{number}"))) == file(out(name)), "{name}");
    }
    assert_eq!(both["names"], serde_json::json!(["left", "right"]));
    let refused = out("refused");
    let arguments =
        ["spectrum", text(&scene), "--rx", "4,1,1.5", "--out", text(&refused), "--transmitter", "left", "--transmitter", "right"];
    corf_refuses(&arguments, &["--towards"]);
    corf_refuses(&[&arguments[..], &["--transmitter", "right1", "--towards", "3,4,2"]].concat(), &["did you mean \"right\"?"]);
}
