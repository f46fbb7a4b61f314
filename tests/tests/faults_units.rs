//! Numbers of other programs keep their units, or are refused: depth, levels, flags; and what is no regular file is refused at once.

use crate::common::*;
use corf_scene::color;
use corf_scene::dataset::Dataset;
use corf_scene::io;
use corf_scene::npz::{Array, Values};
use corf_scene::{Raster, Rigid3};
use glam::DVec3;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};

const SIZE: (usize, usize) = (16, 12);
const SPECTRUM: (usize, usize) = (60, 40);

/// A capture of four keyframes in the plain layout, with folders beside it for what a test adds.
struct Capture {
    folder: tempfile::TempDir,
}

impl Capture {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let capture = Self { folder };
        let keyframes: Vec<serde_json::Value> = (0..4)
            .map(|i| {
                let pose = Rigid3 { translation: DVec3::new(i as f64, 0.0, 1.5), ..Rigid3::IDENTITY };
                serde_json::json!({ "file": format!("{:05}", i + 1), "world_from_camera": pose.to_rows() })
            })
            .collect();
        capture.put("room/trajectory.json", serde_json::json!({ "keyframes": keyframes }).to_string().as_bytes());
        capture.put("room/camera.json", br#"{"width": 16, "height": 12, "fx": 8, "fy": 8, "cx": 8, "cy": 6}"#);
        let image = Raster::from_fn(SIZE.0, SIZE.1, |x, y| [(x * 16) as u8, (y * 20) as u8, 90]);
        capture.put_each("room/images", "png", |_| io::encode_png(&image).unwrap());
        capture
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn put(&self, name: &str, bytes: &[u8]) {
        let path = self.path(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, bytes).unwrap();
    }

    fn put_each(&self, folder: &str, ending: &str, bytes: impl Fn(usize) -> Vec<u8>) {
        (0..4).for_each(|i| self.put(&format!("{folder}/{:05}.{ending}", i + 1), &bytes(i)));
    }

    /// `corf dataset import` into the folder `out`: exit code and messages.
    fn import(&self, out: &str, more: &[&str]) -> (Option<i32>, String) {
        let (source, out) = (self.path("room"), self.path(out));
        let output = corf(&[&["dataset", "import", text(&source), "--from", "corf-folder", "--out", text(&out)], more].concat());
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    }

    /// An import that is refused with all these words, and leaves nothing.
    fn refuses(&self, more: &[&str], words: &[&str]) {
        let (code, said) = self.import("refused", more);
        assert_eq!(code, Some(2), "{more:?}\n{said}");
        words.iter().for_each(|word| assert!(said.contains(word), "{more:?} does not say \"{word}\":\n{said}"));
        assert!(!self.path("refused").join("dataset.json").exists() && !said.contains("panicked"), "{said}");
    }
}

/// A `.npy` file of so many rows and columns.
fn npy(descr: &str, (columns, rows): (usize, usize), data: &[u8]) -> Vec<u8> {
    let empty = Array::new("x", &[rows, columns], Values::F32(vec![0.0; rows * columns])).to_npy();
    let mut bytes = empty[..empty.len() - 4 * rows * columns].to_vec();
    let at = bytes.windows(3).position(|w| w == b"<f4").unwrap();
    bytes[at..at + 3].copy_from_slice(descr.as_bytes());
    bytes.extend(data);
    bytes
}

#[test]
fn depth_of_whole_numbers_needs_its_unit() {
    let capture = Capture::new();
    let pixels = SIZE.0 * SIZE.1;
    let whole = |descr: &str, number: &[u8]| npy(descr, SIZE, &number.repeat(pixels));
    let depth = capture.path("depth");
    let flag = ["--depth", text(&depth)];
    for (descr, number) in [
        ("<u2", 4000u16.to_le_bytes().to_vec()),
        (">u2", 4000u16.to_be_bytes().to_vec()),
        ("<i2", 4000i16.to_le_bytes().to_vec()),
        ("<u4", 4000u32.to_le_bytes().to_vec()),
        ("<i4", 4000i32.to_le_bytes().to_vec()),
        ("<i8", 4000i64.to_le_bytes().to_vec()),
        ("<u8", 4000u64.to_le_bytes().to_vec()),
    ] {
        capture.put_each("depth", "npy", |_| whole(descr, &number));
        capture.refuses(&flag, &["00001.npy", "whole numbers", "--depth-unit"]);
        let out = format!("ds{}", descr.replace('<', "l").replace('>', "b"));
        let (code, said) = capture.import(&out, &[&flag[..], &["--depth-unit", "mm"]].concat());
        assert_eq!(code, Some(0), "{descr}: {said}");
        let depth_m = Dataset::open(capture.path(&out)).unwrap().keyframe(0).unwrap().light.unwrap().depth_m.unwrap();
        assert!(depth_m.pixels().iter().all(|d| *d == 4.0), "{descr}");
    }
    // In whatever unit: a room has no such depths.
    capture.refuses(&[&flag[..], &["--depth-unit", "m"]].concat(), &["4000 m", "no room has", "--depth-unit"]);
    capture.refuses(&[&flag[..], &["--depth-unit", "0.1"]].concat(), &["400 m", "no room has"]);
    for unit in ["0", "-1", "nan", "inf", "1e300", "1e-300", "yard"] {
        capture.refuses(&[&flag[..], &[&format!("--depth-unit={unit}")]].concat(), &["--depth-unit"]);
    }
}

#[test]
fn floats_and_pictures_of_depth_are_metres_and_millimetres_unless_said_otherwise() {
    let capture = Capture::new();
    let floats = |value: f32| Array::new("x", &[SIZE.1, SIZE.0], Values::F32(vec![value; SIZE.0 * SIZE.1])).to_npy();
    let depth = capture.path("depth");
    let flag = ["--depth", text(&depth)];
    let read = |out: &str| Dataset::open(capture.path(out)).unwrap().keyframe(1).unwrap().light.unwrap().depth_m.unwrap()[(0, 0)];
    capture.put_each("depth", "npy", |_| floats(4.0));
    assert_eq!((capture.import("a", &flag).0, read("a")), (Some(0), 4.0));
    capture.put_each("depth", "npy", |_| floats(4000.0));
    capture.refuses(&flag, &["4000 m", "no room has"]);
    assert_eq!((capture.import("b", &[&flag[..], &["--depth-unit", "mm"]].concat()).0, read("b")), (Some(0), 4.0));
    // One map of many in another unit, one pixel of a map.
    capture.put_each("depth", "npy", |i| floats(if i == 3 { 4000.0 } else { 4.0 }));
    capture.refuses(&flag, &["00004.npy", "no room has"]);
    capture.put_each("depth", "npy", |_| {
        let mut values = vec![4.0; SIZE.0 * SIZE.1];
        values[7] = 4000.0;
        Array::new("x", &[SIZE.1, SIZE.0], Values::F32(values)).to_npy()
    });
    capture.refuses(&flag, &["largest depth is 4000 m"]);
    fs::remove_dir_all(&depth).unwrap();
    capture.put_each("depth", "png", |_| io::encode_png16(&Raster::filled(SIZE.0, SIZE.1, 4000u16)).unwrap());
    assert_eq!((capture.import("c", &flag).0, read("c")), (Some(0), 4.0));
    assert_eq!((capture.import("d", &[&flag[..], &["--depth-unit", "0.0002"]].concat()).0, read("d")), (Some(0), 0.8));
}

#[test]
fn a_data_set_whose_depth_no_room_has_fails_its_validation() {
    let capture = Capture::new();
    let depth = capture.path("depth");
    capture.put_each("depth", "exr", |_| io::encode_exr_f32(&Raster::filled(SIZE.0, SIZE.1, 4.0), "Z").unwrap());
    let (code, said) = capture.import("ds", &["--depth", text(&depth)]);
    assert_eq!(code, Some(0), "{said}");
    // As an older version imported it: the file and its hash.
    let (file, json) = (capture.path("ds/optical/depth/00003.exr"), capture.path("ds/dataset.json"));
    let old = fs::read(&file).unwrap();
    let new = io::encode_exr_f32(&Raster::filled(SIZE.0, SIZE.1, 4000.0), "Z").unwrap();
    fs::write(&file, &new).unwrap();
    let listed = fs::read_to_string(&json).unwrap().replace(&io::sha256_hex(&old), &io::sha256_hex(&new));
    fs::write(&json, listed).unwrap();
    let ds = capture.path("ds");
    let output = corf(&["dataset", "validate", text(&ds)]);
    let said = String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("00003.exr") && said.contains("median depth is 4000 m"), "{said}");
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn the_given_depth_in_millimetres_is_read_as_such_or_refused() {
    let Some(given) = shared("faults3/depth-in-millimetres") else { return };
    let folder = tempfile::tempdir().unwrap();
    let (whole, picture) = (given.join("npy-uint16"), given.join("png-16"));
    let import = |source: &Path, out: &Path, more: &[&str]| {
        let depth = source.join("depth");
        let named = ["dataset", "import", text(source), "--from", "colmap", "--depth", text(&depth), "--out", text(out)];
        let output = corf(&[&named[..], more].concat());
        (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
    };
    let median = |out: &Path| {
        let mut depth = Dataset::open(out).unwrap().keyframe(0).unwrap().light.unwrap().depth_m.unwrap().into_vec();
        depth.sort_by(f32::total_cmp);
        depth[depth.len() / 2]
    };
    let (a, b) = (folder.path().join("a"), folder.path().join("b"));
    let (code, said) = import(&whole, &a, &[]);
    assert!(code == Some(2) && said.contains("whole numbers"), "{said}");
    let (code, said) = import(&whole, &a, &["--depth-unit", "mm"]);
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(import(&picture, &b, &[]).0, Some(0));
    assert_eq!((median(&a), median(&b)), (4.0, 4.0));
}

/// Levels all over the range, more of them low.
fn levels() -> Raster<f32> {
    Raster::from_fn(SPECTRUM.0, SPECTRUM.1, |x, y| ((x + SPECTRUM.0 * y) as f32 / (SPECTRUM.0 * SPECTRUM.1 - 1) as f32).powf(1.5))
}

/// The levels that an import read, in dB from -110 to -40, and what it said.
fn imported(capture: &Capture, out: &str, radio: &Path) -> (Raster<f32>, String) {
    let (code, said) = capture.import(out, &["--rf", text(radio), "--rf-db=-110,-40", "--rf-camera", "90"]);
    assert_eq!(code, Some(0), "{said}");
    let spectrum = Dataset::open(capture.path(out)).unwrap().keyframe(0).unwrap().radio.unwrap().spectrum;
    (spectrum.map(|p| if *p > 0.0 { 10.0 * p.log10() } else { -110.0 }), said)
}

#[test]
fn jets_of_other_programs_are_told_apart_and_their_error_is_stated() {
    let capture = Capture::new();
    type Table = fn(usize) -> [f32; 3];
    let tables: [(&str, Table); 3] = [
        ("OpenCV's Jet", |i| color::jet_of_trapezoids(i as f32 / 255.0)),
        ("MATLAB's Jet", |i| color::jet_of_trapezoids((i + 1) as f32 / 256.0)),
        ("matplotlib's Jet of 256", |i| color::jet(i as f32 / 255.0)),
    ];
    for (k, (name, table)) in tables.iter().enumerate() {
        let radio = capture.path(&format!("jet{k}"));
        let picture = levels().map(|s| table(((s * 256.0) as usize).min(255)).map(|v| (255.0 * v).round() as u8));
        capture.put_each(&format!("jet{k}"), "png", |_| io::encode_png(&picture).unwrap());
        let (db, said) = imported(&capture, &format!("ds{k}"), &radio);
        assert!(said.contains(name) && said.contains("levels are right to 0.27 dB"), "{said}");
        // But for the part of the range in which matplotlib's is one colour.
        let off = db.pixels().iter().zip(levels().into_vec()).filter(|(_, s)| !(0.105..0.13).contains(s));
        let worst = off.map(|(db, s)| (db - (-110.0 + 70.0 * s)).abs()).fold(0.0, f32::max);
        assert!(worst <= 0.28, "{name}: {worst} dB");
    }
    let viridis = capture.path("viridis");
    let picture = levels().map(|s| color::viridis(*s).map(color::quantize8));
    capture.put_each("viridis", "png", |_| io::encode_png(&picture).unwrap());
    capture.refuses(&["--rf", text(&viridis), "--rf-db=-110,-40", "--rf-camera", "90"], &["viridis", "neither grey nor Jet"]);
}

#[test]
fn numbers_beyond_all_bounds_are_refused_before_anything_is_written() {
    let capture = Capture::new();
    let (exr, png) = (capture.path("exr"), capture.path("png"));
    let power = levels().map(|s| 1e-11 * 1e7f32.powf(*s));
    capture.put_each("exr", "exr", |_| io::encode_exr_f32(&power, "Y").unwrap());
    capture.put_each("png", "png", |_| io::encode_png16(&levels().map(|s| (65535.0 * s) as u16)).unwrap());
    let numbers = ["nan", "inf", "-inf", "-1", "0", "1e300", "1e-300"];
    let with = |radio: &Path, flags: &[&str]| {
        let words: Vec<&str> = flags.iter().map(|f| f.split('=').next().unwrap()).take(1).collect();
        capture.refuses(&[&["--rf", text(radio)][..], flags, &["--rf-camera", "90"]].concat(), &words);
    };
    for number in numbers {
        with(&exr, &[&format!("--frequency-hz={number}")]);
        with(&exr, &[&format!("--dynamic-range-db={number}")]);
        with(&exr, &[&format!("--scale={number}")]);
        for camera in [number.to_owned(), format!("{number},30,30,20"), format!("30,{number},30,20")] {
            if camera.parse() != Ok(90.0) {
                capture.refuses(&["--rf", text(&exr), &format!("--rf-camera={camera}")], &["--rf-camera"]);
            }
        }
    }
    for number in ["nan", "inf", "1e300", "-1e300"] {
        capture.refuses(&["--rf", text(&exr), &format!("--rf-camera=30,30,{number},20")], &["--rf-camera"]);
    }
    for range in ["-1e300,0", "-5000,-40", "nan,0", "-110,inf", "0,1e300", "-40,-110", "-40,-40", "0,1e-300"] {
        with(&exr, &[&format!("--rf-db={range}")]);
        with(&png, &[&format!("--rf-db={range}")]);
    }
    // The same numbers within their bounds are taken.
    let (code, said) =
        capture.import("fine", &["--rf", text(&exr), "--rf-camera", "90", "--frequency-hz", "28e9", "--dynamic-range-db", "60"]);
    assert_eq!(code, Some(0), "{said}");
}

#[test]
fn flags_that_would_change_nothing_are_refused_by_name() {
    let capture = Capture::new();
    for flag in [
        "--rf-db=-110,-40",
        "--rf-camera=90",
        "--rf-values=linear",
        "--rf-quantity=unknown",
        "--frequency-hz=60e9",
        "--dynamic-range-db=70",
        "--depth-unit=MM",
    ] {
        capture.refuses(&[flag], &[flag.split('=').next().unwrap(), "help", "leave it out"]);
    }
    let png = capture.path("png");
    capture.put_each("png", "png", |_| io::encode_png16(&levels().map(|s| (65535.0 * s) as u16)).unwrap());
    let pictures = ["--rf", text(&png), "--rf-camera", "90", "--rf-db=-110,-40"];
    capture.refuses(&[&pictures[..], &["--rf-values", "db"]].concat(), &["--rf-values", "pictures"]);
    capture.refuses(&[&pictures[..], &["--dynamic-range-db", "70"]].concat(), &["--dynamic-range-db", "--rf-db"]);
    // Focal lengths of shares of the image, and a word in capitals.
    capture.refuses(&["--rf", text(&png), "--rf-camera=0.5,0.7,0.5,0.5", "--rf-db=-110,-40"], &["--rf-camera", "multiply fx"]);
    let (code, said) = capture.import("auto", &["--offset", "AUTO", "--up=1e300,0,0"]);
    assert_eq!(code, Some(0), "{said}");
    // Maps without any depth.
    let depth = capture.path("depth");
    capture.put_each("depth", "png", |_| io::encode_png16(&Raster::filled(SIZE.0, SIZE.1, 0u16)).unwrap());
    let (code, said) = capture.import("empty", &["--depth", text(&depth)]);
    assert_eq!(code, Some(0), "{said}");
    assert!(said.contains("depth images are empty") && said.contains("--depth") && !said.contains("trajectory"), "{said}");
    assert!(!said.contains(".corf-unfinished"), "{said}");
}

#[test]
fn half_precision_says_what_it_does_not_hold() {
    let capture = Capture::new();
    let radio = capture.path("half");
    // 1e-6 at the most: in half precision sixteen steps, and nothing at all 12 dB below.
    let half = |v: f32| ((v * (1 << 24) as f32).round() as u16).to_le_bytes();
    capture.put_each("half", "npy", |_| {
        let data: Vec<u8> = levels().pixels().iter().flat_map(|s| half(1e-13 * 1e7f32.powf(*s))).collect();
        npy("<f2", SPECTRUM, &data)
    });
    capture.refuses(&["--rf", text(&radio), "--rf-camera", "90"], &["half precision", "-60.2 dB", "float32"]);
}

/// Whether a child ended within ten seconds; it is killed otherwise.
fn ends(mut child: Child) -> Option<i32> {
    let begin = Instant::now();
    while begin.elapsed() < Duration::from_secs(10) {
        if let Some(status) = child.try_wait().unwrap() {
            return status.code();
        }
        std::thread::sleep(Duration::from_millis(10));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    None
}

#[cfg(unix)]
#[test]
fn a_pipe_or_a_device_in_a_files_place_is_refused_at_once() {
    let capture = Capture::new();
    let folder = capture.folder.path();
    fs::create_dir(folder.join("live")).unwrap();
    fs::create_dir(folder.join("rf")).unwrap();
    let special: [&dyn Fn(&Path); 3] = [
        &|path| assert!(Command::new("mkfifo").arg(path).status().unwrap().success()),
        &|path| std::os::unix::fs::symlink("/dev/zero", path).unwrap(),
        &|path| fs::create_dir(path).unwrap(),
    ];
    let [run, live, room, scene] = ["run", "live", "room", "scene"].map(|name| folder.join(name));
    let sample = root().join("scenes/room.toml");
    for make in special {
        let refused = |path: PathBuf, arguments: &[&str]| {
            make(&path);
            let log = fs::File::create(folder.join("log")).unwrap();
            let child = command(arguments).stdout(Stdio::null()).stderr(log).spawn().unwrap();
            let code = ends(child);
            let said = fs::read_to_string(folder.join("log")).unwrap();
            assert_eq!(code, Some(2), "corf {arguments:?}: {said}");
            assert!(said.contains("pipe, socket or device") || said.contains("a folder"), "corf {arguments:?}: {said}");
            if path.is_dir() { fs::remove_dir(&path).unwrap() } else { fs::remove_file(&path).unwrap() }
        };
        refused(live.join("capture.toml"), &["reconstruct", "--follow", text(&live), "--out", text(&run)]);
        let points = folder.join("points.txt");
        refused(points.clone(), &["paths", text(&sample), "--rx-file", text(&points)]);
        let array = folder.join("points.npy");
        refused(array.clone(), &["paths", text(&sample), "--rx-file", text(&array)]);
        refused(scene.clone(), &["paths", text(&scene), "--rx", "1,1,1"]);
        refused(scene.clone(), &["dataset", "generate", text(&scene), "--out", text(&run)]);
        refused(scene.clone(), &["scene", "info", text(&scene)]);
        refused(scene.clone(), &["bench", "run", text(&scene), "--out", text(&run)]);
        refused(scene.clone(), &["bench", "sweep", text(&scene), "--out", text(&run)]);
        refused(scene.clone(), &["paths", text(&sample), "--rx", "1,1,1", "--config", text(&scene)]);
        let trajectory = room.join("trajectory.json");
        let kept = fs::read(&trajectory).unwrap();
        fs::remove_file(&trajectory).unwrap();
        refused(trajectory.clone(), &["dataset", "import", text(&room), "--from", "corf-folder", "--out", text(&run)]);
        fs::write(&trajectory, kept).unwrap();
        let split = ["dataset", "import", text(&room), "--from", "corf-folder", "--out", text(&run), "--split", text(&scene)];
        refused(scene.clone(), &split);
    }
}
