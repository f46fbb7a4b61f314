//! Figures that commands draw, and quality over time: what is evaluated on the way changes nothing of what is reconstructed.

use crate::common::*;
use roxmltree::Document;
use serde_json::Value;
use std::fs;
use std::path::Path;

fn json(path: &Path) -> Value {
    serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
}

/// The texts of a figure, which is XML and names no file and no place of a network.
fn texts(path: &Path) -> Vec<String> {
    let svg = fs::read_to_string(path).unwrap();
    let document = Document::parse(&svg).unwrap();
    let all = || document.descendants();
    let outside = all().flat_map(|n| n.attributes()).find(|a| a.name() == "href" && !a.value().starts_with("data:image/"));
    assert!(outside.is_none(), "{}", path.display());
    all().filter(|n| n.has_tag_name("text")).filter_map(|n| n.text()).map(str::to_owned).collect()
}

fn pictures(path: &Path) -> usize {
    fs::read_to_string(path).unwrap().matches("<image ").count()
}

#[test]
fn evaluations_on_the_way_are_a_curve_and_change_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = text(tiny_dataset());
    let (watched, alone, drawn) = (folder.path().join("watched"), folder.path().join("alone"), folder.path().join("drawn.svg"));
    let run = |out: &Path, more: &[&str]| {
        let common = ["reconstruct", dataset, "--out", text(out), "--device", "cpu", "--set", "iterations_per_keyframe=20"];
        corf_ok(&[&common[..], more].concat())
    };
    let said = run(&watched, &["--evaluate-every", "3", "--figure", text(&drawn)]);
    run(&alone, &[]);
    for file in ["coupled.ply", "optical.ply", "rf.ply", "field.json"] {
        assert!(fs::read(watched.join(file)).unwrap() == fs::read(alone.join(file)).unwrap(), "{file} differs");
    }

    // Eight keyframes train: after the third and the sixth, and at the end.
    let curve = json(&watched.join("run.json"))["curve"].as_array().unwrap().clone();
    let evaluated: Vec<&Value> = curve.iter().filter(|point| point.get("held_out").is_some()).collect();
    assert_eq!(evaluated.len(), 3, "{curve:?}");
    let quality = |point: &Value, key: &str| point["held_out"][key].as_f64().unwrap();
    assert!(quality(evaluated[2], "psnr_opt") > quality(evaluated[0], "psnr_opt"), "{curve:?}");
    let seconds: Vec<f64> = curve.iter().map(|point| point["seconds"].as_f64().unwrap()).collect();
    assert!(seconds.windows(2).all(|pair| pair[0] <= pair[1]), "{seconds:?}");
    assert!(curve.iter().filter(|point| point["progress"] == 1.0).count() == 1, "one point of the end: {curve:?}");
    let (spectrum, image) = (quality(evaluated[2], "psnr_rf_scalar"), quality(evaluated[2], "psnr_opt"));
    let line = format!("held-out keyframes: PSNR spectrum (dB) {spectrum:.2} dB, PSNR image {image:.2} dB");
    assert!(said.contains(&line), "{said}");
    let figure = texts(&watched.join("quality.svg"));
    for name in ["held-out PSNR of the spectrum (dB)", "held-out PSNR of the image", "Gaussians", "time, s"] {
        assert!(figure.iter().any(|text| text == name), "{name}: {figure:?}");
    }
    let without = json(&alone.join("run.json"));
    assert!(without["curve"].as_array().unwrap().iter().all(|point| point.get("held_out").is_none()));
    assert!(!alone.join("quality.svg").exists());

    // The last point is what an evaluation of the finished run finds, and so is the picture.
    let again = folder.path().join("again.svg");
    let metrics: Value =
        serde_json::from_str(&corf_ok(&["evaluate", text(&watched), "--figure", text(&again), "--json"])).unwrap();
    for key in ["psnr_opt", "psnr_rf_scalar"] {
        let (found, last) = (metrics["means"][key].as_f64().unwrap(), quality(evaluated[2], key));
        assert!((found - last).abs() < 1e-9, "{key}: {found}, {last}");
    }
    assert!(fs::read(&drawn).unwrap() == fs::read(&again).unwrap());
    assert_eq!(pictures(&drawn), 6);
    let said = texts(&drawn);
    let count = |text: &str| said.iter().filter(|t| *t == text).count();
    assert_eq!((count("azimuth, °"), count("dB re 1/sr"), count("% of full scale"), count("dB")), (6, 2, 1, 1), "{said:?}");
    assert!(said.iter().any(|t| t.starts_with("1: azimuth ") && t.ends_with(" dB")), "{said:?}");

    // Of a run that is finished nothing is drawn, which is said.
    let resumed = corf(&[
        "reconstruct",
        dataset,
        "--out",
        text(&alone),
        "--device",
        "cpu",
        "--set",
        "iterations_per_keyframe=20",
        "--resume",
        "--evaluate-every",
        "3",
        "--figure",
        text(&folder.path().join("late.svg")),
    ]);
    let notes = String::from_utf8_lossy(&resumed.stderr);
    assert!(resumed.status.success() && notes.contains("corf evaluate") && notes.contains("no curve of quality"), "{notes}");
}

/// Of methods whose field is no Gaussians of light and radio as well: a network, and Gaussians that a network deforms. (`corf-array` needs spectra of
/// its own: array.rs.)
#[test]
fn networks_have_a_curve_as_well_and_keep_their_bytes() {
    let folder = tempfile::tempdir().unwrap();
    for (method, files, settings) in [
        ("nerf2", &["nerf2"][..], &["iterations=3", "width=16", "rays=4", "samples=8"][..]),
        ("wrf-gs-plus", &["wrf-gs-plus"], &["iterations=6", "random_points=300", "width=32"]),
    ] {
        let run = |name: &str, more: &[&str]| {
            let out = folder.path().join(format!("{method}-{name}"));
            let mut arguments =
                vec!["reconstruct", text(tiny_dataset()), "--method", method, "--device", "cpu", "--out", text(&out)];
            settings.iter().for_each(|setting| arguments.extend(["--set", setting]));
            corf_ok(&[&arguments[..], more].concat());
            out
        };
        let (alone, watched) = (run("alone", &[]), run("watched", &["--evaluate-every", "2"]));
        for file in files {
            let [one, other] = [&alone, &watched].map(|run| fs::read(run.join(file)).unwrap());
            assert!(one == other, "{method}: {file} differs");
        }
        let curve = json(&watched.join("run.json"))["curve"].as_array().unwrap().clone();
        let evaluated: Vec<&Value> = curve.iter().filter(|point| point.get("held_out").is_some()).collect();
        // NeRF² reports every two seconds, and may have ended before the first.
        let least = if method == "nerf2" { 1 } else { 2 };
        assert!(evaluated.len() >= least, "{method}: {curve:?}");
        assert!(evaluated.iter().all(|point| point["held_out"]["psnr_rf_scalar"].as_f64().unwrap() > 0.0), "{method}: {curve:?}");
        assert!(watched.join("quality.svg").is_file());
    }
}

#[test]
fn figures_that_cannot_be_and_evaluations_of_nothing_are_refused_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    let (dataset, out) = (text(tiny_dataset()), folder.path().join("run"));
    let refused = |more: &[&str], words: &[&str]| {
        corf_refuses(&[&["reconstruct", dataset, "--out", text(&out)][..], more].concat(), words);
        assert!(!out.join("run.json").exists() && !out.join("config.json").exists());
    };
    refused(&["--evaluate-every", "0"], &["evaluations every 0", "1 or more"]);
    refused(&["--evaluate-every", "2", "--protocol", "all"], &["none is left to evaluate"]);
    refused(&["--figure", "x.svg", "--protocol", "all"], &["none is left to evaluate"]);
    refused(&["--evaluate-every", "2", "--method", "nearest"], &["nearest", "no field", "looks its predictions up", "corf-gs"]);
    refused(&["--figure", "x.png"], &["x.png", "ends in .svg"]);
    refused(&["--colours", "jet"], &["--figure"]);
    let within = tiny_dataset().join("figure.svg");
    refused(&["--figure", text(&within)], &["--figure"]);
    assert!(!within.exists());
}

#[test]
fn a_spectrum_and_renderings_have_figures_with_axes() {
    let folder = tempfile::tempdir().unwrap();
    let spectrum = |name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let point = ["spectrum", "scenes/room.toml", "--rx", "1.5,1.5,1.2", "--no-diffuse", "--out", text(&out)];
        corf_ok(&[&point, more].concat());
        out
    };
    let form = |colours: &str| spectrum(colours, &["--kind", "mpc,bartlett", "--size", "60x40", "--colours", colours]);
    let (perceptual, jet) = (form("perceptual"), form("jet"));
    let said = texts(&perceptual.join("mpc.svg"));
    for text in ["Angular power spectrum (mpc) at 60 GHz", "azimuth, °", "elevation along the lines, °", "dB re 1/sr"] {
        assert!(said.iter().any(|t| t == text), "{text}: {said:?}");
    }
    assert!(said.iter().any(|t| t.starts_with("1: azimuth ")), "{said:?}");
    assert!(texts(&perceptual.join("bartlett.svg")).iter().any(|t| t == "dB"));
    // The colours are another's, the numbers and the picture in Jet are not.
    assert!(fs::read(perceptual.join("mpc.svg")).unwrap() != fs::read(jet.join("mpc.svg")).unwrap());
    for file in ["mpc.exr", "mpc-db.exr", "mpc-jet.png"] {
        assert!(fs::read(perceptual.join(file)).unwrap() == fs::read(jet.join(file)).unwrap(), "{file}");
    }
    let sphere = spectrum("sphere", &["--grid", "sphere", "--size", "72x36"]);
    let said = texts(&sphere.join("mpc.svg"));
    assert!(["135", "-135", "60", "elevation, °"].iter().all(|text| said.iter().any(|t| t == text)), "{said:?}");
}

#[test]
fn a_plan_draws_quality_over_time_into_its_report_and_renderings_have_figures() {
    let folder = tempfile::tempdir().unwrap();
    let (plan, out) = (folder.path().join("plan.toml"), folder.path().join("bench"));
    let head = format!("name = \"quality\"\ndataset = {:?}\nseeds = [1]\nevaluate_every = 4\n", tiny_dataset());
    let ours = "[[row]]\nlabel = \"ours\"\nmethod = \"corf-gs\"\nkeep_model = true\nconfig = { iterations_per_keyframe = 5 }\n";
    let lookup = "[[row]]\nlabel = \"nearest\"\nmethod = \"nearest\"\n";
    fs::write(&plan, format!("{head}{ours}{lookup}")).unwrap();
    corf_ok(&["bench", "run", text(&plan), "--out", text(&out), "--device", "cpu"]);
    let report = fs::read_to_string(out.join("report.html")).unwrap();
    assert!(report.contains("<h2>Quality over time</h2>") && report.contains("Held-out PSNR of the spectrum (dB)"));
    let evaluated = |row: &str| {
        let record = json(&out.join(format!("cells/{row}-seed1.json")));
        record["curve"].as_array().unwrap().iter().filter(|point| point.get("held_out").is_some()).count()
    };
    assert_eq!((evaluated("ours"), evaluated("nearest")), (2, 0), "after four of eight keyframes, and at the end");

    let views = folder.path().join("views");
    let model = out.join("models/ours");
    let render = ["render", text(&model), "--orbit", "2", "--out", text(&views)];
    corf_ok(&render);
    assert!(!views.join("figures").exists());
    // What was rendered already has its figures where they are asked for later.
    corf_ok(&[&render[..], &["--resume", "--figures"]].concat());
    assert_eq!(pictures(&views.join("figures/00002.svg")), 2);
}
