//! Tests of `transforms.json`.

use super::*;
use glam::DVec3;

fn parse(json: &str, wanted: bool) -> Result<Capture> {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("transforms.json"), json).unwrap();
    std::fs::write(dir.path().join("a.png"), io::encode_png(&crate::Raster::filled(20, 10, [1; 3])).unwrap()).unwrap();
    read(dir.path(), None, wanted)
}

const MATRIX: &str = "[[1,0,0,5],[0,1,0,6],[0,0,1,7],[0,0,0,1]]";

#[test]
fn opengl_axes_become_opencv_axes() {
    let json = format!(
        r#"{{"w":20,"h":10,"fl_x":15,"fl_y":16,"cx":9,"cy":4,"k1":-0.1,"p2":0.01,"aabb_scale":4,
        "train_filenames":["b"],"val_filenames":["./a"],
        "frames":[{{"file_path":"./b","transform_matrix":{MATRIX}}},
        {{"file_path":"./a","fl_x":30,"transform_matrix":{MATRIX},"depth_file_path":"d/a.png","mask_path":"m/a.png","sharpness":3}}]}}"#
    );
    let capture = parse(&json, true).unwrap();
    let [a, b] = capture.shots.as_slice() else { panic!("two frames") };
    assert_eq!((a.name.as_str(), b.name.as_str()), ("a", "b"));
    // An OpenGL camera that is not turned looks along -z with its top at +y.
    assert_eq!(a.world_from_camera.transform_vector(DVec3::Z), -DVec3::Z);
    assert_eq!(a.world_from_camera.transform_vector(DVec3::Y), -DVec3::Y);
    assert_eq!(a.world_from_camera.transform_vector(DVec3::X), DVec3::X);
    assert_eq!(a.world_from_camera.translation, DVec3::new(5.0, 6.0, 7.0));
    assert_eq!(a.lens.pinhole, Pinhole { width: 20, height: 10, fx: 30.0, fy: 16.0, cx: 9.0, cy: 4.0 });
    assert_eq!((b.lens.pinhole.fx, b.lens.radial, b.lens.tangential), (15.0, [-0.1, 0.0, 0.0], [0.0, 0.01]));
    assert!(a.depth.as_ref().unwrap().ends_with("d/a.png") && a.mask.is_some() && b.depth.is_none());
    assert!(a.image.as_ref().unwrap().ends_with("a.png"), "an ending that was left out is found");
    let lists = capture.lists.unwrap();
    assert_eq!((lists.train, lists.test), (Some(vec!["b".to_owned()]), Some(vec!["a".to_owned()])));
}

#[test]
fn distortion_may_be_stated_all_at_once_and_what_is_not_read_is_refused() {
    let of = |more: &str, frame: &str| {
        let json =
            format!(r#"{{"w":20,"h":10,"fl_x":15,{more}"frames":[{{"file_path":"a.png",{frame}"transform_matrix":{MATRIX}}}]}}"#);
        parse(&json, true).map(|capture| (capture.shots[0].lens.radial, capture.shots[0].lens.tangential, capture.notes))
    };
    let (radial, tangential, notes) = of(r#""k1":0.5,"distortion_params":[-0.2,0.1,0,0,0.01,0.02],"#, "").unwrap();
    assert_eq!((radial, tangential, notes.len()), ([-0.2, 0.1, 0.0], [0.01, 0.02], 0));
    let (radial, _, notes) = of(r#""k1":-0.2,"#, r#""distortion_params":[-0.1,0,0,0,0,0],"#).unwrap();
    assert!(radial[0] == -0.1 && notes[0].contains("another principal point or distortion"), "{notes:?}");
    for (fault, word) in [
        (r#""distortion_params":[0,0,0,0.1,0,0],"#, "k4"),
        (r#""distortion_params":[0,0,0,0],"#, "4 numbers"),
        (r#""k5":0.1,"#, "k5"),
        (r#""skew":0.1,"#, "skew"),
    ] {
        let message = of(fault, "").unwrap_err().to_string();
        assert!(message.contains(word), "{message}");
    }
}

#[test]
fn lists_of_one_kind_leave_the_rest_to_the_other() {
    let lists = |lists: &str| {
        let frame = |name: &str| format!(r#"{{"file_path":"{name}","transform_matrix":{MATRIX}}}"#);
        let frames = ["a.png", "b.png"].map(frame).join(",");
        let capture = parse(&format!(r#"{{"w":20,"h":10,"fl_x":15,{lists}"frames":[{frames}]}}"#), false).unwrap();
        (capture.lists, capture.notes)
    };
    let (found, notes) = lists(r#""test_filenames":["a.png"],"val_filenames":["b.png"],"#);
    let found = found.unwrap();
    assert_eq!((found.train, found.test, found.others), (None, Some(vec!["a.png".to_owned()]), vec!["b.png".to_owned()]));
    assert!(notes[0].contains("not what is trained with"), "{notes:?}");
    let (found, notes) = lists(r#""train_filenames":["a.png"],"#);
    assert!(found.unwrap().test.is_none() && notes[0].contains("not what is held out"), "{notes:?}");
    assert_eq!(lists(""), (None, Vec::new()));
}

#[test]
fn a_field_of_view_and_the_picture_itself_make_a_camera() {
    let json =
        format!(r#"{{"camera_angle_x":1.5707963267948966,"frames":[{{"file_path":"a.png","transform_matrix":{MATRIX}}}]}}"#);
    let lens = parse(&json, true).unwrap().shots[0].lens;
    assert!((lens.pinhole.fx - 10.0).abs() < 1e-12 && lens.pinhole.fx == lens.pinhole.fy);
    assert_eq!((lens.pinhole.width, lens.pinhole.height, lens.pinhole.cx, lens.pinhole.cy), (20, 10, 10.0, 5.0));
}

#[test]
fn every_axis_goes_by_its_own_and_a_frame_comes_before_the_file() {
    // Of 20 x 10 pixels: a full angle of 2 atan(1/2) is 20 pixels along x and 10 along y.
    let angle = 2.0 * 0.5_f64.atan();
    let focal = |file: &str, frame: &str| {
        let replaced = |text: &str| text.replace("ANGLE", &angle.to_string()).replace("DEGREES", &angle.to_degrees().to_string());
        let json = format!(
            r#"{{"w":20,"h":10{},"frames":[{{"file_path":"a.png"{},"transform_matrix":{MATRIX}}}]}}"#,
            replaced(file),
            replaced(frame)
        );
        let capture = parse(&json, true).unwrap();
        let p = capture.shots[0].lens.pinhole;
        ([p.fx, p.fy].map(|f| (1e9 * f).round() / 1e9), capture.notes)
    };
    for (file, frame, expected, word) in [
        (r#","camera_angle_x":ANGLE,"camera_angle_y":ANGLE"#, "", [20.0, 10.0], ""),
        (r#","camera_angle_y":ANGLE"#, "", [10.0, 10.0], ""),
        (r#","camera_angle_x":ANGLE"#, "", [20.0, 20.0], ""),
        (r#","fl_y":17"#, "", [17.0, 17.0], ""),
        (r#","fl_x":15,"camera_angle_y":ANGLE"#, "", [15.0, 10.0], ""),
        (r#","camera_angle_x":ANGLE,"fl_y":17"#, "", [20.0, 17.0], ""),
        (
            r#","fl_x":15,"fl_y":16"#,
            r#","camera_angle_x":ANGLE,"camera_angle_y":ANGLE"#,
            [20.0, 10.0],
            "nerfstudio takes the file's",
        ),
        (r#","fl_x":15,"fl_y":16"#, r#","fl_x":30"#, [30.0, 16.0], "along one axis alone"),
        (r#","camera_angle_x":ANGLE"#, r#","camera_angle_y":ANGLE"#, [20.0, 10.0], ""),
        ("", r#","fl_x":30"#, [30.0, 30.0], ""),
        (r#","fl_x":15,"camera_angle_x":ANGLE"#, "", [15.0, 15.0], "say different things"),
        (r#","fl_x":20.001,"camera_angle_x":ANGLE"#, "", [20.001, 20.001], ""),
        (r#","x_fov":DEGREES,"y_fov":DEGREES,"fl_x":15"#, "", [20.0, 10.0], "say different things"),
    ] {
        let (found, notes) = focal(file, frame);
        assert_eq!(found, expected, "{file} {frame}");
        assert!(if word.is_empty() { notes.is_empty() } else { notes.len() == 1 && notes[0].contains(word) }, "{notes:?}");
    }
}

#[test]
fn sides_that_are_not_stated_are_the_pictures() {
    for stated in ["", r#""w":20,"#, r#""h":10,"#] {
        let json = format!(r#"{{{stated}"fl_x":15,"frames":[{{"file_path":"a.png","transform_matrix":{MATRIX}}}]}}"#);
        let p = parse(&json, true).unwrap().shots[0].lens.pinhole;
        assert_eq!((p.width, p.height, p.cx, p.cy), (20, 10, 10.0, 5.0), "{stated}");
    }
}

#[test]
fn a_folder_of_images_holds_file_path_as_it_stands_or_without_its_first_folders() {
    let dir = tempfile::tempdir().unwrap();
    let (capture, pictures) = (dir.path().join("capture"), dir.path().join("pictures"));
    let frame = |name: &str| format!(r#"{{"file_path":"{name}","transform_matrix":{MATRIX}}}"#);
    let png = io::encode_png(&crate::Raster::filled(20, 10, [1; 3])).unwrap();
    let images = |names: &[&str], files: &[&str]| -> Result<Vec<PathBuf>> {
        let _ = std::fs::remove_dir_all(&pictures);
        for file in files {
            io::write_atomic(pictures.join(file), &png).unwrap();
        }
        let frames: Vec<String> = names.iter().map(|n| frame(n)).collect();
        let text = format!(r#"{{"fl_x":15,"w":20,"h":10,"frames":[{}]}}"#, frames.join(","));
        io::write_atomic(capture.join("transforms.json"), text.as_bytes()).unwrap();
        let shots = read(&capture, Some(&pictures), true)?.shots;
        Ok(shots.into_iter().map(|s| s.image.unwrap().strip_prefix(&pictures).unwrap().to_path_buf()).collect())
    };
    let found = |names: &[&str], files: &[&str], expected: &[&str]| {
        assert_eq!(images(names, files).unwrap(), expected.iter().map(PathBuf::from).collect::<Vec<_>>(), "{names:?}");
    };
    // As it stands, although a flat file has the same last name.
    found(&["cam0/1.png", "cam1/1.png"], &["cam0/1.png", "cam1/1.png", "1.png"], &["cam0/1.png", "cam1/1.png"]);
    found(&["images/left/1.png"], &["left/1.png", "1.png"], &["left/1.png"]);
    found(&["images/1"], &["1.jpg", "images/2.jpg"], &["1.jpg"]);
    // Where the capture was made does not matter.
    found(&["/home/somebody/left/1.png"], &["left/1.png"], &["left/1.png"]);
    found(&["../images/1.png"], &["1.png"], &["1.png"]);
    found(&[r"C:\\shots\\1.png"], &["shots/1.png"], &["shots/1.png"]);
}

#[test]
fn what_cannot_be_read_is_refused_with_the_frame_that_says_it() {
    let frame = |camera: &str, matrix: &str| {
        format!(r#"{{"w":20,"h":10,"fl_x":15{camera},"frames":[{{"file_path":"a.png","transform_matrix":{matrix}}}]}}"#)
    };
    let refused = |json: &str, words: &[&str]| {
        let message = parse(json, true).unwrap_err().to_string();
        assert!(words.iter().all(|w| message.contains(w)), "{message}");
    };
    refused(&frame(r#","camera_model":"OPENCV_FISHEYE""#, MATRIX), &["a.png", "OPENCV_FISHEYE", "undistort"]);
    refused(&frame(r#","is_fisheye":true"#, MATRIX), &["fisheye"]);
    refused(&frame(r#","k4":0.1"#, MATRIX), &["k4"]);
    refused(&frame("", "[[1,0,0,5],[0,1,0,6],[0,0,NaN,7],[0,0,0,1]]"), &["a.png", "NaN"]);
    refused(&frame("", "[[2,0,0,5],[0,1,0,6],[0,0,1,7],[0,0,0,1]]"), &["a.png"]);
    refused(&frame("", "[[1,0,0],[0,1,0],[0,0,1]]"), &["4x4"]);
    refused(r#"{"frames":[]}"#, &["no frame"]);
    refused("{", &["transforms.json:1"]);
    refused(&frame("", MATRIX).replace("\"fl_x\":15", "\"cx\":1"), &["fl_x", "camera_angle_y"]);
    for (said, words) in [
        (r#""fl_x":-15"#, ["fl_x is -15", "pixels"]),
        (r#""fl_y":0"#, ["fl_y is 0", "pixels"]),
        (r#""camera_angle_x":0"#, ["camera_angle_x is 0", "radians"]),
        (r#""camera_angle_y":3.2"#, ["camera_angle_y is 3.2", "radians"]),
        (r#""camera_angle_x":3.14159265"#, ["camera_angle_x is 3.14159265", "radians"]),
        (r#""fl_x":15,"camera_angle_y":-1"#, ["camera_angle_y is -1", "radians"]),
        (r#""x_fov":180"#, ["x_fov is 180", "degrees"]),
        (r#""fl_x":15,"latlong":true"#, ["latlong", "undistort"]),
    ] {
        refused(&frame("", MATRIX).replace(r#""fl_x":15"#, said), &words);
    }
    refused(&frame("", MATRIX).replace("a.png", "../a.png"), &["leads out"]);
}
