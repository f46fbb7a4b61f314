//! Predictions that any program wrote are scored as this program's own are, and what is wrong with them is said.

use crate::common::*;
use corf_scene::dataset::Dataset;
use corf_scene::io::{encode_exr_f32, encode_png16, write_atomic, write_png};
use corf_scene::npz::{Array, Values};
use corf_scene::{Raster, color};
use serde_json::Value;
use std::fs;
use std::path::Path;
use std::process::Output;

/// Held out of the ten keyframes of the tiny dataset.
const HELD_OUT: [usize; 2] = [0, 8];

fn json(path: &Path) -> Value {
    serde_json::from_slice(&fs::read(path).unwrap()).unwrap()
}

fn arguments(folder: &Path) -> Vec<&str> {
    vec!["evaluate", "--predictions", text(folder), "--dataset", text(tiny_dataset()), "--no-verify"]
}

fn score(folder: &Path) -> (Value, Output) {
    let output = corf(&[&arguments(folder)[..], &["--json"]].concat());
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "{stderr}");
    let metrics: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(metrics, json(&folder.join("metrics.json")));
    (metrics, output)
}

fn refused(folder: &Path, words: &[&str]) {
    let _ = fs::remove_file(folder.join("metrics.json"));
    corf_refuses(&arguments(folder), words);
    assert!(!folder.join("metrics.json").exists(), "nothing is written of what is refused");
}

fn mean(metrics: &Value, key: &str) -> Option<f64> {
    metrics["means"].get(key).map(|v| v.as_f64().unwrap())
}

/// What was observed, as somebody else's perfect predictions of the kinds asked for.
fn observed(folder: &Path, kinds: &[&str]) {
    let dataset = Dataset::open(tiny_dataset()).unwrap();
    let range = dataset.db_range().unwrap();
    for index in HELD_OUT {
        let keyframe = dataset.keyframe(index).unwrap();
        let (image, spectrum) = (keyframe.light.unwrap().image, keyframe.radio.unwrap().spectrum);
        let scalar = spectrum.map(|&s| range.scalar(s));
        for kind in kinds {
            let (place, bytes) = match *kind {
                "images" => ("images", corf_scene::io::encode_png(&image).unwrap()),
                "images16" => ("images", png16(&image.map(|p| p.map(|v| u16::from(v) * 257)))),
                "exr" => ("linear", encode_exr_f32(&spectrum, "Y").unwrap()),
                "npy" => {
                    let s = &spectrum;
                    ("linear", Array::new("s", &[s.height(), s.width()], Values::F32(s.pixels().to_vec())).to_npy())
                }
                "scalar16" => ("scalar", encode_png16(&scalar.map(|&s| (s * 65535.0).round() as u16)).unwrap()),
                "scalar8" => ("scalar", corf_scene::io::encode_png(&scalar.map(|&s| [color::quantize8(s); 3])).unwrap()),
                "jet" => ("jet", corf_scene::io::encode_png(&range.jet_image(&spectrum)).unwrap()),
                "opencv" => {
                    let painted = scalar.map(|&s| color::jet_of_trapezoids(s).map(color::quantize8));
                    ("jet", corf_scene::io::encode_png(&painted).unwrap())
                }
                other => panic!("{other}"),
            };
            let ending = if ["exr", "npy"].contains(kind) { kind } else { "png" };
            write_atomic(folder.join(place).join(format!("{:05}.{ending}", index + 1)), &bytes).unwrap();
        }
    }
}

fn png16(image: &Raster<[u16; 3]>) -> Vec<u8> {
    let (w, h) = (image.width() as u32, image.height() as u32);
    let buffer: image::ImageBuffer<image::Rgb<u16>, Vec<u16>> =
        image::ImageBuffer::from_vec(w, h, image.pixels().as_flattened().to_vec()).unwrap();
    let mut bytes = std::io::Cursor::new(Vec::new());
    image::DynamicImage::ImageRgb16(buffer).write_to(&mut bytes, image::ImageFormat::Png).unwrap();
    bytes.into_inner()
}

#[test]
fn a_runs_predictions_written_and_read_back_have_the_runs_metrics() {
    let folder = tempfile::tempdir().unwrap();
    let (run, written, views) = (folder.path().join("run"), folder.path().join("written"), folder.path().join("views"));
    let quick = ["--set", "iterations_per_keyframe=10", "--no-verify", "--device", "cpu", "--seed", "7"];
    corf_ok(&[&["reconstruct", text(tiny_dataset()), "--out", text(&run)], &quick[..]].concat());
    corf_ok(&["evaluate", text(&run), "--no-verify", "--device", "cpu", "--write-predictions", text(&written)]);
    let own = json(&run.join("metrics.json"));
    let poses = tiny_dataset().join("trajectory.json");
    corf_ok(&["render", text(&run), "--no-verify", "--device", "cpu", "--poses", text(&poses), "--out", text(&views)]);
    for place in [&written, &views] {
        let (metrics, _) = score(place);
        let keys: Vec<&String> = own["means"].as_object().unwrap().keys().collect();
        assert!(keys.len() >= 23 && keys.iter().any(|k| *k == "rate_loss_percent"), "{keys:?}");
        for key in keys {
            let (a, b) = (mean(&own, key).unwrap(), mean(&metrics, key).unwrap());
            // Images and Jet are compared as 8 bits, which is what was written; power went through float32.
            let tolerance = if key.ends_with("_opt") || key.ends_with("_jet") { 0.0 } else { 2e-4 };
            assert!((a - b).abs() <= tolerance, "{}, {key}: {a} {b}", place.display());
        }
        assert_eq!((metrics["method"].as_str(), metrics["split"].as_str()), (Some("predictions"), Some("test")));
    }
    // What was stated is the run's.
    let (metrics, _) = score(&written);
    assert_eq!(
        (&metrics["seconds"], &metrics["gaussians"], &metrics["seed"]),
        (&own["seconds"], &own["gaussians"], &own["seed"])
    );
    assert_eq!((&metrics["row"], &metrics["uses_ground_truth_depth"]), (&own["method"], &own["uses_ground_truth_depth"]));
    assert!(metrics["clock"].as_str().unwrap().contains("not measured here"));
    // A folder that holds something is not written into.
    corf_refuses(&["evaluate", text(&run), "--no-verify", "--write-predictions", text(&written)], &["not empty"]);
}

#[test]
fn the_observation_is_a_perfect_prediction_in_every_kind_of_file() {
    for (kinds, rmse_db) in [
        (&["images", "exr"][..], 1e-4),
        (&["images16", "npy"], 1e-4),
        (&["images", "scalar16", "jet"], 70.0 / 65535.0),
        (&["images", "scalar8"], 70.0 / 255.0),
        (&["images", "jet"], 0.6),
    ] {
        let folder = tempfile::tempdir().unwrap();
        observed(folder.path(), kinds);
        let (metrics, output) = score(folder.path());
        assert_eq!(mean(&metrics, "psnr_opt"), Some(100.0), "{kinds:?}");
        assert!(mean(&metrics, "rmse_db").unwrap() <= rmse_db, "{kinds:?}: {metrics:#}");
        assert!(mean(&metrics, "psnr_rf_jet").unwrap() > if kinds.contains(&"scalar8") { 45.0 } else { 60.0 }, "{kinds:?}");
        assert!(mean(&metrics, "codebook_loss_db").unwrap() < 0.05, "{kinds:?}");
        // Only where spectra are known by Jet colours alone is the loss to be told.
        let reported = String::from_utf8_lossy(&output.stderr).contains("Jet colours, which loses precision");
        assert_eq!(reported, kinds == ["images", "jet"], "{kinds:?}");
        if kinds.contains(&"exr") {
            assert_eq!((mean(&metrics, "beam_top1"), mean(&metrics, "rate_loss_bps_hz")), (Some(1.0), Some(0.0)));
            assert!(mean(&metrics, "peak_error_p90_deg").unwrap() < 1e-5);
            // Whoever sees what is there is in outage where everybody is, and knows it.
            assert_eq!(mean(&metrics, "outage_percent"), mean(&metrics, "outage_best_percent"));
            assert_eq!((mean(&metrics, "outage_missed_percent"), mean(&metrics, "outage_false_percent")), (Some(0.0), Some(0.0)));
            for frame in metrics["frames"].as_array().unwrap() {
                assert_eq!(frame["best_beam"], frame["chosen_beam"]);
                let [free, best] = ["free_space_rate_bps_hz", "best_rate_bps_hz"].map(|key| frame[key].as_f64().unwrap());
                assert!(free > 5.0 && best > 0.0, "{frame}");
            }
        }
    }
}

#[test]
fn light_alone_and_radio_alone_are_scored_and_the_rest_is_left_out() {
    let folder = tempfile::tempdir().unwrap();
    observed(folder.path(), &["images"]);
    let (light, _) = score(folder.path());
    assert_eq!(light["means"].as_object().unwrap().len(), 2);
    assert!(light.get("seconds").is_none() && light.get("peak_error_median_p90_deg").is_none());
    let table = corf_ok(&arguments(folder.path()));
    assert!(table.contains("100.00") && table.contains('–'), "{table}");
    let folder = tempfile::tempdir().unwrap();
    observed(folder.path(), &["exr"]);
    let (radio, _) = score(folder.path());
    assert!(mean(&radio, "psnr_opt").is_none() && mean(&radio, "psnr_rf_jet").is_some());
    let table = corf_ok(&[&arguments(folder.path())[..], &["--columns", "psnr_opt,radio"]].concat());
    assert!(table.contains("8×8 beam loss") && table.contains("20 dBm sent") && table.contains('–'), "{table}");
}

#[test]
fn what_is_wrong_with_a_folder_is_said_with_the_file_and_what_to_do() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    refused(&at("nowhere"), &["nowhere", "no folder", "help"]);
    refused(folder.path(), &["holds no predictions", "images/"]);
    observed(folder.path(), &["images", "exr"]);
    let sound = |name: &str| fs::read(at(name)).unwrap();
    let (image, spectrum) = (sound("images/00009.png"), sound("linear/00009.exr"));
    let spoilt = |name: &str, bytes: Option<&[u8]>, words: &[&str]| {
        let before = fs::read(at(name)).ok();
        match bytes {
            Some(bytes) => fs::write(at(name), bytes).unwrap(),
            None => fs::remove_file(at(name)).unwrap(),
        }
        refused(folder.path(), words);
        match before {
            Some(before) => fs::write(at(name), before).unwrap(),
            None => fs::remove_file(at(name)).unwrap(),
        }
    };
    let exr = |value: f32| encode_exr_f32(&Raster::filled(48, 32, value), "Y").unwrap();
    spoilt("images/00009.png", None, &["images/00009.png", "keyframe 8 is missing", "1 of 2", "\"names\": \"index\""]);
    spoilt("linear/00001.exr", None, &["linear/00001.exr", "keyframe 0 is missing"]);
    spoilt("images/00000.png", Some(&image), &["00000.png", "names no keyframe", "count from 0"]);
    spoilt("images/00009.png", Some(&image[..image.len() / 2]), &["00009.png", "not a readable PNG"]);
    spoilt(
        "images/00009.png",
        Some(&corf_scene::io::encode_png(&Raster::filled(48, 27, [9; 3])).unwrap()),
        &["48x27", "96x54", "resolution"],
    );
    spoilt(
        "linear/00009.exr",
        Some(&encode_exr_f32(&Raster::filled(32, 48, 0.0), "Y").unwrap()),
        &["00009.exr", "32x48", "48x32"],
    );
    spoilt("linear/00009.exr", Some(&exr(-80.0)), &["00009.exr", "pixel (0, 0) is -80", "decibels", "scalar/"]);
    spoilt("linear/00009.exr", Some(&exr(f32::NAN)), &["00009.exr", "NaN", "finite"]);
    spoilt("linear/00009.exr", Some(&exr(0.5)), &["00009.exr", "every pixel with power is above", "1 W"]);
    spoilt("linear/00009.npy", Some(&spectrum), &["00009.exr", "00009.npy", "one keyframe"]);
    for (stated, words) in [
        ("{\"secnods\": 3}", &["predictions.json", "secnods"][..]),
        ("{\"seconds\": -3}", &["predictions.json", "seconds is -3"]),
        ("{\"schema\": \"corf-predictions/9\"}", &["predictions.json", "corf-predictions/1"]),
        ("{\"dataset_hash\": \"abc\"}", &["predictions.json", "abc", "--dataset"]),
        ("{\"db_range\": {\"min_db\": -200, \"max_db\": -100}}", &["db_range is -200 to -100 dB", "linear/"]),
        ("{\"names\": \"index\"}", &["images/00000.png", "keyframe 0 is missing"]),
    ] {
        fs::write(at("predictions.json"), stated).unwrap();
        refused(folder.path(), words);
    }
    fs::write(at("predictions.json"), "{\"protocol\": \"segment\"}").unwrap();
    let of_test = [&arguments(folder.path())[..], &["--protocol", "test"]].concat();
    corf_refuses(&of_test, &["of the protocol \"segment\"", "\"test\""]);
    fs::remove_file(at("predictions.json")).unwrap();
    fs::create_dir(at("scalar")).unwrap();
    refused(folder.path(), &["scalar/00001.png", "missing"]);
    let other = tempfile::tempdir().unwrap();
    observed(other.path(), &["exr", "scalar16"]);
    refused(other.path(), &["linear/ and in scalar/", "keep"]);
    // Kinds of images that were put into each other's places.
    let mixed = tempfile::tempdir().unwrap();
    observed(mixed.path(), &["jet"]);
    fs::rename(mixed.path().join("jet"), mixed.path().join("scalar")).unwrap();
    refused(mixed.path(), &["00001.png", "has colours", "jet/"]);
    let mixed = tempfile::tempdir().unwrap();
    observed(mixed.path(), &["scalar8"]);
    fs::rename(mixed.path().join("scalar"), mixed.path().join("jet")).unwrap();
    refused(mixed.path(), &["00001.png", "is grey", "scalar/"]);
    // matplotlib's Jet is not OpenCV's.
    let other_jet = tempfile::tempdir().unwrap();
    observed(other_jet.path(), &["opencv"]);
    refused(other_jet.path(), &["jet/000", "Jet of OpenCV and MATLAB", "as matplotlib does"]);
    // Flags that mean nothing together.
    corf_refuses(&["evaluate"], &["nothing to evaluate", "--predictions"]);
    corf_refuses(&["evaluate", "--predictions", text(folder.path())], &["--dataset"]);
    corf_refuses(&[&arguments(folder.path())[..], &["--device", "cpu"]].concat(), &["--device"]);
    corf_refuses(&[&arguments(folder.path())[..], &["--columns", "psnr"]].concat(), &["psnr", "psnr_opt"]);
}

#[test]
fn names_may_count_from_zero_and_what_is_clipped_or_empty_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let dataset = Dataset::open(tiny_dataset()).unwrap();
    let range = dataset.db_range().unwrap();
    // A spike over the range in one keyframe, nothing at all in the other.
    let over = 10f32.powf((range.max_db as f32 + 3.0) / 10.0);
    let mut spiked = dataset.keyframe(0).unwrap().radio.unwrap().spectrum;
    spiked[(3, 4)] = over;
    write_atomic(at("linear/0.exr"), &encode_exr_f32(&spiked, "Y").unwrap()).unwrap();
    write_atomic(at("linear/8.exr"), &encode_exr_f32(&Raster::filled(48, 32, 0.0), "Y").unwrap()).unwrap();
    write_atomic(at("predictions.json"), b"{\"names\": \"index\", \"method\": \"spike\", \"gaussians\": 5}").unwrap();
    let (metrics, output) = score(folder.path());
    let reported = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(reported.contains("1 pixel of linear/ is above") && reported.contains("1 spectrum holds no power"), "{reported}");
    assert_eq!((metrics["row"].as_str(), metrics["gaussians"].as_u64()), (Some("spike"), Some(5)));
    let empty = &metrics["frames"][1];
    assert_eq!(
        (empty["total_power_error_db"].as_f64(), empty["beam_top1"].as_f64()),
        (Some(range.max_db - range.min_db), Some(0.0))
    );
}

#[test]
fn predictions_stand_in_a_comparison_beside_methods() {
    let folder = tempfile::tempdir().unwrap();
    let (plan, out) = (folder.path().join("plan.toml"), folder.path().join("out"));
    for seed in [1, 2] {
        let dir = folder.path().join(format!("theirs/{seed}"));
        observed(&dir, &["images", "exr"]);
        fs::write(dir.join("predictions.json"), format!("{{\"seconds\": {seed}.5, \"gaussians\": 1000, \"seed\": {seed}}}"))
            .unwrap();
    }
    observed(&folder.path().join("light"), &["images"]);
    let rows = "[[row]]\nlabel = \"nearest\"\nmethod = \"nearest\"\n\
                [[row]]\nlabel = \"theirs\"\nkind = \"predictions\"\ndir = \"theirs/{seed}\"\n\
                [[row]]\nlabel = \"light alone\"\nkind = \"predictions\"\ndir = \"light\"\n";
    let head = format!(
        "name = \"outsiders\"\ndataset = {:?}\nseeds = [1, 2]\ncolumns = [\"short\", \"codebook_loss_db\"]\n",
        tiny_dataset()
    );
    fs::write(&plan, format!("{head}{rows}")).unwrap();
    let run = |more: &[&str]| corf(&[&["bench", "run", text(&plan), "--out", text(&out)], more].concat());
    // What is missing is found before anything is run or written.
    let gone = folder.path().join("theirs/2/images/00009.png");
    let kept = fs::read(&gone).unwrap();
    fs::remove_file(&gone).unwrap();
    let refused = run(&[]);
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(refused.status.code() == Some(2) && said.contains("row \"theirs\"") && said.contains("00009.png"), "{said}");
    assert!(!out.exists());
    fs::write(&gone, &kept).unwrap();
    assert_eq!(run(&[]).status.code(), Some(0));
    let table = fs::read_to_string(out.join("table.md")).unwrap();
    let row = |label: &str| table.lines().find(|l| l.starts_with(&format!("| {label} |"))).unwrap().to_owned();
    assert!(row("theirs").ends_with("| 1000 ‡ † | 2.0 ‡ † |") && row("theirs").contains("| 100.00 ‡ |"), "{table}");
    assert!(row("light alone").contains("| 100.00 | 1.000 | – |") && row("light alone").ends_with("| – | – |"), "{table}");
    assert!(table.contains("8×8 beam loss, dB ↓") && table.contains("scored here: theirs; light alone"), "{table}");
    assert_eq!(corf_ok(&["bench", "table", text(&out)]).trim_end(), table.split_once("\n\n\n\n").unwrap().1.trim_end());
    assert!(corf_ok(&["bench", "table", text(&out), "--columns", "beam_top1"]).contains("top-1 beam"));
    assert!(fs::read_to_string(out.join("report.html")).unwrap().contains("light alone"));
    assert!(!out.join("cells/light-alone-seed2.json").exists(), "one run is one value");
    let record = json(&out.join("cells/theirs-seed1.json"));
    assert_eq!(record["config"]["content_sha256"].as_str().unwrap().len(), 64);
    // Finished cells stay; predictions that have changed since are other predictions.
    assert_eq!(run(&["--resume"]).status.code(), Some(0));
    write_png(&gone, &Raster::filled(96, 54, [1; 3])).unwrap();
    let changed = run(&["--resume"]);
    let said = String::from_utf8_lossy(&changed.stderr).into_owned();
    assert!(
        changed.status.code() == Some(2) && said.contains("theirs-seed2.json") && said.contains("other predictions"),
        "{said}"
    );
    // A folder of another seed than it stands for.
    fs::write(folder.path().join("theirs/2/predictions.json"), "{\"seed\": 1}").unwrap();
    let swapped = run(&["--resume"]);
    assert!(String::from_utf8_lossy(&swapped.stderr).contains("stated to be of seed 1, and stands for seed 2"));
}

#[test]
fn views_that_were_drawn_elsewhere_than_the_keyframes_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let run = at("run");
    corf_ok(&["reconstruct", text(tiny_dataset()), "--method", "nearest", "--out", text(&run), "--device", "cpu", "--no-verify"]);
    let render = |poses: &Path, out: &Path| {
        corf_ok(&["render", text(&run), "--poses", text(poses), "--out", text(out), "--device", "cpu"]);
    };
    render(&tiny_dataset().join("trajectory.json"), &at("views"));
    let (scored, _) = score(&at("views"));
    corf_ok(&["evaluate", text(&run), "--no-verify", "--device", "cpu"]);
    let own = json(&run.join("metrics.json"));
    // Pictures of 8 bits are what differs.
    assert!((mean(&scored, "psnr_rf_jet").unwrap() - mean(&own, "psnr_rf_jet").unwrap()).abs() < 0.05, "{scored}");
    // The same poses the other way round: a file's order is its writer's.
    let mut poses: Vec<[[f64; 4]; 4]> = serde_json::from_slice(&fs::read(at("views/views.json")).unwrap()).unwrap();
    assert_eq!(poses.len(), 10);
    poses.reverse();
    fs::write(at("back.json"), serde_json::to_string(&poses).unwrap()).unwrap();
    render(&at("back.json"), &at("back"));
    refused(&at("back"), &["view 00001 was drawn", "off keyframe 0", "trajectory.json"]);
    // A shift of half a millimetre is rounding.
    poses.reverse();
    poses.iter_mut().for_each(|rows| rows[0][3] += 5e-4);
    fs::write(at("near.json"), serde_json::to_string(&poses).unwrap()).unwrap();
    render(&at("near.json"), &at("near"));
    score(&at("near"));
}
