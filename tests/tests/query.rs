//! `corf query`: aggregates of a field at any poses, against what `corf evaluate` says of the held-out keyframes.

use crate::common::*;
use corf_scene::dataset::Dataset;
use corf_scene::model::ARRAY_FROM_CAMERA;
use corf_scene::{Raster, io};
use serde_json::Value;
use std::collections::BTreeMap;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

/// Files hold spectra as f32, which is off by 6e-8, or 3e-7 dB.
const TOLERANCE: f64 = 1e-6;

fn run() -> &'static Path {
    static RUN: OnceLock<(tempfile::TempDir, PathBuf)> = OnceLock::new();
    let (_, run) = RUN.get_or_init(|| {
        let folder = tempfile::tempdir_in(env!("CARGO_TARGET_TMPDIR")).unwrap();
        let run = folder.path().join("run");
        corf_ok(&["reconstruct", text(tiny_dataset()), "--out", text(&run), "--set", "iterations_per_keyframe=20"]);
        (folder, run)
    });
    run
}

/// Columns of a CSV by their names; empty fields are none.
fn columns(text: &str) -> BTreeMap<String, Vec<Option<f64>>> {
    let mut lines = text.lines();
    let names: Vec<&str> = lines.next().unwrap().split(',').collect();
    let rows: Vec<Vec<Option<f64>>> =
        lines.map(|line| line.split(',').map(|f| (!f.is_empty()).then(|| f.parse().unwrap())).collect()).collect();
    names.iter().enumerate().map(|(i, name)| ((*name).to_owned(), rows.iter().map(|row| row[i]).collect())).collect()
}

/// Σ S·Ω over a camera's pixels.
fn total(dataset: &Dataset, spectrum: &Raster<f32>) -> f64 {
    let camera = dataset.radio_camera();
    let power = |i: usize| {
        let (x, y) = (i % camera.width, i / camera.width);
        f64::from(spectrum[(x, y)]) * camera.pixel_solid_angle_sr(x, y)
    };
    (0..camera.width * camera.height).map(power).sum()
}

/// What `corf evaluate` says of a run's held-out keyframes, and what `corf query` says of the same poses; `has_power` where spectra are power per
/// steradian.
fn compare(run: &Path, dataset: &Path, folder: &Path, has_power: bool) {
    let trajectory = dataset.join("trajectory.json");
    let dataset = Dataset::open(dataset).unwrap();
    let predictions = folder.join("predictions");
    corf_ok(&["evaluate", text(run), "--write-predictions", text(&predictions)]);
    let record: Value = serde_json::from_str(&fs::read_to_string(run.join("metrics.json")).unwrap()).unwrap();
    let found = columns(&corf_ok(&["query", text(run), "--poses", text(&trajectory)]));
    assert_eq!(found["index"].len(), dataset.len());
    let frames = record["frames"].as_array().unwrap();
    assert!(!frames.is_empty());
    for frame in frames {
        let index = frame["index"].as_u64().unwrap() as usize;
        let of = |column: &str| found[column][index].unwrap();
        let said = |key: &str| frame[key].as_f64().unwrap();
        let near = |a: f64, b: f64, what: &str| assert!((a - b).abs() < TOLERANCE, "keyframe {index}, {what}: {a} and {b}");
        // The beam that the prediction chooses, and the rate that it expects.
        assert_eq!(of("best_beam"), said("chosen_beam"));
        near(of("rate_bps_hz"), said("predicted_rate_bps_hz"), "rate");
        assert_eq!(of("outage") == 1.0, of("rate_bps_hz") < 1.0);
        // The power of the prediction as it was written, and its error against what was observed.
        let predicted = io::read_exr_f32(predictions.join(format!("linear/{:05}.exr", index + 1))).unwrap();
        let observed = dataset.keyframe(index).unwrap().radio.unwrap().spectrum;
        assert_eq!([found["path_gain_db"][index], found["rssi_dbm"][index]].map(|v| v.is_some()), [has_power; 2]);
        if has_power {
            near(of("path_gain_db"), 10.0 * total(&dataset, &predicted).log10(), "written power");
            let error = (of("path_gain_db") - 10.0 * total(&dataset, &observed).log10()).abs();
            near(error, said("total_power_error_db"), "power");
        }
        // The strongest pixel of what was written.
        let camera = dataset.radio_camera();
        let direction = |i: usize| ARRAY_FROM_CAMERA.transform_vector(camera.pixel_direction(i % camera.width, i / camera.width));
        let strongest = predicted.pixels().iter().copied().fold(0.0, f32::max);
        let at = predicted.pixels().iter().position(|p| *p == strongest).unwrap();
        near(of("peak_azimuth_deg"), direction(at).y.atan2(direction(at).x).to_degrees(), "azimuth");
        near(of("peak_elevation_deg"), direction(at).z.asin().to_degrees(), "elevation");
        let sums = (0..camera.width * camera.height).fold([0.0; 3], |[re, im, all], i| {
            let (u, w) =
                (direction(i), f64::from(observed.pixels()[i]) * camera.pixel_solid_angle_sr(i % camera.width, i / camera.width));
            let azimuth = u.y.atan2(u.x);
            [re + w * azimuth.cos(), im + w * azimuth.sin(), all + w]
        });
        let spread = (-2.0 * (sums[0].hypot(sums[1]) / sums[2]).ln()).sqrt().to_degrees();
        near((of("azimuth_spread_deg") - spread).abs(), said("azimuth_spread_error_deg"), "spread");
    }
}

#[test]
fn a_field_of_gaussians_says_at_held_out_keyframes_what_its_evaluation_says() {
    let folder = tempfile::tempdir().unwrap();
    compare(run(), tiny_dataset(), folder.path(), true);
}

#[test]
fn so_do_a_field_of_emitters_and_a_lookup_on_the_spectra_of_beams() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (config, dataset) = (tiny_cached_config(folder.path(), 10), at("bartlett"));
    let base = ["dataset", "generate", text(&config), "--out", text(&dataset), "--light-from", text(tiny_dataset())];
    corf_ok(&[&base[..], &["--set", "rf.spectrum=bartlett"]].concat());
    for (method, more) in [
        ("corf-array", &["--set", "light.iterations_per_keyframe=5", "--set", "iterations_per_keyframe=5"][..]),
        ("nearest", &[]),
    ] {
        let run = at(method);
        let base = ["reconstruct", text(&dataset), "--out", text(&run), "--method", method, "--device", "cpu"];
        corf_ok(&[&base[..], more].concat());
        let scratch = at(&format!("{method}-scratch"));
        fs::create_dir(&scratch).unwrap();
        compare(&run, &dataset, &scratch, false);
    }
    let said = corf(&["query", text(&at("nearest")), "--poses", text(&dataset.join("trajectory.json"))]);
    let said = String::from_utf8(said.stderr).unwrap();
    assert!(said.contains("rssi_dbm is empty: the spectra are of beams"), "{said}");
}

#[test]
fn poses_come_in_every_layout_and_answers_in_both() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let dataset = Dataset::open(tiny_dataset()).unwrap();
    let (mut csv, mut tum) = ("qw,qx,qy,qz,x_m,y_m,z_m,time_s\n".to_owned(), "# timestamp tx ty tz qx qy qz qw\n".to_owned());
    for pose in dataset.poses() {
        let (q, p) = (glam::DQuat::from_mat3(&pose.world_from_camera.rotation), pose.world_from_camera.translation);
        csv += &format!("{},{},{},{},{},{},{},{}\n", q.w, q.x, q.y, q.z, p.x, p.y, p.z, pose.time_s);
        tum += &format!("{} {} {} {} {} {} {} {}\n", pose.time_s, p.x, p.y, p.z, q.x, q.y, q.z, q.w);
    }
    fs::write(at("poses.csv"), csv).unwrap();
    fs::write(at("poses.tum"), tum).unwrap();
    let ask = |poses: &Path| columns(&corf_ok(&["query", text(run()), "--poses", text(poses), "--device", "cpu"]));
    let of_json = ask(&tiny_dataset().join("trajectory.json"));
    for poses in [at("poses.csv"), at("poses.tum")] {
        let other = ask(&poses);
        for (name, values) in &of_json {
            for (a, b) in values.iter().zip(&other[name]) {
                // Rotations come by way of quaternions: rounding moves a Gaussian's edge by less than a pixel's rounding.
                assert!((a.unwrap() - b.unwrap()).abs() < 1e-3, "{name}: {a:?} and {b:?}");
            }
        }
    }
    // NPZ holds what CSV holds, and JSON as well.
    let poses = text(&at("poses.csv")).to_owned();
    let out = at("answers.npz");
    let said = corf_ok(&["query", text(run()), "--poses", &poses, "--out", text(&out), "--target-rate", "30"]);
    assert!(said.contains("10 poses") && said.contains("100.0 %") && said.contains("below 30 bit/s/Hz"), "{said}");
    assert!(fs::read(&out).unwrap().starts_with(b"PK"));
    let said: Value =
        serde_json::from_str(&corf_ok(&["query", text(run()), "--poses", &poses, "--json", "--tx-power", "30"])).unwrap();
    let columns = &said["columns"];
    assert_eq!(columns["best_beam"].as_array().unwrap().len(), 10);
    let [gain, rssi] = ["path_gain_db", "rssi_dbm"].map(|name| columns[name][4].as_f64().unwrap());
    assert!((rssi - gain - 30.0).abs() < 1e-9);
    // The view of `corf render` takes them too.
    corf_ok(&["render", text(run()), "--poses", &poses, "--out", text(&at("pictures"))]);
    assert!(at("pictures/jet/00010.png").is_file());
}

#[test]
fn what_is_no_pose_and_what_is_outside_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let poses = folder.path().join("poses.csv");
    let refuses = |body: &str, more: &[&str], words: &[&str]| {
        fs::write(&poses, body).unwrap();
        corf_refuses(&[&["query", text(run()), "--poses", text(&poses)], more].concat(), words);
    };
    let names = "x_m,y_m,z_m,yaw_deg\n";
    refuses(&format!("{names}5,3,1.6,0\n5,nan,1.6,0\n"), &[], &["poses.csv:3", "y_m is \"nan\""]);
    refuses(&format!("{names}5,3,1.6,0\n500,3,1.6,0\n"), &[], &["pose 1", "outside of the room", "--anywhere"]);
    refuses("x_m,y_m,z_m,heading\n5,3,1.6,0\n", &[], &["\"heading\" is no column of poses", "yaw_deg"]);
    refuses("x_m,y_m,z_m\n5,3,1.6\n", &[], &["which way a pose looks"]);
    refuses(names, &[], &["names no pose"]);
    let one = format!("{names}5,3,1.6,0\n");
    refuses(&one, &["--out", "answers.xlsx"], &["--out FILE.csv or --out FILE.npz"]);
    refuses(&one, &["--out", ".csv"], &["an ending without a name"]);
    refuses(&one, &["--target-rate", "-1"], &["--target-rate"]);
    refuses(&one, &["--tx-power", "nan"], &["--tx-power"]);
    refuses(&one, &["--poses-in", "capture"], &["was not imported"]);
    fs::write(&poses, format!("{names}500,3,1.6,0\n")).unwrap();
    let far = columns(&corf_ok(&["query", text(run()), "--poses", text(&poses), "--anywhere"]));
    assert_eq!(far["x_m"], [Some(500.0)]);
}
