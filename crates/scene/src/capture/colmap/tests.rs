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
