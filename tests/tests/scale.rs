//! `corf bench scale`: points, tables and plots of every axis, going on, and what it refuses.

use crate::common::{corf_ok, corf_refuses, text, tiny_config};
use serde_json::Value;
use std::fs;

/// The command with an output folder, everything as small as it goes.
fn scale<'a>(out: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    let fixed = ["bench", "scale", "--quick", "--device", "cpu", "--size", "96x54", "--rf", "48x32", "--out", out];
    [&fixed[..], more].concat()
}

#[test]
fn every_axis_gives_points_a_table_and_a_plot() {
    let folder = tempfile::tempdir().unwrap();
    let (out, config) = (folder.path().join("scale"), tiny_config(folder.path(), 10));
    let steps = ["--axis", "gaussians,pixels", "--gaussians", "300,1200", "--pixels", "48x27,96x54"];
    let table = corf_ok(&scale(text(&out), &steps));
    assert!(table.contains("| 1200 |") && table.contains("| 1296 |") && table.contains("*exponent*"), "{table}");
    // Other axes into the same folder, one command each.
    let traced =
        ["--resume", "--axis", "triangles,receivers", "--config", text(&config), "--subdivisions", "0", "--receivers", "1,3"];
    corf_ok(&scale(text(&out), &traced));
    let answer = corf_ok(&scale(text(&out), &["--resume", "--json", "--axis", "keyframes", "--keyframes", "8,10"]));
    let answer: Value = serde_json::from_str(&answer).unwrap();
    let points = answer["points"].as_array().unwrap();
    assert_eq!(points.len(), 9);
    let of = |axis: &str, key: &str| -> Vec<f64> {
        points.iter().filter(|p| p["axis"] == axis).map(|p| p["measured"][key].as_f64().unwrap()).collect()
    };
    assert!(of("gaussians", "step_ms").iter().chain(&of("pixels", "step_ms")).all(|ms| *ms > 0.0));
    assert!(of("gaussians", "visible")[1] > 2.0 * of("gaussians", "visible")[0], "four times the Gaussians");
    assert!(of("triangles", "light_s")[0] > 0.0 && of("triangles", "radio_s")[0] > 0.0);
    for (axis, key) in [("receivers", "receivers_s"), ("receivers", "total_s"), ("keyframes", "total_s")] {
        let seconds = of(axis, key);
        assert!(0.0 < seconds[0] && seconds[0] < seconds[1], "{axis}, {key}: {seconds:?}");
    }
    let shared = of("receivers", "radio_once_s");
    assert_eq!(shared[0], shared[1], "what is done once is one measurement");
    assert!(points.iter().all(|p| p["provenance"]["commit"].is_string() && p["settings"].is_object()));
    for axis in ["gaussians", "pixels", "triangles", "receivers", "keyframes"] {
        assert!(fs::read_to_string(out.join(format!("{axis}.svg"))).unwrap().contains("</svg>"));
    }
    // Nothing is left to do: no point is touched, and the table is the same.
    let read = |name: &str| fs::read(out.join(name)).unwrap();
    let (point, before) = (read("points/gaussians-1200.json"), read("scale.md"));
    corf_ok(&scale(text(&out), &[&["--resume"], &steps[..]].concat()));
    assert!(read("points/gaussians-1200.json") == point && read("scale.md") == before);
    // Other settings, or a folder that is full, are refused and change nothing.
    let other = ["--resume", "--axis", "keyframes", "--keyframes", "8", "--keyframe-memory-mb", "7"];
    corf_refuses(&scale(text(&out), &other), &["keyframes-8.json", "was measured with", "another --out"]);
    corf_refuses(&scale(text(&out), &steps), &["not empty", "--resume"]);
    fs::write(out.join("points/pixels-7.json"), "{}").unwrap();
    corf_refuses(&scale(text(&out), &[&["--resume"], &steps[..]].concat()), &["pixels-7.json"]);
    assert!(read("scale.md") == before);
}

#[test]
fn sizes_that_make_no_sense_are_refused_before_anything_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("scale");
    for (more, words) in [
        (&["--axis", "pixels", "--gaussians", "5"][..], &["--gaussians", "add gaussians to --axis"][..]),
        (&["--gaussians", "0"], &["--gaussians", "at least 1"]),
        (&["--gaussians", "900000000"], &["--gaussians", "at most"]),
        (&["--subdivisions", "40"], &["--subdivisions", "at most 6"]),
        (&["--pixels", "96"], &["640x480"]),
        (&["--axis", "time"], &["time", "keyframes"]),
        (&["--axis", "receivers", "--config", "no/such/file.toml"], &["no/such/file.toml"]),
        (&["--keyframe-memory-mb", "99999999999"], &["keyframe_memory_mb", "at most"]),
    ] {
        corf_refuses(&scale(text(&out), more), words);
    }
    // Levels of the pyramid would have too few pixels.
    let tiny = ["bench", "scale", "--quick", "--device", "cpu", "--size", "16x9", "--axis", "keyframes", "--out", text(&out)];
    corf_refuses(&tiny, &["pyramid_levels"]);
    assert!(!out.join("points/keyframes-8.json").exists());
}
