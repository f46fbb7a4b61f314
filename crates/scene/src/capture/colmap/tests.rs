//! Models written by hand, in both encodings.

use super::*;
use std::fs;

const CAMERAS: &str = "# comment\n3 PINHOLE 640 480 500 510 320 240\n7 OPENCV 640 480 500 510 321 239 -0.1 0.01 0.001 0.002\n";
/// A quarter turn about the camera's z axis, so that the order of the quaternion's components matters; and a name with a space.
const IMAGES: &str = "# two lines an image\n2 0.7071067811865476 0 0 0.7071067811865476 1 2 3 7 b 10.png\n1.5 2.5 -1 3 4 8\n\
                      1 1 0 0 0 -1 0 0 3 b 9.png\n\n";
const POINTS: &str = "8 1.5 -2 3 10 20 30 0.5 1 0 2 1\n";

fn text_model(folder: &Path) {
    fs::create_dir_all(folder.join("sparse/0")).unwrap();
    for (name, text) in [("cameras", CAMERAS), ("images", IMAGES), ("points3D", POINTS)] {
        fs::write(folder.join(format!("sparse/0/{name}.txt")), text).unwrap();
    }
}

fn binary_model(folder: &Path) {
    fs::create_dir_all(folder.join("sparse/0")).unwrap();
    let f = |values: &[f64]| values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let u4 = |v: u32| v.to_le_bytes().to_vec();
    let u8s = |v: u64| v.to_le_bytes().to_vec();
    let cameras = [
        u8s(2),
        u4(3),
        u4(1),
        u8s(640),
        u8s(480),
        f(&[500.0, 510.0, 320.0, 240.0]),
        u4(7),
        u4(4),
        u8s(640),
        u8s(480),
        f(&[500.0, 510.0, 321.0, 239.0, -0.1, 0.01, 0.001, 0.002]),
    ];
    let half = std::f64::consts::FRAC_1_SQRT_2;
    let images = [
        u8s(2),
        u4(2),
        f(&[half, 0.0, 0.0, half, 1.0, 2.0, 3.0]),
        u4(7),
        b"b 10.png\0".to_vec(),
        u8s(1),
        f(&[1.5, 2.5]),
        u8s(8),
        u4(1),
        f(&[1.0, 0.0, 0.0, 0.0, -1.0, 0.0, 0.0]),
        u4(3),
        b"b 9.png\0".to_vec(),
        u8s(0),
    ];
    let points = [u8s(1), u8s(8), f(&[1.5, -2.0, 3.0]), vec![10, 20, 30], f(&[0.5]), u8s(1), u4(2), u4(0)];
    fs::write(folder.join("sparse/0/cameras.bin"), cameras.concat()).unwrap();
    fs::write(folder.join("sparse/0/images.bin"), images.concat()).unwrap();
    fs::write(folder.join("sparse/0/points3D.bin"), points.concat()).unwrap();
}

#[test]
fn text_and_binary_say_the_same_and_poses_are_inverted() {
    let (text, binary) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    text_model(text.path());
    binary_model(binary.path());
    let captures = [&text, &binary].map(|d| read(d.path(), &d.path().join("images"), false).unwrap());
    for (a, b) in captures[0].shots.iter().zip(&captures[1].shots) {
        assert_eq!((&a.name, a.lens), (&b.name, b.lens));
        let [a, b] = [a, b].map(|s| s.world_from_camera.to_rows());
        assert!(a.iter().flatten().zip(b.iter().flatten()).all(|(x, y)| (x - y).abs() < 1e-15));
    }
    assert_eq!(captures[0].points, captures[1].points);
    let [first, second] = captures[0].shots.as_slice() else { panic!("two images") };
    assert_eq!((first.name.as_str(), second.name.as_str()), ("b 9.png", "b 10.png"), "numbers count by their value");
    // Camera_from_world is a shift of -1 along x: the camera stands at +1.
    assert!((first.world_from_camera.translation - DVec3::X).length() < 1e-15);
    // w first: a turn by +90 degrees about z takes the world's x to the camera's y.
    let camera_from_world = second.world_from_camera.inverse();
    assert!((camera_from_world.transform_vector(DVec3::X) - DVec3::Y).length() < 1e-12);
    assert!((camera_from_world.translation - DVec3::new(1.0, 2.0, 3.0)).length() < 1e-12);
    assert_eq!((second.lens.radial, second.lens.tangential), ([-0.1, 0.01, 0.0], [0.001, 0.002]));
    assert_eq!(captures[0].points[0].color, [10, 20, 30]);
}

#[test]
fn every_model_is_read_as_its_parameters_say_or_refused_by_name() {
    let camera = |name: &str, parameters: &[f64]| {
        let model = MODELS.into_iter().find(|m| m.name == name).unwrap();
        assert_eq!(model.parameters, parameters.len(), "{name}");
        Camera { model, width: 10, height: 8, parameters: parameters.to_vec() }.lens("cameras.txt: camera 1")
    };
    let pinhole = |fx, fy| Pinhole { width: 10, height: 8, fx, fy, cx: 5.0, cy: 4.0 };
    assert_eq!(camera("SIMPLE_PINHOLE", &[9.0, 5.0, 4.0]).unwrap(), Lens::plain(pinhole(9.0, 9.0)));
    assert_eq!(camera("PINHOLE", &[9.0, 8.0, 5.0, 4.0]).unwrap(), Lens::plain(pinhole(9.0, 8.0)));
    assert_eq!(camera("SIMPLE_RADIAL", &[9.0, 5.0, 4.0, 0.1]).unwrap().radial, [0.1, 0.0, 0.0]);
    assert_eq!(camera("RADIAL", &[9.0, 5.0, 4.0, 0.1, 0.2]).unwrap().radial, [0.1, 0.2, 0.0]);
    let full = |k4: f64| camera("FULL_OPENCV", &[9.0, 8.0, 5.0, 4.0, 0.1, 0.2, 0.3, 0.4, 0.5, k4, 0.0, 0.0]);
    let lens = full(0.0).unwrap();
    assert_eq!((lens.radial, lens.tangential), ([0.1, 0.2, 0.5], [0.3, 0.4]));
    assert!(full(0.1).is_err());
    for (name, count) in [("OPENCV_FISHEYE", 8), ("SIMPLE_RADIAL_FISHEYE", 4), ("FOV", 5), ("THIN_PRISM_FISHEYE", 12)] {
        let message = camera(name, &vec![1.0; count]).unwrap_err().to_string();
        assert!(message.contains(name) && message.contains("image_undistorter") && message.contains("camera 1"), "{message}");
    }
    assert!(camera("PINHOLE", &[0.0, 8.0, 5.0, 4.0]).is_err() && camera("PINHOLE", &[f64::NAN, 8.0, 5.0, 4.0]).is_err());
}

#[test]
fn faults_name_file_and_line() {
    let dir = tempfile::tempdir().unwrap();
    let model = dir.path().join("sparse/0");
    let refused = |name: &str, text: &str, words: &[&str]| {
        text_model(dir.path());
        fs::write(model.join(name), text).unwrap();
        let message = read(dir.path(), dir.path(), false).unwrap_err().to_string();
        assert!(words.iter().all(|w| message.contains(w)), "{message}");
    };
    refused("cameras.txt", "1 PINHOLE 640 480 500 510 320\n", &["cameras.txt:1", "4 parameters", "3"]);
    refused("cameras.txt", "1 PINHOLES 640 480 500 510 320 240\n", &["cameras.txt:1", "PINHOLES"]);
    refused("cameras.txt", "3 PINHOLE 640 480 500 510 320 240\n", &["names camera 7"]);
    refused("images.txt", "1 1 0 0 0 0 0 0 3\n", &["images.txt:1", "QW QX"]);
    refused("images.txt", "1 1 0 0 zero 0 0 0 3 a.png\n", &["images.txt:1", "\"zero\""]);
    refused("images.txt", "1 nan 0 0 0 0 0 0 3 a.png\n", &["a.png", "quaternion"]);
    refused("images.txt", "1 1 0 0 0 inf 0 0 3 a.png\n", &["a.png", "pose"]);
    refused("images.txt", "# nothing\n", &["no image"]);
    refused("points3D.txt", "1 0 0\n", &["points3D.txt:1"]);
    let none = tempfile::tempdir().unwrap();
    assert!(read(none.path(), none.path(), false).unwrap_err().to_string().contains("sparse/0"));
    // An image that leads out of the folder is refused where images are wanted.
    text_model(dir.path());
    fs::write(model.join("images.txt"), "1 1 0 0 0 0 0 0 3 ../secret.png\n").unwrap();
    assert!(read(dir.path(), dir.path(), true).unwrap_err().to_string().contains("leads out"));
}

#[test]
fn binary_files_that_are_cut_or_lie_about_their_length_are_refused() {
    let dir = tempfile::tempdir().unwrap();
    for name in ["cameras", "images", "points3D"] {
        binary_model(dir.path());
        let path = dir.path().join(format!("sparse/0/{name}.bin"));
        let whole = fs::read(&path).unwrap();
        for cut in [0, 7, 8, 20, whole.len() - 1] {
            fs::write(&path, &whole[..cut]).unwrap();
            assert!(read(dir.path(), dir.path(), false).is_err(), "{name} {cut}");
        }
        fs::write(&path, [&whole[..], b"x"].concat()).unwrap();
        assert!(read(dir.path(), dir.path(), false).unwrap_err().to_string().contains("follow"), "{name}");
        fs::write(&path, [&u64::MAX.to_le_bytes()[..], &whole[8..]].concat()).unwrap();
        assert!(read(dir.path(), dir.path(), false).unwrap_err().to_string().contains("cannot hold"), "{name}");
    }
}

/// A model with two rigs: one whose reference sensor is not the first camera and which has an inertial unit without a pose, one whose reference
/// sensor is an inertial unit. Poses in `images.txt` are wrong but for the first.
const RIG_CAMERAS: &str = "1 PINHOLE 8 6 6 6 4 3\n2 PINHOLE 8 6 6 6 4 3\n5 PINHOLE 8 6 6 6 4 3\n9 EUCM 8 6 1 1 1 1 1 1\n";
const RIGS: &str =
    "# Number of rigs: 2\n4 3 CAMERA 2 CAMERA 1 1 0.8 0 0.6 0 0.5 0 -0.25 IMU 1 0\n7 2 IMU 1 CAMERA 5 1 0.6 0 0 0.8 1 2 3\n";
const FRAMES: &str = "10 4 1 0 0 0 1 2 3 3 CAMERA 1 31 CAMERA 2 30 IMU 1 99\n11 4 0.5 0.5 -0.5 0.5 0 1.5 -2 2 CAMERA 2 40 CAMERA 1 41\n\
                      12 7 0.8 0 0.6 0 -1 0 4 2 IMU 1 1 CAMERA 5 50\n";
const RIG_IMAGES: &str = "30 1 0 0 0 1 2 3 2 b/0.png\n\n31 1 0 0 0 9 9 9 1 a/0.png\n\n40 1 0 0 0 0 0 0 2 b/1.png\n\n41 1 0 0 0 0 0 0 1 a/1.png\n\n\
                          50 1 0 0 0 0 0 0 5 c/0.png\n\n";
/// Name, place and direction of view of each, as pycolmap 4.2.1 reads these files.
const BY_PYCOLMAP: [(&str, [f64; 3], [f64; 3]); 5] = [
    ("a/0.png", [-1.38, -2.0, -3.41], [-0.96, 0.0, 0.28]),
    ("a/1.png", [1.59, 0.38, 1.5], [0.28, 0.96, 0.0]),
    ("b/0.png", [-1.0, -2.0, -3.0], [0.0, 0.0, 1.0]),
    ("b/1.png", [2.0, 0.0, 1.5], [1.0, 0.0, 0.0]),
    ("c/0.png", [6.5408, 1.52, -2.5744], [-0.96, 0.0, 0.28]),
];
/// `rigs.bin` and `frames.bin` of this model as pycolmap 4.2.1 writes them.
const RIGS_BIN: &str = "0200000000000000040000000300000000000000020000000000000001000000019a9999999999e93f0000000000000000333333333333e33f0000000000000000\
    000000000000e03f0000000000000000000000000000d0bf01000000010000000007000000020000000100000001000000000000000500000001333333333333e33f000000000000000000\
    000000000000009a9999999999e93f000000000000f03f00000000000000400000000000000840";
const FRAMES_BIN: &str = "03000000000000000a00000004000000000000000000f03f000000000000000000000000000000000000000000000000000000000000f03f00000000000000\
    4000000000000008400300000000000000010000001f0000000000000000000000020000001e00000000000000010000000100000063000000000000000b00000004000000000000000000e0\
    3f000000000000e03f000000000000e0bf000000000000e03f0000000000000000000000000000f83f00000000000000c002000000000000000100000029000000000000000000000002000000\
    28000000000000000c000000070000009a9999999999e93f0000000000000000333333333333e33f0000000000000000000000000000f0bf000000000000000000000000000010400200000000\
    00000005000000320000000000000001000000010000000100000000000000";

fn rig_model(folder: &Path, changed: &[(&str, &str)]) -> PathBuf {
    let model = folder.join("sparse/0");
    let _ = fs::remove_dir_all(&model);
    fs::create_dir_all(&model).unwrap();
    for (name, text) in [("cameras", RIG_CAMERAS), ("images", RIG_IMAGES), ("rigs", RIGS), ("frames", FRAMES)] {
        let text = changed.iter().find(|(other, _)| *other == name).map_or(text, |(_, text)| text);
        fs::write(model.join(format!("{name}.txt")), text).unwrap();
    }
    model
}

fn bytes_of(hex: &str) -> Vec<u8> {
    (0..hex.len()).step_by(2).map(|i| u8::from_str_radix(&hex[i..i + 2], 16).unwrap()).collect()
}

#[test]
fn poses_come_from_frames_and_rigs_as_colmap_reads_them() {
    let dir = tempfile::tempdir().unwrap();
    let check = |capture: &Capture, what: &str| {
        assert_eq!(capture.shots.len(), BY_PYCOLMAP.len(), "{what}");
        for (shot, (name, place, view)) in capture.shots.iter().zip(BY_PYCOLMAP) {
            assert_eq!(shot.name, name);
            let (at, along) = (shot.world_from_camera.translation, shot.world_from_camera.rotation.z_axis);
            assert!(
                at.distance(DVec3::from(place)) < 1e-12 && along.distance(DVec3::from(view)) < 1e-12,
                "{what} {name}: {at} {along}"
            );
        }
        assert!(capture.files.iter().any(|f| f.file_stem().unwrap() == "frames"), "{what}");
        assert!(capture.notes.iter().any(|n| n.contains("differ by up to")), "{what}: {:?}", capture.notes);
    };
    let model = rig_model(dir.path(), &[]);
    let capture = read(dir.path(), dir.path(), false).unwrap();
    check(&capture, "text");
    assert_eq!(capture.notes.len(), 1, "{:?}", capture.notes);
    let (crlf, mark) = (FRAMES.replace('\n', "\r\n# said in between\r\n"), format!("\u{feff}{RIGS}"));
    rig_model(dir.path(), &[("frames", &crlf), ("rigs", &mark)]);
    check(&read(dir.path(), dir.path(), false).unwrap(), "text as Windows has it");
    // The same in binary, where COLMAP looks first.
    let camera = |id: u32| [id.to_le_bytes(), 1_u32.to_le_bytes()].concat();
    let numbers = |v: &[f64]| v.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>();
    let pinhole = |id| [camera(id), [8_u64, 6].map(u64::to_le_bytes).concat(), numbers(&[6.0, 6.0, 4.0, 3.0])].concat();
    let mut images = 5_u64.to_le_bytes().to_vec();
    for line in RIG_IMAGES.lines().filter(|line| !line.is_empty()) {
        let fields: Vec<&str> = line.split(' ').collect();
        let pose: Vec<f64> = fields[1..8].iter().map(|f| f.parse().unwrap()).collect();
        let whole = |i: usize| fields[i].parse::<u32>().unwrap().to_le_bytes();
        images.extend([&whole(0)[..], &numbers(&pose), &whole(8), fields[9].as_bytes(), &[0; 9]].concat());
    }
    fs::write(model.join("cameras.bin"), [3_u64.to_le_bytes().to_vec(), pinhole(1), pinhole(2), pinhole(5)].concat()).unwrap();
    fs::write(model.join("images.bin"), images).unwrap();
    let (rigs, frames) = (bytes_of(RIGS_BIN), bytes_of(FRAMES_BIN));
    let put = |name: &str, bytes: &[u8]| fs::write(model.join(name), bytes).unwrap();
    put("rigs.bin", &rigs);
    put("frames.bin", &frames);
    fs::remove_file(model.join("rigs.txt")).unwrap();
    fs::remove_file(model.join("frames.txt")).unwrap();
    check(&read(dir.path(), dir.path(), false).unwrap(), "binary");
    for (name, whole) in [("rigs.bin", &rigs), ("frames.bin", &frames)] {
        for bytes in [&whole[..whole.len() - 1], &whole[..12], &whole[..0], &[&whole[..], b"x"].concat()] {
            put(name, bytes);
            let message = read(dir.path(), dir.path(), false).unwrap_err().to_string();
            assert!(message.contains(name), "{message}");
        }
        put(name, whole);
    }
}

#[test]
fn frames_and_rigs_that_do_not_fit_are_refused_with_both_files() {
    let dir = tempfile::tempdir().unwrap();
    let refused = |changed: &[(&str, &str)], words: &[&str]| {
        rig_model(dir.path(), changed);
        let message = read(dir.path(), dir.path(), false).unwrap_err().to_string();
        assert!(words.iter().all(|w| message.contains(w)), "{words:?}: {message}");
    };
    let frames = |from: &str, to: &str| FRAMES.replace(from, to);
    let rigs = |from: &str, to: &str| RIGS.replace(from, to);
    refused(&[("frames", &frames("CAMERA 1 31", "CAMERA 1 32"))], &["images.txt", "a/0.png", "31", "frames.txt"]);
    refused(&[("frames", &frames("12 7 ", "12 8 "))], &["frames.txt", "frame 12", "rigs.txt", "rig 8"]);
    refused(&[("frames", &frames("12 7 ", "11 7 "))], &["frame 11", "two"]);
    refused(&[("frames", &frames("CAMERA 5 50", "CAMERA 5 40"))], &["image 40", "frame 11", "frame 12"]);
    refused(
        &[("frames", &frames("CAMERA 2 40 CAMERA 1 41", "CAMERA 1 40 CAMERA 2 41"))],
        &["b/1.png", "camera is 2", "frame 11"],
    );
    refused(&[("frames", &frames("12 7 0.8 0 0.6 0", "12 7 0 0 0 0"))], &["frame 12", "quaternion"]);
    refused(&[("frames", &frames("12 7 0.8", "12 7 nan"))], &["frame 12", "quaternion"]);
    refused(&[("frames", &frames("-2 2 CAMERA", "-2 3 CAMERA"))], &["frames.txt:2", "too soon"]);
    refused(&[("frames", &frames("-2 2 CAMERA", "-2 1 CAMERA"))], &["frames.txt:2", "follows"]);
    refused(&[("frames", &frames("IMU 1 99", "LIDAR 1 99"))], &["frames.txt:1", "LIDAR"]);
    refused(&[("rigs", &rigs("7 2 IMU", "4 2 IMU"))], &["rigs.txt", "rig 4", "two"]);
    refused(&[("rigs", &rigs("CAMERA 5 1", "CAMERA 6 1"))], &["frames.txt", "rig 7", "camera 5"]);
    refused(&[("rigs", &rigs("CAMERA 2 CAMERA 1", "CAMERA 2 CAMERA 2"))], &["rig 4", "camera 2 twice"]);
    refused(&[("rigs", &rigs("4 3 CAMERA", "4 2 CAMERA"))], &["rigs.txt:2", "follows"]);
    refused(&[("rigs", &rigs("CAMERA 1 1 0.8", "CAMERA 1 2 0.8"))], &["rigs.txt:2", "HAS_POSE"]);
    refused(&[("rigs", "# none\n")], &["frame", "has no rig"]);
    refused(&[("frames", "# none\n")], &["is in no frame"]);
    // Only one of the two, or both in another form than the images.
    for gone in ["rigs", "frames"] {
        let model = rig_model(dir.path(), &[]);
        fs::remove_file(model.join(format!("{gone}.txt"))).unwrap();
        let message = read(dir.path(), dir.path(), false).unwrap_err().to_string();
        assert!(message.contains("rigs.txt") && message.contains("frames.txt") && message.contains("without"), "{message}");
    }
    let model = rig_model(dir.path(), &[]);
    for name in ["rigs", "frames"] {
        fs::remove_file(model.join(format!("{name}.txt"))).unwrap();
        fs::write(model.join(format!("{name}.bin")), "").unwrap();
    }
    let message = read(dir.path(), dir.path(), false).unwrap_err().to_string();
    assert!(message.contains("frames.bin") && message.contains("images.txt"), "{message}");
    // Both empty: a model of before there were any, as COLMAP has it.
    rig_model(dir.path(), &[("rigs", "# none\n"), ("frames", "")]);
    let legacy = read(dir.path(), dir.path(), false).unwrap();
    assert!(legacy.notes.is_empty() && legacy.shots[0].world_from_camera.translation == DVec3::splat(-9.0), "{:?}", legacy.notes);
}

#[test]
fn sensors_without_a_place_and_images_that_nobody_has_are_named() {
    let dir = tempfile::tempdir().unwrap();
    let model = |changed: &[(&str, &str)]| {
        rig_model(dir.path(), changed);
        read(dir.path(), dir.path(), false)
    };
    let capture = model(&[("rigs", &RIGS.replace("CAMERA 1 1 0.8 0 0.6 0 0.5 0 -0.25", "CAMERA 1 0"))]).unwrap();
    assert_eq!(capture.shots.iter().map(|s| s.name.as_str()).collect::<Vec<_>>(), ["b/0.png", "b/1.png", "c/0.png"]);
    assert!(capture.notes.iter().any(|n| n.contains("camera 1") && n.contains("2 images")), "{:?}", capture.notes);
    let capture = model(&[("frames", &FRAMES.replace("3 CAMERA 1 31", "4 CAMERA 1 77 CAMERA 1 31"))]).unwrap();
    assert!(capture.notes.iter().any(|n| n.contains("1 image is in frames") && n.contains("77")), "{:?}", capture.notes);
    let capture = model(&[("rigs", &RIGS.replace("rigs: 2", "rigs: 3"))]).unwrap();
    assert!(capture.notes.iter().any(|n| n.contains("rigs.txt has 2 rigs") && n.contains("3")), "{:?}", capture.notes);
}

#[test]
fn lines_of_points_are_triples_and_none_is_taken_for_an_image() {
    let dir = tempfile::tempdir().unwrap();
    let with = |images: &str| {
        text_model(dir.path());
        fs::write(dir.path().join("sparse/0/images.txt"), images).unwrap();
        read(dir.path(), dir.path(), false)
    };
    let pose = |id: usize| format!("{id} 1 0 0 0 {id} 0 0 3 {id}.png\n");
    let count = |images: &str| with(images).unwrap().shots.len();
    // Comments and empty lines in between; none behind the last; another program's number for no point.
    assert_eq!(count(&format!("{}# said\n\n\n\n{}1 2 -1\n# more\n{}", pose(1), pose(2), pose(3))), 3);
    assert_eq!(count(&format!("\u{feff}{}1.5 2.5 18446744073709551615 3 4 7\r\n", pose(1).replace('\n', "\r\n"))), 1);
    let refused = |images: &str, words: &[&str]| {
        let message = with(images).unwrap_err().to_string();
        assert!(words.iter().all(|w| message.contains(w)), "{message}");
    };
    refused(&[pose(1), pose(2)].concat(), &["images.txt:2", "X Y POINT3D_ID", "10 fields"]);
    refused(&[pose(1), "\n".into(), pose(2), pose(3)].concat(), &["images.txt:4"]);
    refused(&(pose(1) + "# comment\n" + &pose(2) + "\n"), &["images.txt:3"]);
    refused(&(pose(1) + "1 2\n"), &["images.txt:2", "2 fields"]);
    refused(&(pose(1) + "1 2 a\n"), &["images.txt:2", "\"a\""]);
    refused(&(pose(1) + "1 b 3\n"), &["images.txt:2", "\"b\""]);
    refused(&(pose(1) + "\n" + &pose(1).replace("1.png", "2.png") + "\n"), &["images.txt:3", "image 1 already"]);
    let notes = with(&format!("# Number of images: 3, mean observations per image: 0\n{}\n", pose(1))).unwrap().notes;
    assert!(notes.iter().any(|n| n.contains("images.txt has 1 images") && n.contains("3")), "{notes:?}");
    text_model(dir.path());
    fs::write(dir.path().join("sparse/0/points3D.txt"), "8 1.5 -2 3 10 20 30 0.5 1 0 2\n").unwrap();
    assert!(read(dir.path(), dir.path(), false).unwrap_err().to_string().contains("points3D.txt:1"));
}

#[test]
fn further_models_are_named() {
    let dir = tempfile::tempdir().unwrap();
    text_model(dir.path());
    fs::rename(dir.path().join("sparse"), dir.path().join("kept")).unwrap();
    for k in ["0", "1", "10", "2"] {
        let model = dir.path().join("sparse").join(k);
        fs::create_dir_all(&model).unwrap();
        for name in ["cameras", "images", "points3D"] {
            fs::copy(dir.path().join(format!("kept/0/{name}.txt")), model.join(format!("{name}.txt"))).unwrap();
        }
    }
    fs::create_dir(dir.path().join("sparse/empty")).unwrap();
    let notes = || read(dir.path(), dir.path(), false).unwrap().notes;
    assert!(notes().len() == 1 && notes()[0].starts_with("sparse/1, sparse/2, sparse/10 hold"), "{:?}", notes());
    // In the folder of the models, and beside it.
    let copy = |to: &Path| {
        for name in ["cameras", "images", "points3D"] {
            fs::copy(dir.path().join(format!("kept/0/{name}.txt")), to.join(format!("{name}.txt"))).unwrap();
        }
    };
    copy(&dir.path().join("sparse"));
    assert!(notes()[0].starts_with("sparse, sparse/1, sparse/2, sparse/10 hold"), "{:?}", notes());
    for k in ["1", "10", "2"] {
        fs::remove_dir_all(dir.path().join("sparse").join(k)).unwrap();
    }
    assert!(notes()[0].starts_with("sparse holds a further model") && notes()[0].contains("CAPTURE/sparse "), "{:?}", notes());
    for name in ["cameras", "images", "points3D"] {
        fs::remove_file(dir.path().join(format!("sparse/{name}.txt"))).unwrap();
    }
    assert!(notes().is_empty(), "{:?}", notes());
    copy(dir.path());
    assert!(notes().len() == 1 && notes()[0].starts_with("the model beside sparse/ was not read"), "{:?}", notes());
}

#[test]
fn pictures_are_found_without_the_folders_of_their_names_too() {
    let dir = tempfile::tempdir().unwrap();
    text_model(dir.path());
    let images = IMAGES.replace("b 10.png", "left/b 10.png").replace("b 9.png", "rig\\left\\b 9.png");
    fs::write(dir.path().join("sparse/0/images.txt"), images).unwrap();
    let pictures = dir.path().join("flat");
    fs::create_dir_all(pictures.join("left")).unwrap();
    let found = || -> Vec<PathBuf> {
        let capture = read(dir.path(), &pictures, true).unwrap();
        capture.shots.iter().map(|shot| shot.image.as_ref().unwrap().strip_prefix(&pictures).unwrap().to_path_buf()).collect()
    };
    // What is not there is missed as the model names it.
    assert_eq!(found(), [Path::new("left/b 10.png"), Path::new("rig\\left\\b 9.png")]);
    for name in ["b 10.png", "b 9.png"] {
        fs::write(pictures.join(name), "").unwrap();
    }
    assert_eq!(found(), [Path::new("b 10.png"), Path::new("b 9.png")]);
    // As few folders as can be are left out.
    fs::write(pictures.join("left/b 9.png"), "").unwrap();
    assert_eq!(found(), [Path::new("b 10.png"), Path::new("left/b 9.png")]);
}
