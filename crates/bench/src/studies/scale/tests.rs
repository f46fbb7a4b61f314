//! Tests of records, of what is fitted to them, and of measurements small enough for a test.

use super::*;
use crate::record::provenance::Provenance;
use corf_scene::{Scene, model::Triangle};
use glam::Vec3;

/// A point of the keyframes that grows as if by powers.
fn point(axis: Axis, value: u64, measured: &[(&str, f64)]) -> ScalePoint {
    ScalePoint {
        schema: SCHEMA.to_owned(),
        axis,
        value,
        settings: serde_json::json!({ "optical": [1600, 900] }),
        device: "a device | of some kind".to_owned(),
        measured: measured.iter().map(|(key, v)| ((*key).to_owned(), *v)).collect(),
        provenance: Provenance::here(),
    }
}

#[test]
fn exponents_are_the_slopes_of_logarithms() {
    let grown = |n: u64| {
        let x = n as f64;
        point(Axis::Keyframes, n, &[("total_s", 0.1 * x), ("gaussians", 40.0 * x.sqrt()), ("device_mb", 0.0)])
    };
    let points: Vec<ScalePoint> = [128, 256, 512, 1024].map(grown).to_vec();
    let found = fitted(&points);
    assert_eq!(found.iter().map(|f| f.key).collect::<Vec<_>>(), ["total_s", "gaussians"], "of nothing there is no logarithm");
    for (f, exponent) in found.iter().zip([1.0, 0.5]) {
        assert!((f.exponent - exponent).abs() < 1e-9 && (f.last - exponent).abs() < 1e-9 && f.points == 4, "{f:?}");
    }
    let bent: Vec<ScalePoint> =
        [(1, 1.0), (10, 10.0), (100, 1000.0)].map(|(n, v)| point(Axis::Receivers, n, &[("total_s", v)])).to_vec();
    assert!((fitted(&bent)[0].exponent - 1.5).abs() < 1e-9 && (fitted(&bent)[0].last - 2.0).abs() < 1e-9);
    assert!(fitted(&points[..1]).is_empty(), "one point has no slope");
}

#[test]
fn tables_and_plots_are_made_from_the_records_of_a_folder() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path();
    std::fs::create_dir(out.join("points")).unwrap();
    for (n, s) in [(8, 4.0), (2, 1.0)] {
        let one = point(Axis::Receivers, n, &[("total_s", s), ("radio_once_s", 0.25), ("process_mb", 100.0)]);
        write_json(&out.join(format!("points/receivers-{n}.json")), &one).unwrap();
    }
    let (points, text) = write_results(out).unwrap();
    assert_eq!(points.iter().map(|p| p.value).collect::<Vec<_>>(), [2, 8]);
    assert!(text.contains("| 8 | 4.000 | 0.250 | 100 |") && text.contains("| *exponent* | *1.00* | – | *0.00* |"), "{text}");
    assert!(text.contains(r"a device \| of some kind"), "{text}");
    assert_eq!(std::fs::read_to_string(out.join("scale.md")).unwrap(), text);
    let svg = std::fs::read_to_string(out.join("receivers.svg")).unwrap();
    assert!(svg.starts_with("<svg") && svg.contains("time over receivers") && !out.join("pixels.svg").exists());
    // Again from the same records: the same bytes.
    assert_eq!(write_results(out).unwrap().1, text);
    std::fs::write(out.join("points/receivers-3.json"), "{").unwrap();
    assert!(format!("{:#}", write_results(out).unwrap_err()).contains("receivers-3.json"));
}

#[test]
fn points_that_are_there_are_not_measured_again_and_others_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::create_dir(dir.path().join("points")).unwrap();
    let backend = Backend::Cpu;
    let points = Points { out: dir.path(), backend: &backend };
    let settings = StepSettings { gaussians: 0, light: [24, 16], radio: [16, 16], steps: 2, repeats: 1 };
    points.measure(&ScaleWork::Gaussians(vec![40, 160], settings)).unwrap();
    let before = read(dir.path()).unwrap();
    assert_eq!(before.iter().map(|p| p.value).collect::<Vec<_>>(), [40, 160]);
    assert!(before.iter().all(|p| p.measured["step_ms"] > 0.0 && p.measured["visible"] > 0.0), "{before:?}");
    // A finding that no measurement would give again stays.
    let mut kept = before[0].clone();
    kept.measured.insert("step_ms".to_owned(), 12345.0);
    write_json(&dir.path().join("points/gaussians-40.json"), &kept).unwrap();
    points.measure(&ScaleWork::Gaussians(vec![40, 80], settings)).unwrap();
    let after = read(dir.path()).unwrap();
    assert_eq!(after.iter().map(|p| p.value).collect::<Vec<_>>(), [40, 80, 160]);
    assert_eq!(after[0].measured["step_ms"], 12345.0);
    // The image is what varies along the pixels, and fixed along the Gaussians.
    let other = StepSettings { light: [32, 16], ..settings };
    let error = points.measure(&ScaleWork::Gaussians(vec![40], other)).unwrap_err().to_string();
    assert!(error.contains("gaussians-40.json was measured with") && error.contains("choose another --out"), "{error}");
    let few = StepSettings { gaussians: 40, ..settings };
    points.measure(&ScaleWork::Pixels(vec![[24, 16]], few)).unwrap();
    points.measure(&ScaleWork::Pixels(vec![[24, 16], [48, 32]], StepSettings { light: [99, 99], ..few })).unwrap();
    assert_eq!(read(dir.path()).unwrap().len(), 5);
}

#[test]
fn a_sequence_is_measured_on_its_way() {
    let settings = SequenceSettings { light: [96, 54], radio: [48, 32], iterations_per_keyframe: 4, keyframe_memory_mb: 4000 };
    let mut reported: Vec<(usize, Measured)> = vec![];
    settings
        .measure(&Backend::Cpu, &[10, 14], &mut |n, measured| {
            reported.push((n, measured));
            Ok(())
        })
        .unwrap();
    let of = |k: usize, key: &str| reported[k].1[key];
    assert_eq!(reported.iter().map(|t| t.0).collect::<Vec<_>>(), [10, 14]);
    assert!(of(0, "total_s") > 0.0 && of(1, "total_s") > of(0, "total_s"));
    assert!(of(0, "gaussians") > 100.0, "the drawn room is not reconstructed: {reported:?}");
    assert!((of(1, "per_keyframe_ms") - 1e3 * of(1, "total_s") / 14.0).abs() < 1e-9);
    let recent = 1e3 * (of(1, "total_s") - of(0, "total_s")) / 4.0;
    assert!((of(1, "recent_keyframe_ms") - recent).abs() < 1e-6);
}

#[test]
fn cut_triangles_are_the_same_surface() {
    let scene = Scene {
        positions: vec![Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::new(1.0, 1.0, 0.5)],
        normals: vec![Vec3::Z; 4],
        uvs: vec![[0.0, 0.0], [1.0, 0.0], [0.0, 1.0], [1.0, 1.0]],
        triangles: [[0, 1, 2], [1, 3, 2]].map(|vertices| Triangle { vertices, material: 3, object: 5 }).to_vec(),
        ..Scene::default()
    };
    let area = |s: &Scene| -> f32 {
        let corner = |t: &Triangle, k: usize| s.positions[t.vertices[k] as usize];
        s.triangles.iter().map(|t| 0.5 * (corner(t, 1) - corner(t, 0)).cross(corner(t, 2) - corner(t, 0)).length()).sum()
    };
    let cut = subdivided(&scene, 2);
    assert_eq!((cut.triangles.len(), subdivided(&scene, 0).triangles.len()), (32, 2));
    assert!((area(&cut) / area(&scene) - 1.0).abs() < 1e-5);
    assert!(cut.triangles.iter().all(|t| t.material == 3 && t.object == 5));
    // 5×5 vertices of a square: those of the shared edge are there once.
    assert_eq!((cut.positions.len(), cut.normals.len(), cut.uvs.len(), cut.colors.len()), (25, 25, 25, 0));
    let facing = |t: &Triangle| {
        let [a, b, c] = t.vertices.map(|v| cut.positions[v as usize]);
        (b - a).cross(c - a).z > 0.0
    };
    assert!(cut.triangles.iter().all(facing), "a triangle was turned over");
}
