//! A small dataset of known pixels, written, cut short, resumed, tampered with.

use super::*;
use crate::config::{ReceiverConfig, SpectrumKind, SplitConfig};
use crate::keyframe::{DbRange, Modalities};
use crate::trajectory::{TrajectoryConfig, TrajectoryPose, generate};
use crate::{Equirectangular, Error, Light, Pinhole, Radio, Raster, Rigid3, Severity, io};
use glam::DVec3;
use std::path::Path;

const COUNT: usize = 10;

fn poses() -> Vec<TrajectoryPose> {
    let way = TrajectoryConfig {
        waypoints_m: vec![[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]],
        height_m: 1.6,
        height_amplitude_m: 0.1,
        pitch_amplitude_deg: 5.0,
        yaw_amplitude_deg: 10.0,
        speed_m_per_s: 0.5,
    };
    generate(&way, COUNT).unwrap()
}

fn header() -> DatasetHeader {
    DatasetHeader {
        name: "tiny".into(),
        seed: 3,
        modalities: Modalities::BOTH,
        light_camera: Pinhole::from_horizontal_fov(16, 9, 90.0),
        radio_camera: Pinhole::from_horizontal_fov(12, 8, 90.0),
        sphere: Some(Equirectangular { width: 6, height: 3 }),
        exposure_ev: Some(0.5),
        denoiser: None,
        light_adapter: None,
        frequency_hz: Some(60e9),
        transmitter: None,
        receiver: Some(ReceiverConfig::default()),
        on_surfaces: vec![],
        spectrum: Some(SpectrumKind::Mpc),
        quantity: Quantity::PowerPerSteradian,
        dynamic_range_db: 50.0,
        tutorial_range: None,
        materials: vec![],
        sampling_error: None,
        split: SplitConfig { test_every: 4, held_out_segment: Some([5, 2]) },
        stated_split: None,
        objects: vec!["floor".into(), "wall".into()],
        light_from: None,
        scene_sha256: None,
        scene_content_sha256: None,
        config: None,
        scene: None,
        imported: None,
        poses: poses(),
    }
}

fn frame(index: usize) -> KeyframeContent {
    let light = Light {
        image: Raster::from_fn(16, 9, |x, y| [x as u8 * 10, y as u8 * 20, index as u8]),
        depth_m: Some(Raster::from_fn(16, 9, |x, y| if y == 0 { f32::INFINITY } else { 1.0 + x as f32 / 4.0 })),
        surface: Some(Raster::from_fn(16, 9, |x, y| if y == 0 { u32::MAX } else { (x % 2) as u32 })),
        mask: None,
    };
    // Peak of the dataset: keyframe 7, 2e-6 = −56.99 dB.
    let spectrum = Raster::from_fn(12, 8, |x, y| if (x, y) == (5, 4) && index == 7 { 2e-6 } else { 1e-9 * (x * y) as f32 });
    let extras = Extras {
        linear: Some(Raster::from_fn(16, 9, |x, y| [x as f32, y as f32, index as f32])),
        albedo: Some(Raster::from_fn(16, 9, |x, y| [x as f32 / 16.0, y as f32 / 9.0, 0.5])),
        normals: Some(Raster::filled(16, 9, [0.0, 0.0, 1.0])),
        sphere: Some(Raster::from_fn(6, 3, |x, y| 1e-8 * (x + y) as f32)),
        share_in_frame: Some(0.25 + 0.05 * index as f64),
        paths_jsonl: (index == 2).then(|| "{\"tau_s\":1e-8}\n".to_string()),
    };
    KeyframeContent { light: Some(light), radio: Some(Radio { spectrum }), extras }
}

fn written(dir: &Path) -> Dataset {
    let writer = DatasetWriter::create(dir, &header(), false).unwrap();
    (0..COUNT).for_each(|i| writer.write_frame(i, &frame(i)).unwrap());
    writer.finish().unwrap();
    Dataset::open(dir).unwrap()
}

fn text(e: Error) -> String {
    e.to_string()
}

#[test]
fn what_is_written_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let dataset = written(dir.path());
    assert_eq!((dataset.len(), dataset.header()), (COUNT, &header()));
    // 10·log10(2e-6) = −56.99 dB, up to the next decibel.
    assert_eq!(dataset.db_range(), Some(DbRange { min_db: -106.0, max_db: -56.0 }));
    assert_eq!((dataset.test_indices(), dataset.held_out_segment()), (&[0, 4, 8][..], &[5, 6][..]));
    assert_eq!(dataset.train_indices().len(), 7);
    for i in 0..COUNT {
        let (k, f) = (dataset.keyframe(i).unwrap(), frame(i));
        let mut light = f.light.unwrap();
        light.depth_m = light.depth_m.map(|depth| depth.map(|d| if d.is_finite() { *d } else { 0.0 }));
        assert_eq!((k.light, k.radio), (Some(light), f.radio));
        assert_eq!((k.index, k.world_from_camera), (i, poses()[i].world_from_camera));
        assert_eq!(dataset.linear(i).unwrap(), f.extras.linear);
        assert_eq!(dataset.guides(i).unwrap(), [f.extras.albedo, f.extras.normals]);
    }
    assert!(text(dataset.keyframe(COUNT).unwrap_err()).contains("keyframe 10"));
    let findings = validate(dir.path()).unwrap();
    assert!(findings.is_empty(), "{}", findings.iter().map(|f| f.to_string()).collect::<Vec<_>>().join("\n"));
    // Nothing of its making is left.
    assert!(!dir.path().join("progress").exists() && !dir.path().join("dataset.partial.json").exists());
}

#[test]
fn what_a_user_would_have_to_ask_is_answered() {
    let dir = tempfile::tempdir().unwrap();
    let dataset = written(dir.path());
    let asked = [
        ("frames", &["world", "camera", "array", "pose", "colmap", "transforms_json"][..]),
        ("angles", &["zenith", "azimuth", "arrival", "departure", "polarisation_basis"]),
        ("cameras", &["projection", "intrinsics", "sphere"]),
        ("optical", &["image", "exposure", "depth", "depth_empty", "surface"]),
        ("spectrum", &["value", "unit", "formed", "phases", "evaluated", "empty_bin", "rear_half_space", "share_in_frame"]),
        ("rf_image", &["scalar", "range", "colormap", "image"]),
        ("antennas", &["receiver_array", "steering", "receiver_element", "transmit_power"]),
        ("propagation", &["carrier", "time", "coefficient", "materials"]),
        ("sampling", &["positions", "seeds", "specular", "split"]),
        ("files", &["names", "written_by"]),
    ];
    for (topic, questions) in asked {
        for question in questions {
            let answer = dataset.conventions().get(topic).and_then(|t| t.get(*question));
            assert!(answer.is_some_and(|a| !a.is_empty()), "{topic}.{question}");
        }
    }
    // Answers are of this dataset.
    let answer = |topic: &str, question: &str| dataset.conventions()[topic][question].clone();
    assert!(answer("rf_image", "range").contains("-106 to -56 dB"), "{}", answer("rf_image", "range"));
    assert!(answer("antennas", "receiver_array").contains("8 rows x 8 columns"));
    assert!(answer("sampling", "split").contains("index % 4"));
    assert!(answer("propagation", "carrier").contains("60000000000 Hz"));
    let summary = dataset.share_in_frame_summary().unwrap();
    assert_eq!(dataset.share_in_frame().len(), COUNT);
    assert!((summary.mean - 0.475).abs() < 1e-12 && (summary.min, summary.max) == (0.25, 0.7));
    // Paths unpack to what they were.
    assert_eq!(io::read_gzip_text(dir.path().join("rf/paths/00003.jsonl.gz")).unwrap(), frame(2).extras.paths_jsonl.unwrap());
    let json: serde_json::Value = serde_json::from_str(&io::read_text(dir.path().join("dataset.json")).unwrap()).unwrap();
    assert_eq!(json["generator"], format!("corf {}", env!("CARGO_PKG_VERSION")));
    assert!((json["rf_frames"]["peak_db"][7].as_f64().unwrap() + 56.9897).abs() < 1e-3);
}

/// The files of a stored ZIP archive.
fn unzipped(bytes: &[u8]) -> std::collections::BTreeMap<String, Vec<u8>> {
    let number = |at: usize, n: usize| bytes[at..at + n].iter().rev().fold(0usize, |sum, b| sum << 8 | usize::from(*b));
    let (mut at, mut found) = (0, std::collections::BTreeMap::new());
    while bytes[at..].starts_with(b"PK\x03\x04") {
        let (size, name) = (number(at + 22, 4), number(at + 26, 2));
        let start = at + 30 + name;
        found.insert(String::from_utf8(bytes[at + 30..start].to_vec()).unwrap(), bytes[start..start + size].to_vec());
        at = start + size;
    }
    found
}

#[test]
fn a_numpy_archive_holds_the_keyframe_and_says_what_it_is() {
    let dir = tempfile::tempdir().unwrap();
    let dataset = written(dir.path());
    let files = unzipped(&keyframe_npz(&dataset, 4).unwrap());
    let floats = |name: &str| {
        let read = crate::npz::decode_npy(&files[&format!("{name}.npy")], name).unwrap();
        (read.shape, read.values)
    };
    let keyframe = dataset.keyframe(4).unwrap();
    let spectrum: Vec<f64> = keyframe.radio.unwrap().spectrum.pixels().iter().map(|v| f64::from(*v)).collect();
    assert_eq!(floats("spectrum"), (vec![8, 12], spectrum));
    assert_eq!(floats("world_from_camera"), (vec![4, 4], keyframe.world_from_camera.to_rows().concat()));
    let camera = dataset.light_camera();
    assert_eq!(floats("optical_intrinsics").1, [camera.fx, 0.0, camera.cx, 0.0, camera.fy, camera.cy, 0.0, 0.0, 1.0]);
    assert_eq!(floats("db_range").1, [-106.0, -56.0]);
    assert_eq!(floats("depth_m").0, [9, 16]);
    let image = &files["image.npy"];
    let text = String::from_utf8_lossy(image);
    assert!(text.contains("'|u1'") && text.contains("(9, 16, 3)"), "{text}");
    assert!(image.ends_with(keyframe.light.unwrap().image.pixels().as_flattened()), "row by row, channels last");
    // Keyframe 4 is held out; of what is not there, there is no array.
    assert_eq!((files["is_test.npy"].last(), files["is_train.npy"].last()), (Some(&1), Some(&0)));
    assert_eq!(files.len(), 13);
    assert!(files["conventions.npy"].len() > 4 * 5000, "four bytes a character");
}

#[test]
fn the_points_of_the_model_say_where_they_were_seen() {
    let dir = tempfile::tempdir().unwrap();
    let dataset = written(dir.path());
    for (root, camera) in [("optical", dataset.light_camera()), ("rf", dataset.radio_camera())] {
        let read = |name: &str| io::read_text(dir.path().join(format!("{root}/sparse/0/{name}.txt"))).unwrap();
        let numbers = |line: &str| line.split(' ').filter(|f| !f.is_empty()).map(|f| f.parse().unwrap()).collect::<Vec<f64>>();
        let images = read("images");
        let observed: Vec<Vec<f64>> = images.lines().skip(1).skip(1).step_by(2).map(numbers).collect();
        assert_eq!(observed.len(), COUNT);
        let points = read("points3D");
        let mut count = 0;
        for point in points.lines().skip(1).map(numbers) {
            let [id, x, y, z, _, _, _, _, image, place] = point[..] else { panic!("{root}: {point:?}") };
            let index = image as usize - 1;
            assert!(dataset.train_indices().contains(&index), "{root}: a held-out keyframe gives no points");
            let [u, v, named] = observed[index][3 * place as usize..][..3] else { unreachable!() };
            assert_eq!(named, id);
            let pose = dataset.poses()[index].world_from_camera.inverse();
            let at = camera.project(pose.transform_point(DVec3::new(x, y, z))).unwrap();
            // Positions are written to a micrometre.
            assert!((at.x - u).abs() < 1e-3 && (at.y - v).abs() < 1e-3, "{root}: {at} ({u}, {v})");
            count += 1;
        }
        assert!(count > 1000);
        assert_eq!(io::read_text(dir.path().join(format!("{root}/nb-info.json"))).unwrap(), "{\"loader\": \"colmap\"}\n");
    }
}

#[test]
fn the_same_header_and_keyframes_make_the_same_bytes() {
    let dirs = [tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap()];
    let hashes = dirs.each_ref().map(|d| written(d.path()).hash().to_string());
    assert_eq!(hashes[0], hashes[1]);
}

#[test]
fn an_interrupted_run_goes_on_where_it_stopped() {
    let (dir, whole) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let writer = DatasetWriter::create(dir.path(), &header(), false).unwrap();
    (0..6).for_each(|i| writer.write_frame(i, &frame(i)).unwrap());
    assert!(text(writer.finish().unwrap_err()).contains("4 of 10 keyframes"));
    assert!(text(Dataset::open(dir.path()).unwrap_err()).contains("--resume"));
    // What a crash leaves: a keyframe with one file missing, one cut short, one without its record.
    std::fs::remove_file(dir.path().join("rf/spectra/00002.exr")).unwrap();
    std::fs::write(dir.path().join("optical/images/00004.png"), b"\x89PNG").unwrap();
    std::fs::remove_file(dir.path().join("progress/00006.json")).unwrap();

    assert!(text(DatasetWriter::create(dir.path(), &header(), false).unwrap_err()).contains("not empty"));
    let other = DatasetHeader { seed: 4, ..header() };
    assert!(text(DatasetWriter::create(dir.path(), &other, true).unwrap_err()).contains("another configuration"));
    let writer = DatasetWriter::create(dir.path(), &header(), true).unwrap();
    let missing: Vec<usize> = (0..COUNT).filter(|i| !writer.is_complete(*i)).collect();
    assert_eq!(missing, [1, 3, 5, 6, 7, 8, 9]);
    missing.iter().for_each(|i| writer.write_frame(*i, &frame(*i)).unwrap());
    writer.finish().unwrap();
    assert!(validate(dir.path()).unwrap().is_empty());
    // Interrupted or not, the dataset is the same to the byte.
    let hash = Dataset::open(dir.path()).unwrap().hash().to_string();
    assert_eq!(hash, written(whole.path()).hash());
    // A finished dataset resumes to itself; another configuration is still refused.
    let again = DatasetWriter::create(dir.path(), &header(), true).unwrap();
    assert!((0..COUNT).all(|i| again.is_complete(i)));
    again.finish().unwrap();
    assert_eq!(Dataset::open(dir.path()).unwrap().hash(), hash);
    assert!(DatasetWriter::create(dir.path(), &other, true).is_err());
}

#[test]
fn a_folder_of_something_else_is_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("thesis.tex"), "x").unwrap();
    for resume in [false, true] {
        assert!(DatasetWriter::create(dir.path(), &header(), resume).is_err());
    }
    assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    assert!(text(Dataset::open(dir.path()).unwrap_err()).contains("no dataset.json"));
}

#[test]
fn frames_that_are_no_measurements_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    let writer = DatasetWriter::create(dir.path(), &header(), false).unwrap();
    let refused = |change: &dyn Fn(&mut KeyframeContent), expected: &str| {
        let mut f = frame(3);
        change(&mut f);
        let message = text(writer.write_frame(3, &f).unwrap_err());
        assert!(message.contains("keyframe 3") && message.contains(expected), "{message}");
        assert!(!writer.is_complete(3));
    };
    refused(
        &|f| f.radio = Some(Radio { spectrum: Raster::filled(13, 8, 0.0) }),
        "spectrum: is 13x8 pixels where the camera has 12x8",
    );
    refused(&|f| f.light.as_mut().unwrap().image = Raster::filled(9, 16, [0; 3]), "image");
    refused(&|f| f.radio.as_mut().unwrap().spectrum[(2, 3)] = f32::NAN, "pixel (2, 3) is NaN");
    refused(&|f| f.radio.as_mut().unwrap().spectrum[(2, 3)] = -1e-12, "pixel (2, 3)");
    refused(&|f| f.light.as_mut().unwrap().depth_m.as_mut().unwrap()[(1, 1)] = f32::NAN, "pixel (1, 1)");
    refused(&|f| f.extras.linear.as_mut().unwrap()[(1, 1)][2] = f32::INFINITY, "linear");
    refused(&|f| f.extras.albedo = Some(Raster::filled(9, 16, [0.0; 3])), "albedo");
    refused(&|f| f.extras.normals.as_mut().unwrap()[(1, 1)][2] = f32::NAN, "normals");
    assert!(writer.write_frame(COUNT, &frame(0)).is_err());
    let mut bad = header();
    bad.poses[4].world_from_camera.translation.y = f64::NAN;
    let other = tempfile::tempdir().unwrap();
    assert!(text(DatasetWriter::create(other.path(), &bad, false).unwrap_err()).contains("keyframe 4"));
    let silence = Radio { spectrum: Raster::filled(12, 8, 0.0) };
    (0..COUNT).for_each(|i| writer.write_frame(i, &KeyframeContent { radio: Some(silence.clone()), ..frame(i) }).unwrap());
    assert!(text(writer.finish().unwrap_err()).contains("no keyframe received any power"));
    // Nothing could go on with it.
    let left: Vec<_> = std::fs::read_dir(dir.path()).unwrap().map(|entry| entry.unwrap().file_name()).collect();
    assert!(left.is_empty(), "{left:?}");
}

#[test]
fn damaged_files_are_named_with_their_keyframe() {
    let dir = tempfile::tempdir().unwrap();
    let dataset = written(dir.path());
    let put = |name: &str, bytes: &[u8]| std::fs::write(dir.path().join(name), bytes).unwrap();
    let fails = |index: usize, name: &str, expected: &str| {
        let message = text(dataset.keyframe(index).unwrap_err());
        assert!(message.contains(name) && message.contains(&format!("keyframe {index}")), "{message}");
        assert!(message.contains(expected) && message.contains("help: "), "{message}");
    };
    let whole = std::fs::read(dir.path().join("rf/spectra/00001.exr")).unwrap();
    put("rf/spectra/00001.exr", &whole[..whole.len() / 2]);
    fails(0, "rf/spectra/00001.exr", "EXR");
    put("rf/spectra/00002.exr", &io::encode_exr_f32(&Raster::filled(12, 9, 0.0), "Y").unwrap());
    fails(1, "rf/spectra/00002.exr", "is 12x9 pixels where the camera has 12x8");
    put("rf/spectra/00003.exr", &io::encode_exr_f32(&Raster::filled(12, 8, f32::NAN), "Y").unwrap());
    fails(2, "rf/spectra/00003.exr", "pixel (0, 0) is NaN");
    let whole = std::fs::read(dir.path().join("optical/images/00004.png")).unwrap();
    put("optical/images/00004.png", &whole[..whole.len() - 20]);
    fails(3, "optical/images/00004.png", "PNG");
    std::fs::remove_file(dir.path().join("optical/depth/00005.exr")).unwrap();
    fails(4, "optical/depth/00005.exr", "missing");
    dataset.keyframe(5).unwrap();
}

#[test]
fn a_pose_that_is_none_is_named() {
    let dir = tempfile::tempdir().unwrap();
    written(dir.path());
    let path = dir.path().join("trajectory.json");
    let good = std::fs::read_to_string(&path).unwrap();
    let x = format!("{:?}", poses()[6].world_from_camera.translation.x);
    assert!(good.contains(&x));
    for (bad, expected) in [("NaN", "row 0, column 3 of the pose is NaN"), ("null", "NaN"), ("-Infinity", "keyframe 6")] {
        std::fs::write(&path, good.replacen(&x, bad, 1)).unwrap();
        let message = text(Dataset::open(dir.path()).unwrap_err());
        assert!(message.contains("trajectory.json: keyframe 6") && message.contains(expected), "{message}");
    }
    std::fs::write(&path, good.replacen("\"index\": 3", "\"index\": 2", 1)).unwrap();
    assert!(text(Dataset::open(dir.path()).unwrap_err()).contains("keyframe 3"));
    std::fs::write(&path, &good[..good.len() / 2]).unwrap();
    assert!(text(Dataset::open(dir.path()).unwrap_err()).contains("trajectory.json:"));
}

#[test]
fn the_validator_finds_tampering_and_what_would_mislead_other_readers() {
    let dir = tempfile::tempdir().unwrap();
    written(dir.path());
    let tampered = |name: &str, change: &dyn Fn(&str) -> String, expected: &str| {
        let path = dir.path().join(name);
        let before = std::fs::read(&path).ok();
        let text = before.as_ref().map(|b| String::from_utf8_lossy(b).into_owned()).unwrap_or_default();
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, change(&text)).unwrap();
        let findings = validate(dir.path()).unwrap();
        let found = findings.iter().any(|f| f.severity == Severity::Error && f.to_string().contains(expected));
        assert!(found, "{name}: {expected} not in {findings:?}");
        match before {
            Some(bytes) => std::fs::write(&path, bytes).unwrap(),
            None => std::fs::remove_file(&path).unwrap(),
        }
    };
    let replace = |from: &'static str, to: &'static str| move |t: &str| t.replacen(from, to, 1);
    tampered("rf/paths/00003.jsonl.gz", &|t| t.to_string() + " ", "SHA-256");
    tampered("rf/test_index.txt", &replace("00001\n", ""), "is not the split");
    tampered("dataset.json", &replace("isotropic elements", "patch elements"), "conventions are not those of its header");
    tampered("optical/sparse/0/cameras.txt", &replace("PINHOLE", "SIMPLE_PINHOLE"), "PINHOLE camera");
    tampered("rf/sparse/0/images.txt", &replace("00001.png\n\n", "00001.png\n"), "two each");
    // What is empty now was the list of points of a training image.
    let forgotten = |t: &str| {
        let points = t.split_once("00002.png\n").unwrap().1.lines().next().unwrap();
        assert!(!points.is_empty());
        t.replacen(points, "", 1)
    };
    tampered("rf/sparse/0/images.txt", &forgotten, "its tracks name");
    tampered("rf/sparse/0/images.txt", &replace("00001.png\n\n", "00001.png\n1 2\n"), "not followed by a line");
    tampered("optical/nb-info.json", &replace("colmap", "nerfstudio"), "loader is not colmap");
    tampered("rf/sparse/0/images.txt", &replace("00002.png", "00003.png"), "names 00003.png");
    tampered("rf/sparse/0/points3D.txt", &|_| "# none\n".into(), "no point");
    tampered("optical/transforms.json", &replace("\"frames\"", "\"camera_model\": \"PINHOLE\", \"frames\""), "camera_model");
    tampered("optical/transforms.json", &replace("\"none\"", "\"up\""), "orientation_override");
    tampered("rf/transforms.json", &replace("val_filenames", "validation_filenames"), "val_filenames");
    tampered("rf/train_index.txt", &replace("00002\n", ""), "is not the split");
    tampered("optical/depth/00001.png", &|_| "x".into(), "would take it for the image");
    tampered("rf/point_cloud.ply", &|_| "ply".into(), "Brush starts from");
    // A pose moved by a millimetre.
    let z = format!("{:?}", poses()[3].world_from_camera.translation.z);
    let moved = format!("{:?}", poses()[3].world_from_camera.translation.z + 1e-3);
    tampered("optical/transforms.json", &|t| t.replacen(&z, &moved, 1), "frame 3 has another pose");
    assert!(validate(dir.path()).unwrap().is_empty());
    // An RF image that is no longer the spectrum's, even with its own hash put right.
    let image = dir.path().join("rf/images/00001.png");
    let (old, new) = (std::fs::read(&image).unwrap(), io::encode_png(&Raster::filled(12, 8, [1, 2, 3])).unwrap());
    std::fs::write(&image, &new).unwrap();
    let json = dir.path().join("dataset.json");
    let fixed = std::fs::read_to_string(&json).unwrap().replace(&io::sha256_hex(&old), &io::sha256_hex(&new));
    std::fs::write(&json, fixed).unwrap();
    assert!(validate(dir.path()).unwrap().iter().any(|f| f.what.contains("Jet image")));
}

#[test]
fn colmap_and_opengl_conventions_agree_with_the_pose() {
    let dir = tempfile::tempdir().unwrap();
    let dataset = written(dir.path());
    let pose = dataset.poses()[2].world_from_camera;
    // A world point seen by keyframe 2, put through the numbers in the text files alone.
    let point = pose.transform_point(DVec3::new(0.3, -0.2, 2.5));
    let images = io::read_text(dir.path().join("optical/sparse/0/images.txt")).unwrap();
    let line = images.lines().find(|l| l.ends_with("00003.png")).unwrap();
    let f: Vec<f64> = line.split_whitespace().skip(1).take(7).map(|v| v.parse().unwrap()).collect();
    // Hamilton quaternion (w, x, y, z) as a rotation matrix, written out.
    let [w, x, y, z] = [f[0], f[1], f[2], f[3]];
    let r = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ];
    let p = point.to_array();
    let camera: [f64; 3] = std::array::from_fn(|i| (0..3).map(|k| r[i][k] * p[k]).sum::<f64>() + f[4 + i]);
    for (got, expected) in camera.iter().zip([0.3, -0.2, 2.5]) {
        assert!((got - expected).abs() < 1e-9, "{camera:?}");
    }
    let json: serde_json::Value =
        serde_json::from_str(&io::read_text(dir.path().join("optical/transforms.json")).unwrap()).unwrap();
    let m: [[f64; 4]; 4] = serde_json::from_value(json["frames"][2]["transform_matrix"].clone()).unwrap();
    // The same point in OpenGL camera axes: y up, z backward.
    let gl = [0.3, 0.2, -2.5, 1.0];
    for i in 0..3 {
        assert!(((0..4).map(|k| m[i][k] * gl[k]).sum::<f64>() - p[i]).abs() < 1e-9);
    }
}

#[test]
fn points_lie_on_what_the_training_keyframes_see() {
    let dir = tempfile::tempdir().unwrap();
    let dataset = written(dir.path());
    let train: Vec<Rigid3> = dataset.train_indices().iter().map(|i| dataset.poses()[*i].world_from_camera.inverse()).collect();
    let camera = dataset.light_camera();
    for root in ["optical", "rf"] {
        let text = io::read_text(dir.path().join(root).join("sparse/0/points3D.txt")).unwrap();
        let points: Vec<Vec<f64>> = text
            .lines()
            .filter(|l| !l.starts_with('#'))
            .map(|l| l.split_whitespace().map(|v| v.parse().unwrap()).collect())
            .collect();
        assert!(points.len() > 1000, "{root}: {}", points.len());
        for p in points.iter().step_by(97) {
            let seen = train.iter().any(|camera_from_world| {
                let c = camera_from_world.transform_point(DVec3::new(p[1], p[2], p[3]));
                // In the test's frames the depth of column x is 1 + x/4.
                camera
                    .project(c)
                    .is_some_and(|uv| (c.z - (1.0 + uv.x.floor() / 4.0)).abs() < 1e-4 && (uv.x.fract() - 0.5).abs() < 1e-3)
            });
            assert!(seen, "{root}: {p:?}");
        }
    }
}
