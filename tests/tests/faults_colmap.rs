//! COLMAP models with rigs or in parts, captures and scenes far from the origin, and PLY files of other programs: the right value, or a message that
//! says where.

use crate::common::*;
use corf::files::ply::{self, ForeignField};
use corf_scene::dataset::Dataset;
use glam::DVec3;
use serde_json::Value;
use std::fs;
use std::path::{Path, PathBuf};

fn fault(name: &str) -> Option<PathBuf> {
    shared(&format!("faults3/{name}"))
}

/// Imports a COLMAP capture; what was said, and the data set.
fn import(source: &Path, out: &Path, more: &[&str]) -> (String, Dataset) {
    let arguments = [&["dataset", "import", text(source), "--from", "colmap", "--out", text(out)], more].concat();
    let output = corf(&arguments);
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{arguments:?}\n{said}");
    (said, Dataset::open(out).unwrap())
}

/// What a command says on standard error, whatever comes of it.
fn said(arguments: &[&str]) -> String {
    String::from_utf8(corf(arguments).stderr).unwrap()
}

/// The words of every warning of coordinates too far out.
const FAR: &str = "from the origin";

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn rigs_give_the_poses_that_colmap_reads() {
    // Place and direction of view, as pycolmap 4.2.1 reads these files.
    let by_pycolmap: [([f64; 3], [f64; 3]); 6] = [
        ([2.0, 0.0, 1.5], [1.0, 0.0, 0.0]),
        ([-1.0, 1.732050808, 1.5], [-0.727760305, 0.674179288, 0.125885764]),
        ([-1.0, -1.732050808, 1.5], [0.075618045, -0.987822605, 0.135972105]),
        ([2.073757685, 0.192509231, 1.5], [0.819152044, -0.573576436, 0.0]),
        ([-1.182075974, 1.639614017, 1.528351006], [-0.213587538, 0.975825531, 0.04631302]),
        ([-0.806698036, -1.785324399, 1.547919467], [-0.497377929, -0.867532657, -0.001511909]),
    ];
    let folder = tempfile::tempdir().unwrap();
    for variant in ["text-turned", "text-drift"] {
        let Some(source) = fault(&format!("rig-poses/{variant}")) else { return };
        let (said, dataset) = import(&source, &folder.path().join(variant), &[]);
        assert!(said.contains("poses are those of frames and rigs") && said.contains("images.txt"), "{said}");
        assert_eq!(dataset.len(), 6);
        for (pose, (place, view)) in dataset.poses().iter().zip(by_pycolmap) {
            let pose = pose.world_from_camera;
            assert!(pose.translation.distance(DVec3::from(place)) < 2e-9, "{variant}: {}", pose.translation);
            assert!(pose.rotation.z_axis.distance(DVec3::from(view)) < 2e-9, "{variant}: {}", pose.rotation.z_axis);
        }
        let imported = dataset.header().imported.as_ref().unwrap();
        assert!(["sparse/0/rigs.txt", "sparse/0/frames.txt"].iter().all(|name| imported.sources.contains_key(*name)));
    }
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn no_image_of_a_model_is_lost_without_a_word() {
    let Some(source) = fault("colmap-part/no-empty-lines") else { return };
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("out");
    corf_refuses(
        &["dataset", "import", text(&source), "--from", "colmap", "--out", text(&out)],
        &["images.txt:2", "X Y POINT3D_ID", "empty line"],
    );
    assert!(!out.exists());
    let source = fault("colmap-part/two-models").unwrap();
    let (said, dataset) = import(&source, &out, &[]);
    assert_eq!(dataset.len(), 2);
    assert!(said.contains("6 pictures have no pose") && said.contains("00002.png"), "{said}");
    assert!(said.contains("sparse/1 holds a further model") && said.contains("--images"), "{said}");
    // The note's command imports the other model.
    let images = source.join("images");
    let (said, dataset) = import(&source.join("sparse/1"), &folder.path().join("other"), &["--images", text(&images)]);
    assert_eq!(dataset.len(), 6);
    assert!(said.contains("2 pictures have no pose"), "{said}");
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn captures_far_from_the_origin_are_moved_or_told() {
    let Some(at_origin) = fault("far-from-origin/at-origin") else { return };
    let folder = tempfile::tempdir().unwrap();
    let out = |name: &str| folder.path().join(name);
    let (words, reference) = import(&at_origin, &out("origin"), &["--offset", "auto"]);
    assert!(!words.contains("taken off") && reference.header().offset_m().is_none(), "a room stays where it is: {words}");
    assert!(!words.contains(FAR), "{words}");
    let same_but_for = |dataset: &Dataset, shift: DVec3| {
        for (a, b) in dataset.poses().iter().zip(reference.poses()) {
            let (a, b) = (a.world_from_camera, b.world_from_camera);
            // Doubles of five million metres have steps of a nanometre.
            assert!((a.translation + shift - b.translation).length() < 1e-8, "{} {}", a.translation, b.translation);
            assert!((a.rotation - b.rotation).to_cols_array().iter().all(|v| v.abs() < 1e-12));
        }
    };
    // Of a national grid: kept with a warning in every command that uses it, or moved.
    let grid = fault("far-from-origin/national-grid-a").unwrap();
    let (words, kept) = import(&grid, &out("kept"), &[]);
    assert!(words.contains(FAR) && words.contains("31.2 mm") && words.contains("--offset auto"), "{words}");
    let shift = reference.poses()[0].world_from_camera.translation - kept.poses()[0].world_from_camera.translation;
    let kept_at = out("kept");
    fs::create_dir(out("full")).unwrap();
    fs::write(out("full").join("a"), "").unwrap();
    for command in [
        &["reconstruct", text(&kept_at), "--out", text(&out("full")), "--set", "depth.prior=none"][..],
        &["dataset", "export", text(&kept_at), "--to", "nerfstudio", "--out", text(&out("full"))],
    ] {
        assert!(said(command).contains(FAR), "{command:?}");
    }
    assert!(corf_ok(&["dataset", "validate", text(&kept_at)]).contains(FAR));
    let (words, moved) = import(&grid, &out("moved"), &["--offset", "auto"]);
    assert!(!words.contains(FAR) && words.contains("was taken off all positions"), "{words}");
    let offset = DVec3::from(moved.header().offset_m().unwrap());
    assert!((offset % 100.0).length() == 0.0 && offset.max_element() > 4e5, "{offset}");
    same_but_for(&moved, shift + offset);
    assert!(!corf_ok(&["dataset", "validate", text(&out("moved"))]).contains(FAR));
    let export = out("exported");
    let words = said(&["dataset", "export", text(&out("moved")), "--to", "nerfstudio", "--out", text(&export)]);
    assert!(
        words.contains("data set's frame") && words.contains(&format!("({}, {}, {})", offset.x, offset.y, offset.z)),
        "{words}"
    );
    let transforms: Value = serde_json::from_str(&fs::read_to_string(export.join("transforms.json")).unwrap()).unwrap();
    assert_eq!(transforms["corf_offset_m"], serde_json::json!(offset.to_array()));
    let images = fs::read_to_string(out("moved").join("optical/sparse/0/images.txt")).unwrap();
    assert!(images.contains("was taken off the original positions"), "{images}");
    // By numbers, which are recorded as they were given.
    let (_, by_hand) = import(&grid, &out("by-hand"), &["--offset", "85230,446520.5,-3"]);
    assert_eq!(by_hand.header().offset_m(), Some([85_230.0, 446_520.5, -3.0]));
    same_but_for(&by_hand, shift + DVec3::new(85_230.0, 446_520.5, -3.0));
    // Beyond what can be kept: moved by itself, or refused where it was told not to be.
    let utm = fault("far-from-origin/utm").unwrap();
    let (words, moved) = import(&utm, &out("utm"), &[]);
    assert!(words.contains("cannot be kept") && !words.contains(FAR), "{words}");
    let offset = DVec3::from(moved.header().offset_m().unwrap());
    assert!(offset.max_element() > 4e6, "{offset}");
    let shift = reference.poses()[0].world_from_camera.translation - moved.poses()[0].world_from_camera.translation;
    same_but_for(&moved, shift);
    assert!(moved.poses().iter().all(|p| p.world_from_camera.translation.abs().max_element() < 100.0));
    let no = out("no");
    let refused = ["dataset", "import", text(&utm), "--from", "colmap", "--out", text(&no), "--offset", "0,0,0"];
    corf_refuses(&refused, &["1e6 from the origin", "--offset"]);
    corf_refuses(&[&refused[..7], &["--offset", "1,2"]].concat(), &["three numbers"]);
    corf_refuses(&[&refused[..7], &["--offset", "nan,0,0"]].concat(), &["finite"]);
}

/// A room of two rooms' walls with its corner at `origin`, OBJ in full decimals; the offset that its scene file says, if it says one.
fn room(folder: &Path, origin: [f64; 3], offset: Option<[f64; 3]>) -> PathBuf {
    let local = |p: [f64; 3]| if offset.is_some() { p } else { [0, 1, 2].map(|k| p[k] + origin[k]) };
    let at = |p: [f64; 3]| [0, 1, 2].map(|k| p[k] + origin[k]);
    let [x, y, _] = local([0.0; 3]);
    let way = format!(
        "[trajectory]\nheight_m = {}\nwaypoints_m = [[{}, {}], [{}, {}], [{}, {}]]\n",
        local([0.0, 0.0, 1.5])[2],
        x + 1.0,
        y + 1.0,
        x + 4.0,
        y + 1.0,
        x + 4.0,
        y + 3.0
    );
    let boxes: Boxes<'_> = &[
        ("floor", "stone", at([0.0, 0.0, -0.125]), at([6.0, 5.0, 0.0]), CLOSED),
        ("wall", "wall", at([5.0, 0.0, 0.0]), at([5.125, 5.0, 3.0]), CLOSED),
    ];
    let scene = boxes_scene(folder, boxes, local([0.5, 2.25, 2.0]), &way);
    if let Some(offset) = offset {
        let body = fs::read_to_string(&scene).unwrap();
        fs::write(&scene, body.replace("file = \"room.obj\"\n", &format!("file = \"room.obj\"\noffset_m = {offset:?}\n")))
            .unwrap();
    }
    scene
}

#[test]
fn scenes_far_from_the_origin_are_moved_or_told() {
    let folder = tempfile::tempdir().unwrap();
    let place = |name: &str| {
        let path = folder.path().join(name);
        fs::create_dir(&path).unwrap();
        path
    };
    let origin = [446_520.062_5, 85_230.5, 12.25];
    let near = room(&place("near"), [0.0; 3], None);
    let far = room(&place("far"), origin, None);
    let moved = room(&place("moved"), origin, Some(origin));
    let gains = |scene: &Path, rx: [f64; 3]| {
        let rx = format!("--rx={},{},{}", rx[0], rx[1], rx[2]);
        let output = corf(&["paths", text(scene), &rx, "--depth", "2"]);
        let words = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(0), "{words}");
        let value: Value = serde_json::from_slice(&output.stdout).unwrap();
        let gains: Vec<String> = value["paths"].as_array().unwrap().iter().map(|p| p["a"].to_string()).collect();
        (gains, words)
    };
    let (expected, words) = gains(&near, [3.5, 3.0, 1.5]);
    assert!(expected.len() > 3 && !words.contains(FAR), "{expected:?} {words}");
    let (found, words) = gains(&moved, [3.5, 3.0, 1.5]);
    assert!(!words.contains(FAR), "{words}");
    // The corners are the same to the last bit of single precision.
    assert_eq!(found, expected);
    assert!(gains(&far, [0, 1, 2].map(|k| origin[k] + [3.5, 3.0, 1.5][k])).1.contains(FAR));
    let at = |p: [f64; 3]| format!("--rx={},{},{}", p[0] + origin[0], p[1] + origin[1], p[2] + origin[2]);
    let out = |name: &str| folder.path().join(name);
    let rx = at([3.5, 3.0, 1.5]);
    let config = far.with_file_name("tiny.toml");
    fs::write(
        &config,
        "name = \"d\"\nscene = \"room.toml\"\nkeyframes = 2\n[optical]\nwidth = 8\nheight = 8\nsamples_per_pixel = 1\n[rf]\nwidth = 8\nheight = 8\n\
         directions = 100000\nphotons = 50000\ntransmission = false\n",
    )
    .unwrap();
    for command in [
        &["paths", text(&far), &rx, "--no-transmission"][..],
        &["spectrum", text(&far), &rx, "--out", text(&out("spectrum")), "--size", "8x8", "--no-diffuse", "--no-transmission"],
        &["coverage", text(&far), "--out", text(&out("coverage")), "--cell", "2", "--height", "13.75", "--no-transmission"],
        &["dataset", "generate", text(&config), "--out", text(&out("generated"))],
        &["scene", "export", text(&far), "--to", "sionna", "--out", text(&out("sionna"))],
    ] {
        let words = said(command);
        assert!(words.contains(FAR) && words.contains("offset_m"), "{command:?}: {words}");
    }
    assert!(corf_ok(&["scene", "info", text(&far)]).contains(FAR));
    assert!(corf_ok(&["scene", "validate", text(&far)]).contains(FAR));
    for command in ["info", "validate"] {
        assert!(!corf_ok(&["scene", command, text(&moved)]).contains(FAR), "{command}");
    }
    assert!(
        said(&["scene", "export", text(&moved), "--to", "sionna", "--out", text(&out("moved-sionna"))]).contains("446520.0625")
    );
    // The data set keeps it.
    let config = moved.with_file_name("tiny.toml");
    fs::copy(far.with_file_name("tiny.toml"), &config).unwrap();
    let generated = out("generated-moved");
    corf_ok(&["dataset", "generate", text(&config), "--out", text(&generated)]);
    let header: Value = serde_json::from_str(&fs::read_to_string(generated.join("dataset.json")).unwrap()).unwrap();
    assert_eq!(header["header"]["scene"]["scene"]["offset_m"], serde_json::json!(origin));
    assert!(header["conventions"]["frames"]["world"].as_str().unwrap().contains("446520.0625"));
    let body = fs::read_to_string(&moved).unwrap();
    fs::write(&moved, body.replace("offset_m = [446520.0625", "offset_m = [1e300")).unwrap();
    corf_refuses(&["paths", text(&moved), "--rx=1,1,1"], &["scene.offset_m", "metres"]);
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn ply_files_of_other_programs_are_read_in_every_form_or_refused() {
    let Some(plain) = fault("ply-of-others/plain.ply") else { return };
    let read = |name: &str| -> ForeignField { ply::read_foreign(&plain.with_file_name(name)).unwrap() };
    let reference = read("plain.ply");
    assert_eq!(read("ascii.ply"), reference);
    let coloured = read("extra-uchar.ply");
    assert_eq!(
        (&coloured.gaussians, coloured.unread),
        (&reference.gaussians, ["red", "green", "blue"].map(String::from).to_vec())
    );
    // Mip-Splatting's own meaning of its column, from the bytes: the last of every row's floats.
    let bytes = fs::read(plain.with_file_name("filter-3d-not-fused.ply")).unwrap();
    let body = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let rows = reference.gaussians.position.len();
    let width = (bytes.len() - body) / rows;
    let filtered = read("filter-3d-not-fused.ply");
    assert!(filtered.filter_3d && filtered.unread.is_empty());
    let logistic = |x: f32| 1.0 / (1.0 + (-f64::from(x)).exp());
    for i in 0..rows {
        let at = body + (i + 1) * width - 4;
        let filter = f64::from(f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()));
        assert!(filter > 0.0);
        let (mut before, mut after) = (1.0, 1.0);
        for k in 0..3 {
            let s2 = (2.0 * f64::from(reference.gaussians.log_scale[i][k])).exp();
            (before, after) = (before * s2, after * (s2 + filter * filter));
            let expected = 0.5 * (s2 + filter * filter).ln();
            assert!((f64::from(filtered.gaussians.log_scale[i][k]) - expected).abs() < 1e-6, "{i}");
        }
        let expected = logistic(reference.gaussians.appearance.opacity_logit[i]) * (before / after).sqrt();
        let found = logistic(filtered.gaussians.appearance.opacity_logit[i]);
        assert!((found / expected - 1.0).abs() < 1e-6, "{i}: {found} {expected}");
    }
}

/// The command says what was made of a file's columns, and a fused field is what comes of one that was not.
#[cfg(feature = "slow")]
#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn a_reconstruction_begins_with_the_filtered_gaussians() {
    let Some(capture) = fault("ply-of-others/capture") else { return };
    let folder = tempfile::tempdir().unwrap();
    let data = folder.path().join("data");
    import(&capture, &data, &[]);
    let begin = |name: &str| {
        let file = capture.with_file_name(name);
        let out = folder.path().join(file.file_stem().unwrap());
        let output = corf(&[
            "reconstruct",
            text(&data),
            "--out",
            text(&out),
            "--set",
            "depth.prior=none",
            "--set",
            "iterations_per_keyframe=1",
            "--from",
            text(&file),
        ]);
        let words = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(0), "{words}");
        (fs::read(out.join("optical.ply")).unwrap(), words)
    };
    let (plain, _) = begin("plain.ply");
    assert!(begin("ascii.ply").0 == plain);
    let (coloured, words) = begin("extra-uchar.ply");
    assert!(coloured == plain && words.contains("red and 2 more columns was not read"), "{words}");
    let (filtered, words) = begin("filter-3d-not-fused.ply");
    assert!(filtered != plain && words.contains("filter_3D was applied"), "{words}");
}
