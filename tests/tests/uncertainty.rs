//! How far predicted decibels may be off, from a run to its intervals, and what does not belong together.

use crate::common::*;
use serde_json::Value;
use std::fs;

#[test]
fn errors_of_one_run_become_intervals_of_another_and_tell_where_to_measure() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let dataset = text(tiny_dataset());
    let reconstruct = |name: &str, method: &str, protocol: &str, seed: &str| {
        let run = at(name);
        let all = [
            "reconstruct",
            dataset,
            "--out",
            text(&run),
            "--method",
            method,
            "--protocol",
            protocol,
            "--seed",
            seed,
            "--device",
            "cpu",
        ];
        let quick: &[&str] = if method == "corf-gs" { &["--set", "iterations_per_keyframe=5"] } else { &[] };
        corf_ok(&[&all[..], quick].concat());
        run
    };
    // Five of ten keyframes are held out: as many as an honest fit needs; the other five are to be judged.
    let [half, rest] = ["1", "2"].map(|fold| format!("trajectory:parts=2,gap_keyframes=0,fold={fold}"));
    let [learnt, other] = ["1", "2"].map(|seed| reconstruct(&format!("half{seed}"), "corf-gs", &half, seed));
    let [judged, beside] = ["1", "2"].map(|seed| reconstruct(&format!("rest{seed}"), "corf-gs", &rest, seed));
    let file = at("calibration.json");
    let file = text(&file);
    corf_ok(&["uncertainty", "fit", text(&learnt), "--out", file, "--ensemble", text(&other), "--device", "cpu"]);
    let fitted: Value = serde_json::from_str(&fs::read_to_string(file).unwrap()).unwrap();
    assert_eq!(
        (fitted["method"].as_str(), fitted["keyframes"].as_u64(), fitted["ensemble"]["runs"].as_u64()),
        (Some("corf-gs"), Some(5), Some(2))
    );
    assert!((0.5..1.0).contains(&fitted["coverage_left_out"].as_f64().unwrap()), "{fitted}");

    let figure = at("figure.svg");
    let check =
        ["uncertainty", "check", text(&judged), "--calibration", file, "--device", "cpu", "--json", "--figure", text(&figure)];
    let said = corf_ok(&[&check[..], &["--ensemble", text(&beside)]].concat());
    let said: Value = serde_json::from_str(&said).unwrap();
    for who in ["calibrated", "ensemble"] {
        let share = said[who]["coverage"].as_f64().unwrap();
        assert!((0.3..=1.0).contains(&share) && said[who]["half_width_db"].as_f64().unwrap() > 0.0, "{said}");
        assert_eq!(said[who]["frames"].as_array().unwrap().len(), 5);
    }
    // Without an ensemble its numbers are written as well.
    let numbers = at("numbers.json");
    corf_ok(&["uncertainty", "check", text(&judged), "--calibration", file, "--device", "cpu", "--out", text(&numbers)]);
    let written: Value = serde_json::from_str(&fs::read_to_string(&numbers).unwrap()).unwrap();
    assert!(written["calibrated"] == said["calibrated"] && written.get("ensemble").is_none(), "{written}");
    let svg = fs::read_to_string(&figure).unwrap();
    assert!(svg.matches("<image ").count() == 3 && svg.contains(">standard deviation</text>"), "{svg}");

    // Rendering with it writes a standard deviation for every pixel; the way's poses are told apart by what they would bring.
    let (views, poses) = (at("views"), tiny_dataset().join("trajectory.json"));
    corf_ok(&["render", text(&judged), "--poses", text(&poses), "--out", text(&views), "--uncertainty", file, "--device", "cpu"]);
    let deviations = corf_scene::io::read_exr_f32(views.join("std_db/00001.exr")).unwrap();
    assert!(deviations.pixels().iter().all(|d| d.is_finite() && *d > 0.0));
    let next = [
        "uncertainty",
        "next",
        text(&judged),
        "--calibration",
        file,
        "--poses",
        text(&poses),
        "--count",
        "3",
        "--device",
        "cpu",
        "--json",
    ];
    let worth: Value = serde_json::from_str(&corf_ok(&next)).unwrap();
    let gains: Vec<f64> = worth.as_array().unwrap().iter().map(|w| w["gain_db"].as_f64().unwrap()).collect();
    assert!(gains.len() == 3 && gains.windows(2).all(|pair| pair[0] >= pair[1]) && gains[0] > 0.0, "{worth}");

    // What would flatter itself, and what is of something else.
    let out = at("no.json");
    let tested = reconstruct("tested", "corf-gs", "test", "1");
    corf_refuses(
        &["uncertainty", "fit", text(&tested), "--out", text(&out), "--device", "cpu"],
        &["protocol \"test\"", "--protocol validation"],
    );
    corf_refuses(
        &["uncertainty", "check", text(&learnt), "--calibration", file, "--device", "cpu"],
        &["5 of the 5 keyframes that this run holds out", "--protocol test"],
    );
    corf_refuses(
        &["uncertainty", "check", text(&tested), "--calibration", file, "--device", "cpu"],
        &["1 of the 2 keyframes that this run holds out"],
    );
    let far = at("far.csv");
    fs::write(&far, "x_m,y_m,z_m,yaw_deg\n2.5,1.3,200,0\n").unwrap();
    corf_refuses(
        &["uncertainty", "next", text(&judged), "--calibration", file, "--poses", text(&far), "--device", "cpu"],
        &["outside of the room", "leave these poses out"],
    );
    let few = reconstruct("few", "corf-gs", "validation", "1");
    corf_refuses(
        &["uncertainty", "fit", text(&few), "--out", text(&out), "--device", "cpu"],
        &["1 held-out keyframes are too few"],
    );
    let lookup = reconstruct("lookup", "nearest", "test", "1");
    corf_refuses(
        &["uncertainty", "check", text(&lookup), "--calibration", file, "--device", "cpu"],
        &["errors of corf-gs", "nearest"],
    );
    let same = ["uncertainty", "check", text(&judged), "--calibration", file, "--ensemble", text(&judged), "--device", "cpu"];
    corf_refuses(&same, &["--ensemble", "another seed"]);
    assert!(!out.exists());
}
