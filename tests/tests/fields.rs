//! Fields out and in: exports that other programs read, and reconstructions that begin with theirs.

use crate::common::*;
use corf::files::ply;
use std::fs;
use std::path::Path;

/// The property names and comments of a PLY's header.
fn header(path: &Path) -> (Vec<String>, Vec<String>) {
    let bytes = fs::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap();
    let text = String::from_utf8(bytes[..end].to_vec()).unwrap();
    let lines = |prefix: &str| text.lines().filter_map(|l| l.strip_prefix(prefix)).map(String::from).collect();
    (lines("property float "), lines("comment "))
}

#[test]
fn a_field_goes_out_in_every_format_and_comes_back_as_a_beginning() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let dataset = text(tiny_dataset());
    let run = at("run");
    corf_ok(&["reconstruct", dataset, "--out", text(&run), "--set", "iterations_per_keyframe=10", "--set", "rf_target=\"db\""]);
    let own = ply::read_single(&run.join("optical.ply")).unwrap();
    let n = own.position.len();
    let export = |to: &str, field: &str, file: &str, more: &[&str]| {
        let out = at(file);
        let base = ["field", "export", text(&run), "--to", to, "--field", field, "--out", text(&out), "--json"];
        let said: serde_json::Value = serde_json::from_str(&corf_ok(&[&base[..], more].concat())).unwrap();
        assert_eq!((said["gaussians"].as_u64(), said["antialiased"].as_bool()), (Some(n as u64), Some(true)));
        (out, said)
    };

    let (out, said) = export("ply", "optical", "same.ply", &[]);
    assert!(fs::read(&out).unwrap() == fs::read(run.join("optical.ply")).unwrap(), "the run's own file");
    assert_eq!(said["file_from_world"], serde_json::json!([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]));
    let (out, _) = export("ply", "optical", "wide.ply", &["--pad-sh", "3"]);
    let (properties, comments) = header(&out);
    assert_eq!(properties.iter().filter(|p| p.starts_with("f_rest_")).count(), 45);
    assert!(["SplatRenderMode: mip", "Vertical axis: 0 0 1", "SH degree: 3"].iter().all(|c| comments.iter().any(|l| l == c)));
    assert_eq!(ply::read_single(&out).unwrap(), own.padded(3));

    // One channel of levels becomes three equal ones.
    let (out, said) = export("ply", "rf", "rf.ply", &[]);
    let (radio, grey) = (ply::read_single(&run.join("rf.ply")).unwrap(), ply::read_single(&out).unwrap());
    assert_eq!((radio.appearance.channels, &grey), (1, &radio.in_three_channels()));
    assert!(said["notes"].to_string().contains("background"), "{said}");

    let (out, _) = export("sog-ready-ply", "optical", "sog.ply", &[]);
    assert!(header(&out).1.iter().any(|c| c == "Vertical axis: 0 -1 0"));
    let turned = ply::read_single(&out).unwrap();
    assert!(own.position.iter().zip(&turned.position).all(|([x, y, z], p)| [*x, -z, *y] == *p));
    let (out, said) = export("splat", "optical", "field.splat", &[]);
    assert_eq!(fs::metadata(&out).unwrap().len(), 32 * n as u64);
    assert!(said["notes"].to_string().contains("compensated for the pixel's extent, which the format cannot say"), "{said}");
    let (out, said) = export("spz", "rf", "field.spz", &[]);
    assert_eq!(fs::read(&out).unwrap()[..2], [0x1f, 0x8b]);
    assert_eq!(said["file_from_world"][1], serde_json::json!([0.0, 0.0, 1.0]), "y of the file is z of the world");

    let place = text(&run);
    let refuses =
        |more: &[&str], words: &[&str]| corf_refuses(&[&["field", "export"], more, &["--out", text(&at("no"))]].concat(), words);
    refuses(&[place, "--to", "ply", "--field", "rf", "--pad-sh", "1"], &["--pad-sh 1 is below", "degree 3"]);
    refuses(&[place, "--to", "spz", "--pad-sh", "3"], &["--pad-sh pads a PLY"]);
    refuses(&[dataset, "--to", "ply"], &["no finished run", "corf reconstruct"]);
    let lookup = at("lookup");
    corf_ok(&["reconstruct", dataset, "--out", text(&lookup), "--method", "nearest"]);
    refuses(&[text(&lookup), "--to", "ply"], &["nearest keeps no Gaussians"]);
    assert!(!at("no").exists());
}

#[test]
fn reconstructions_begin_with_gaussians_of_another_program() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let dataset = text(tiny_dataset());
    let run = at("run");
    corf_ok(&["reconstruct", dataset, "--out", text(&run), "--set", "iterations_per_keyframe=30"]);
    let theirs = run.join("optical.ply");
    let from = |out: &Path, more: &[&str]| {
        corf_ok(&[&["reconstruct", dataset, "--out", text(out), "--from", text(&theirs)], more].concat());
        serde_json::from_str::<serde_json::Value>(&fs::read_to_string(out.join("run.json")).unwrap()).unwrap()
    };
    let psnr = |run: &Path, key: &str| {
        let record: serde_json::Value = serde_json::from_str(&corf_ok(&["evaluate", text(run), "--json"])).unwrap();
        record["means"][key].as_f64().unwrap()
    };

    // With a tenth of the steps, a field that another was trained for is better than one that begins with nothing.
    let (with, without) = (at("with"), at("without"));
    let info = from(&with, &["--set", "iterations_per_keyframe=3"]);
    assert_eq!(info["initial_gaussians_sha256"], serde_json::json!(corf_scene::io::sha256_hex(&fs::read(&theirs).unwrap())));
    corf_ok(&["reconstruct", dataset, "--out", text(&without), "--set", "iterations_per_keyframe=3"]);
    assert!(psnr(&with, "psnr_opt") > psnr(&without, "psnr_opt") + 0.5);
    assert!(psnr(&with, "psnr_rf_jet") > psnr(&without, "psnr_rf_jet"));
    // The same command finds it finished, another file does not.
    let again = ["reconstruct", dataset, "--out", text(&with), "--resume", "--set", "iterations_per_keyframe=3", "--from"];
    corf_ok(&[&again[..], &[text(&theirs)]].concat());
    corf_refuses(&[&again[..], &[text(&run.join("coupled.ply"))]].concat(), &["another method, configuration"]);

    // RF-3DGS takes it for its optical stage: geometry and light stay.
    let baseline = at("baseline");
    from(&baseline, &["--method", "rf-3dgs", "--set", "rf_steps=5"]);
    let (a, b) = (ply::read_single(&theirs).unwrap(), ply::read_single(&baseline.join("optical.ply")).unwrap());
    assert_eq!((&b.position, &b.log_scale), (&a.position, &a.log_scale));
    assert_eq!(b.appearance, a.padded(3).appearance);
    assert!(header(&baseline.join("rf.ply")).1.iter().any(|c| c == "SplatRenderMode: default"));
    assert!(header(&baseline.join("rf.ply")).1.iter().any(|c| c == "corf background of f_dc: 0 0 0"), "black, as published");

    let refuses = |file: &Path, more: &[&str], words: &[&str]| {
        let out = at("no");
        corf_refuses(&[&["reconstruct", dataset, "--out", text(&out), "--from", text(file)], more].concat(), words);
        assert!(!out.exists());
    };
    refuses(&theirs, &["--method", "nearest"], &["--from gives Gaussians", "choose corf-gs"]);
    refuses(&at("missing.ply"), &[], &["missing.ply", "cannot read"]);
    let far = at("far.ply");
    let mut field = a.clone();
    field.position.iter_mut().for_each(|p| p[2] += 1000.0);
    let notes = corf::Field::read(&run).unwrap().meta.notes(corf::Antialias::On);
    ply::write_single(&far, &field, corf::device::Modality::Light, &notes).unwrap();
    refuses(&far, &[], &["far.ply: none of its", "the data set's frame"]);
    let (bytes, bad) = (fs::read(&theirs).unwrap(), at("bad.ply"));
    fs::write(&bad, &bytes[..bytes.len() - 7]).unwrap();
    refuses(&bad, &[], &["bad.ply", "truncated"]);
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap();
    let flat = String::from_utf8_lossy(&bytes[..end]).replace("scale_2", "scale_9");
    fs::write(&bad, [flat.as_bytes(), &bytes[end..]].concat()).unwrap();
    refuses(&bad, &[], &["two scales, scale_0 and scale_1"]);
}
