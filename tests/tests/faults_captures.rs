//! Captures of others as their files mean them: frames of poses, intrinsics by axis, files of one name, rounded rotations.

use crate::common::{copy_folder, corf, corf_ok, corf_refuses, shared, text};
use corf_scene::dataset::{Dataset, stem};
use corf_scene::{Light, Pinhole, Raster, Rigid3, Similarity3, io};
use glam::{DQuat, DVec3};
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

pub fn fault(name: &str) -> Option<PathBuf> {
    shared(&format!("faults3/{name}"))
}

/// Imports, and returns the data set and what was said.
pub fn import(capture: &Path, from: &str, more: &[&str], out: &Path) -> (Dataset, String) {
    let output = corf(&[&["dataset", "import", text(capture), "--from", from, "--out", text(out)], more].concat());
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{from} {more:?}\n{said}");
    (Dataset::open(out).unwrap(), said)
}

pub fn refuses(capture: &Path, from: &str, more: &[&str], words: &[&str]) {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("refused");
    corf_refuses(&[&["dataset", "import", text(capture), "--from", from, "--out", text(&out)], more].concat(), words);
    assert!(!out.exists());
}

/// Size of the images of captures that are written here.
pub const SIZE: [usize; 2] = [16, 12];

/// Five places on an arc that look at one point, in the frame of a capture.
pub fn places() -> Vec<Rigid3> {
    let place = |i: usize| {
        let angle = 0.4 * i as f64;
        Rigid3::looking_at(DVec3::new(2.0 * angle.cos(), 0.3 * i as f64, 2.0 * angle.sin()), DVec3::ZERO, DVec3::NEG_Y)
    };
    (0..5).map(place).collect()
}

/// A picture that no other place has.
pub fn picture(i: usize) -> Raster<[u8; 3]> {
    Raster::from_fn(SIZE[0], SIZE[1], |x, y| [(40 * i + 5 * x) as u8, (9 * y) as u8, 30 + (i * i) as u8])
}

pub fn opengl(pose: &Rigid3) -> Value {
    json!(pose.to_rows().map(|[a, b, c, d]| [a, -b, -c, d]))
}

/// A `transforms.json` of places and pictures, `name(i)` being what the file calls them.
pub fn transforms(folder: &Path, poses: &[Value], name: impl Fn(usize) -> String) {
    let frame = |(i, pose): (usize, &Value)| {
        let path = folder.join(name(i));
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        io::write_png(path, &picture(i)).unwrap();
        json!({ "file_path": name(i), "transform_matrix": pose })
    };
    let frames: Vec<Value> = poses.iter().enumerate().map(frame).collect();
    let file = json!({ "w": SIZE[0], "h": SIZE[1], "fl_x": 14.0, "frames": frames });
    fs::write(folder.join("transforms.json"), file.to_string()).unwrap();
}

/// A COLMAP model in text of images and what their lines say of the rotation, w x y z.
pub fn colmap(folder: &Path, images: &[(&str, [f64; 4])]) {
    let model = folder.join("sparse/0");
    fs::create_dir_all(&model).unwrap();
    fs::write(model.join("cameras.txt"), format!("1 PINHOLE {} {} 14 14 8 6\n", SIZE[0], SIZE[1])).unwrap();
    let line = |(i, (name, q)): (usize, &(&str, [f64; 4]))| {
        format!("{} {} {} {} {} {i}.5 -1 2 1 {name}\n\n", i + 1, q[0], q[1], q[2], q[3])
    };
    fs::write(model.join("images.txt"), images.iter().enumerate().map(line).collect::<String>()).unwrap();
    for (i, (name, _)) in images.iter().enumerate() {
        let path = folder.join("images").join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        io::write_png(path, &picture(i)).unwrap();
    }
}

/// A run whose predictions at the places of training keyframes are their pictures to the bit.
fn nearest(dataset: &Path, run: &Path) {
    corf_ok(&["reconstruct", text(dataset), "--out", text(run), "--method", "nearest"]);
}

/// Renders poses, and returns the pictures and what was said.
fn render(run: &Path, poses: &Path, more: &[&str]) -> (Vec<Raster<[u8; 3]>>, String) {
    let scratch = tempfile::tempdir().unwrap();
    let out = scratch.path().join("views");
    let output = corf(&[&["render", text(run), "--poses", text(poses), "--out", text(&out)], more].concat());
    let said = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0), "{said}");
    let count = fs::read_dir(out.join("images")).unwrap().count();
    ((0..count).map(|i| io::read_png(out.join(format!("images/{}.png", stem(i)))).unwrap()).collect(), said)
}

/// Whether pictures are those of the training keyframes of a data set.
fn are_the_keyframes(pictures: &[Raster<[u8; 3]>], dataset: &Dataset) -> bool {
    assert!(dataset.train_indices().len() > 2);
    dataset.train_indices().iter().all(|i| pictures[*i] == dataset.keyframe(*i).unwrap().light.unwrap().image)
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn poses_of_the_file_that_was_imported_mean_the_same_places() {
    for (name, flags) in [("up-and-scale", &["--up=0,-1,0", "--scale", "0.5"][..]), ("up-of-cameras", &["--up", "cameras"][..])] {
        let Some(capture) = fault(&format!("pose-frame/{name}")) else { return };
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        let (dataset, _) = import(&capture, "nerfstudio", flags, &at("ds"));
        nearest(&at("ds"), &at("run"));
        let (pictures, said) = render(&at("run"), &capture.join("transforms.json"), &[]);
        assert!(are_the_keyframes(&pictures, &dataset), "{name}");
        assert!(said.contains("in the capture's frame") && said.contains("the file that was imported"), "{said}");
        let (of_world, said) = render(&at("run"), &at("ds/trajectory.json"), &[]);
        assert!(of_world == pictures && said.contains("in the data set's world"), "{said}");
        let (elsewhere, _) = render(&at("run"), &capture.join("transforms.json"), &["--poses-in", "world"]);
        assert!(!are_the_keyframes(&elsewhere, &dataset), "the two frames are not one");
    }
}

#[test]
fn the_frame_of_a_pose_file_is_known_said_or_asked_for() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let poses: Vec<Value> = places().iter().map(opengl).collect();
    transforms(&at("capture"), &poses, |i| format!("images/{i}.png"));
    let (dataset, _) = import(&at("capture"), "nerfstudio", &["--up=0,-1,0", "--scale", "0.25"], &at("ds"));
    // The change is kept whole, and is what was done to every pose.
    let kept: Value = serde_json::from_slice(&fs::read(at("ds/dataset.json")).unwrap()).unwrap();
    let change = &kept["header"]["imported"]["world_from_capture"];
    assert_eq!((&change["scale"], &change["translation_m"]), (&json!(0.25), &json!([0.0, 0.0, 0.0])));
    let change: Similarity3 = serde_json::from_value(change.clone()).unwrap();
    for (pose, place) in dataset.poses().iter().zip(places()) {
        assert!((pose.world_from_camera.translation - change.transform_point(place.translation)).length() < 1e-12);
    }
    nearest(&at("ds"), &at("run"));
    let write = |name: &str, value: &Value| {
        fs::write(at(name), value.to_string()).unwrap();
        at(name)
    };
    let frames =
        |poses: &[Value]| json!({ "frames": poses.iter().map(|p| json!({ "transform_matrix": p })).collect::<Vec<_>>() });

    // Some poses of the capture in another file, the last row left out: known by them.
    let short: Vec<Value> = poses[1..].iter().map(|p| json!(p.as_array().unwrap()[..3])).collect();
    let (pictures, said) = render(&at("run"), &write("some.json", &frames(&short)), &[]);
    assert!((1..5).filter(|i| dataset.train_indices().contains(i)).all(|i| pictures[i - 1] == picture(i)), "{said}");
    assert!(said.contains("capture's frame, where keyframes had the same poses"), "{said}");
    // The data set's own files, the one in other axes among them, and matrices: its world.
    let rows: Vec<Value> = dataset.poses().iter().map(|p| json!(p.world_from_camera.to_rows())).collect();
    for file in [at("ds/optical/transforms.json"), at("ds/trajectory.json"), write("rows.json", &json!(rows))] {
        let (pictures, said) = render(&at("run"), &file, &[]);
        assert!(are_the_keyframes(&pictures, &dataset) && said.contains("in the data set's world"), "{}: {said}", file.display());
    }
    // New places in the form of captures could be either.
    let between = Rigid3 { translation: DVec3::new(0.5, 1.5, 1.0), ..places()[2] };
    let new = write("new.json", &frames(&[opengl(&between)]));
    let asked = ["render", text(&at("run")), "--poses", text(&new), "--out", text(&at("no"))].map(str::to_owned);
    corf_refuses(&asked.each_ref().map(String::as_str), &["new.json", "--poses-in capture", "world_from_capture"]);
    assert!(!at("no").exists());
    let (of_capture, _) = render(&at("run"), &new, &["--poses-in", "capture"]);
    let mapped = write("mapped.json", &json!([change.pose(&between).to_rows()]));
    let (of_world, said) = render(&at("run"), &mapped, &[]);
    assert!(of_capture == of_world && said.contains("as files of this form are"), "{said}");

    // Data sets of earlier versions have up and scale alone, which is all that was done to them.
    copy_folder(&at("ds"), &at("old"));
    let mut old = kept.clone();
    old["header"]["imported"].as_object_mut().unwrap().remove("world_from_capture");
    fs::write(at("old/dataset.json"), old.to_string()).unwrap();
    assert_eq!(Dataset::open(at("old")).unwrap().world_from_capture(), Some(change));
    nearest(&at("old"), &at("old-run"));
    let (pictures, _) = render(&at("old-run"), &at("capture/transforms.json"), &[]);
    assert!(are_the_keyframes(&pictures, &dataset));

    // Where the frame was kept, there is nothing to say and nothing to ask.
    import(&at("capture"), "nerfstudio", &[], &at("kept"));
    nearest(&at("kept"), &at("kept-run"));
    let (_, said) = render(&at("kept-run"), &new, &[]);
    assert!(!said.contains("frame") && !said.contains("world"), "{said}");
}

#[test]
fn the_trajectory_of_a_plain_capture_is_in_its_frame() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    plain(&at("capture"), |pose| json!(pose.to_rows()));
    let (dataset, _) = import(&at("capture"), "corf-folder", &["--up=0,-1,0", "--scale", "0.25"], &at("ds"));
    nearest(&at("ds"), &at("run"));
    let (pictures, said) = render(&at("run"), &at("capture/trajectory.json"), &[]);
    assert!(are_the_keyframes(&pictures, &dataset) && said.contains("in the capture's frame"), "{said}");
}

/// A capture in the plain layout; `rows` writes a pose.
pub fn plain(folder: &Path, rows: impl Fn(&Rigid3) -> Value) {
    fs::create_dir_all(folder.join("images")).unwrap();
    let keyframe = |(i, pose): (usize, &Rigid3)| {
        io::write_png(folder.join(format!("images/{i}.png")), &picture(i)).unwrap();
        json!({ "file": i.to_string(), "world_from_camera": rows(pose) })
    };
    let keyframes: Vec<Value> = places().iter().enumerate().map(keyframe).collect();
    fs::write(folder.join("trajectory.json"), json!({ "keyframes": keyframes }).to_string()).unwrap();
    let camera = json!({ "width": SIZE[0], "height": SIZE[1], "fx": 14, "fy": 14, "cx": 8, "cy": 6 });
    fs::write(folder.join("camera.json"), camera.to_string()).unwrap();
}

/// A PLY of light as others write it, of small grey Gaussians.
fn gaussians(path: &Path, positions: &[DVec3]) {
    let columns = "x y z f_dc_0 f_dc_1 f_dc_2 opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    let properties: String = columns.split(' ').map(|c| format!("property float {c}\n")).collect();
    let header = format!("ply\nformat binary_little_endian 1.0\nelement vertex {}\n{properties}end_header\n", positions.len());
    let mut bytes = header.into_bytes();
    for p in positions {
        let row = [p.x, p.y, p.z, 0.0, 0.0, 0.0, 1.0, -3.0, -3.0, -3.0, 1.0, 0.0, 0.0, 0.0];
        bytes.extend(row.iter().flat_map(|v| (*v as f32).to_le_bytes()));
    }
    fs::write(path, bytes).unwrap();
}

#[test]
fn gaussians_in_the_frame_of_the_capture_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let poses: Vec<Value> = places().iter().map(opengl).collect();
    transforms(&at("capture"), &poses, |i| format!("images/{i}.png"));
    let (dataset, _) = import(&at("capture"), "nerfstudio", &["--up=0,-1,0", "--scale", "0.25"], &at("ds"));
    // Around the point at which all cameras look.
    let spread = |i: i32| 0.3 * DVec3::new((1.7 * f64::from(i)).sin(), (2.9 * f64::from(i)).sin(), (0.7 * f64::from(i)).sin());
    let of_capture: Vec<DVec3> = (0..200).map(spread).map(|p| p + DVec3::new(0.2, 0.5, -0.2)).collect();
    let change = dataset.world_from_capture().unwrap();
    gaussians(&at("capture.ply"), &of_capture);
    gaussians(&at("world.ply"), &of_capture.iter().map(|p| change.transform_point(*p)).collect::<Vec<_>>());
    let (ds, run) = (at("ds"), at("run"));
    let base = ["reconstruct", text(&ds), "--out", text(&run), "--set", "depth.prior=none", "--set", "pyramid_levels=1"];
    corf_refuses(
        &[&base[..], &["--from", text(&at("capture.ply"))]].concat(),
        &["capture.ply", "in the frame of the capture", "optical/"],
    );
    assert!(!run.exists());
    let output = corf(&[&base[..], &["--from", text(&at("world.ply"))]].concat());
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && said.contains("taken to be in the data set's world"), "{said}");
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn each_axis_has_the_field_of_view_that_the_file_gives_it() {
    for (name, focal) in [("both-angles", [30.0, 42.0]), ("no-size-both-angles", [30.0, 24.0]), ("angle-y-alone", [30.0, 30.0])] {
        let Some(capture) = fault(&format!("intrinsics-by-angle/{name}")) else { return };
        let folder = tempfile::tempdir().unwrap();
        let camera = import(&capture, "nerfstudio", &[], &folder.path().join("ds")).0.light_camera();
        assert!((camera.fx - focal[0]).abs() < 1e-9 && (camera.fy - focal[1]).abs() < 1e-9, "{name}: {camera:?}");
        assert_eq!((camera.width, camera.height, camera.cx, camera.cy), (40, 30, 20.0, 15.0));
    }
}

#[test]
fn intrinsics_that_contradict_or_mean_nothing_are_said_or_refused() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let poses: Vec<Value> = places().iter().map(opengl).collect();
    transforms(&at("capture"), &poses, |i| format!("images/{i}.png"));
    let original: Value = serde_json::from_slice(&fs::read(at("capture/transforms.json")).unwrap()).unwrap();
    let with = |file: Value, frames: Value| {
        let mut json = original.clone();
        json.as_object_mut().unwrap().remove("fl_x");
        json.as_object_mut().unwrap().extend(file.as_object().unwrap().clone());
        for frame in json["frames"].as_array_mut().unwrap() {
            frame.as_object_mut().unwrap().extend(frames.as_object().unwrap().clone());
        }
        fs::write(at("capture/transforms.json"), json.to_string()).unwrap();
    };
    let camera = |out: &str| {
        let (dataset, said) = import(&at("capture"), "nerfstudio", &[], &at(out));
        (dataset.light_camera(), said)
    };
    with(json!({ "fl_x": 14.0, "camera_angle_x": 0.3 }), json!({}));
    let (c, said) = camera("contradiction");
    assert!((c.fx, c.fy) == (14.0, 14.0) && said.contains("say different things"), "{said}");
    // A frame's angle comes before the file's focal length.
    with(json!({ "fl_x": 14.0, "fl_y": 14.0 }), json!({ "x_fov": 90.0, "camera_angle_y": std::f64::consts::FRAC_PI_2 }));
    let (c, said) = camera("frames");
    assert!((c.fx - 8.0).abs() < 1e-9 && (c.fy - 6.0).abs() < 1e-9 && said.contains("nerfstudio takes the file's"), "{said}");
    for (file, frame, words) in [
        (json!({}), json!({}), ["nothing says its focal length", "fl_x"]),
        (json!({ "fl_x": 14.0, "camera_angle_y": 0.0 }), json!({}), ["camera_angle_y is 0", "radians"]),
        (json!({ "camera_angle_x": 60.0 }), json!({}), ["camera_angle_x is 60", "degrees"]),
        (json!({ "fl_x": 14.0 }), json!({ "fl_y": -14.0 }), ["fl_y is -14", "images/0.png"]),
        (json!({ "fl_x": 14.0, "w": 16.5 }), json!({}), ["w is 16.5", "whole numbers"]),
        (json!({ "fl_x": 14.0, "w": 17 }), json!({}), ["16x12", "17x12"]),
    ] {
        with(file, frame);
        refuses(&at("capture"), "nerfstudio", &[], &words);
    }
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn one_file_is_the_picture_of_one_frame() {
    let Some(capture) = fault("images-flat/two-folders") else { return };
    let folder = tempfile::tempdir().unwrap();
    let pictures = capture.join("pictures");
    refuses(
        &capture,
        "nerfstudio",
        &["--images", text(&pictures)],
        &["cam0/00000.png", "cam1/00000.png", "both mean the picture"],
    );
    let (dataset, _) = import(&capture, "nerfstudio", &["--images", text(&capture)], &folder.path().join("ds"));
    let names = &dataset.header().imported.as_ref().unwrap().names;
    assert_eq!(names, &["cam0/00000.png", "cam0/00001.png", "cam1/00000.png", "cam1/00001.png"]);
    for (i, name) in names.iter().enumerate() {
        assert!(dataset.keyframe(i).unwrap().light.unwrap().image == io::read_png(capture.join(name)).unwrap(), "{name}");
    }
}

#[test]
fn files_of_one_name_in_several_folders_stay_apart_in_every_layout() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let names = ["cam0/1.png", "cam0/2.png", "cam1/1.png", "cam1/2.png"];
    let poses: Vec<Value> = places()[..4].iter().map(opengl).collect();
    transforms(&at("nerfstudio"), &poses, |i| format!("images/{}", names[i]));
    colmap(&at("colmap"), &names.map(|n| (n, [1.0, 0.0, 0.0, 0.0])));
    // Depth, masks and spectra lie as the images do, in folders of their own.
    let value = |i: usize| 1.0 + i as f32;
    let depth = |i: usize| Raster::filled(SIZE[0], SIZE[1], value(i));
    let mask = |i: usize| Raster::from_fn(SIZE[0], SIZE[1], |x, _| x > i);
    for (i, name) in names.iter().enumerate() {
        let stem = name.trim_end_matches(".png");
        io::write_atomic(at("depth").join(format!("{stem}.exr")), &io::encode_exr_f32(&depth(i), "Z").unwrap()).unwrap();
        io::write_atomic(at("masks").join(name), &io::encode_mask(&mask(i)).unwrap()).unwrap();
        let spectrum = Raster::filled(8, 6, 1e-6 * value(i));
        io::write_atomic(at("rf").join(format!("{stem}.exr")), &io::encode_exr_f32(&spectrum, "Y").unwrap()).unwrap();
        // The same, flat: the second of a name takes the first's place.
        let flat = Path::new(stem).file_name().unwrap().to_str().unwrap();
        io::write_png(at("flat").join(format!("{flat}.png")), &picture(i)).unwrap();
        io::write_atomic(at("flat-depth").join(format!("{flat}.exr")), &io::encode_exr_f32(&depth(i), "Z").unwrap()).unwrap();
        io::write_atomic(at("flat-masks").join(format!("{flat}.png")), &io::encode_mask(&mask(i)).unwrap()).unwrap();
        io::write_atomic(at("flat-rf").join(format!("{flat}.exr")), &io::encode_exr_f32(&spectrum, "Y").unwrap()).unwrap();
    }
    let [depths, masks, radio] = ["depth", "masks", "rf"].map(|name| text(&at(name)).to_owned());
    let given = ["--depth", &depths, "--masks", &masks, "--rf", &radio, "--rf-camera", "60"];
    for layout in ["nerfstudio", "colmap"] {
        // nerfstudio's names have a folder more than what --images is given.
        let images = text(&at(layout).join("images")).to_owned();
        let (dataset, _) =
            import(&at(layout), layout, &[&given[..], &["--images", &images]].concat(), &at(&format!("{layout}-ds")));
        for i in 0..4 {
            let k = dataset.keyframe(i).unwrap();
            let light = Light { image: picture(i), depth_m: Some(depth(i)), surface: None, mask: Some(mask(i)) };
            assert!(k.light == Some(light), "{layout} {i}");
            assert_eq!(k.radio.unwrap().spectrum.pixels()[0], 1e-6 * value(i), "{layout} {i}");
        }
        for (flag, flat) in [("--depth", "flat-depth"), ("--masks", "flat-masks"), ("--rf", "flat-rf")] {
            let flat = text(&at(flat)).to_owned();
            let more = [&[flag, &flat][..], if flag == "--rf" { &["--rf-camera", "60"][..] } else { &[][..] }].concat();
            refuses(&at(layout), layout, &more, &["cam0/1", "cam1/1", "would both mean"]);
        }
    }
    let flat = text(&at("flat")).to_owned();
    refuses(&at("nerfstudio"), "nerfstudio", &["--images", &flat], &["both mean the picture"]);
    refuses(&at("colmap"), "colmap", &["--images", &flat], &["cam0/1.png and cam1/1.png both mean the picture"]);
    // Two names of one file.
    plain(&at("plain"), |pose| json!(pose.to_rows()));
    let trajectory = fs::read_to_string(at("plain/trajectory.json")).unwrap();
    fs::write(at("plain/trajectory.json"), trajectory.replace("\"file\":\"4\"", "\"file\":\"3.png\"")).unwrap();
    refuses(&at("plain"), "corf-folder", &[], &["both mean"]);
    transforms(&at("twice"), &poses, |i| if i == 3 { "images/../images/2.png".into() } else { format!("images/{i}.png") });
    refuses(&at("twice"), "nerfstudio", &[], &["both mean the picture"]);
}

/// A pose written with so many decimals.
fn rounded(pose: &Rigid3, decimals: i32) -> [[f64; 4]; 4] {
    let unit = 10f64.powi(decimals);
    pose.to_rows().map(|row| row.map(|v| (v * unit).round() / unit))
}

/// Greatest turn between the poses of a data set and those places, degrees.
fn worst_turn_deg(dataset: &Dataset) -> f64 {
    let turn = |(a, b): (Rigid3, Rigid3)| DQuat::from_mat3(&(a.rotation.transpose() * b.rotation)).normalize().to_axis_angle().1;
    let pairs = dataset.poses().iter().map(|p| p.world_from_camera).zip(places());
    pairs.map(turn).fold(0.0, f64::max).to_degrees()
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn rotations_of_few_decimals_become_the_nearest_and_the_data_set_is_valid() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    if let Some(capture) = fault("rounded-rotations/4-decimals") {
        let (_, said) = import(&capture, "nerfstudio", &[], &at("four"));
        assert!(said.contains("images are rounded") && said.contains("nearest"), "{said}");
        assert!(corf_ok(&["dataset", "validate", text(&at("four"))]).contains("passed"));
    }
    if let Some(capture) = fault("import-rounded-poses") {
        import(&capture, "corf-folder", &[], &at("six"));
        assert!(corf_ok(&["dataset", "validate", text(&at("six"))]).contains("passed"));
    }
    for decimals in [3, 4, 5, 6] {
        let capture = at(&format!("plain-{decimals}"));
        plain(&capture, |pose| json!(rounded(pose, decimals)));
        let out = at(&format!("plain-ds-{decimals}"));
        let (dataset, said) = import(&capture, "corf-folder", &[], &out);
        assert_eq!(said.contains("images are rounded"), decimals < 6, "{decimals}: {said}");
        // Half a unit of the last decimal in nine numbers, and as much again.
        assert!(
            worst_turn_deg(&dataset) < (3.0 * 10f64.powi(-decimals)).to_degrees(),
            "{decimals}: {}",
            worst_turn_deg(&dataset)
        );
        assert!(corf_ok(&["dataset", "validate", text(&out)]).contains("passed"), "{decimals}");
    }
    plain(&at("plain-2"), |pose| json!(rounded(pose, 2)));
    refuses(&at("plain-2"), "corf-folder", &[], &["is not a rotation", "at least 3 decimals"]);
    let scaled =
        |by: [f64; 3]| move |pose: &Rigid3| json!(pose.to_rows().map(|[a, b, c, d]| [by[0] * a, by[1] * b, by[2] * c, d]));
    for (name, by, word) in [
        ("mirror", [1.0, 1.0, -1.0], "mirrors"),
        ("scale", [2.0, 2.0, 2.0], "scales by 2.0000"),
        ("axes", [1.0, 1.5, 1.0], "scales its axes by 1.0000, 1.5000 and 1.0000"),
    ] {
        plain(&at(name), scaled(by));
        refuses(&at(name), "corf-folder", &[], &["keyframe 0", word]);
    }
}

#[test]
fn quaternions_of_any_length_near_one_turn_the_same() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let q = DQuat::from_axis_angle(DVec3::new(0.48, 0.6, 0.64), 0.9);
    let names = ["0.png", "1.png", "2.png", "3.png"];
    let model = |name: &str, length: f64, decimals: i32| {
        let unit = 10f64.powi(decimals);
        let q = [q.w, q.x, q.y, q.z].map(|v| (length * v * unit).round() / unit);
        colmap(&at(name), &names.map(|n| (n, q)));
        at(name)
    };
    let (exact, said) = import(&model("exact", 1.0, 15), "colmap", &[], &at("exact-ds"));
    assert!(!said.contains("rounded"), "{said}");
    // Four numbers half a unit of the third decimal off turn a camera by up to 2 mrad, and move one that stands 4 m from the origin by 8 mm.
    for (name, length, decimals, tolerance) in [("long", 1.5, 15, 1e-12), ("three", 1.0, 3, 1e-2)] {
        let (dataset, said) = import(&model(name, length, decimals), "colmap", &[], &at(&format!("{name}-ds")));
        assert!(said.contains("images are rounded"), "{said}");
        let pairs = exact.poses().iter().zip(dataset.poses());
        for (a, b) in pairs.map(|(a, b)| (a.world_from_camera.to_rows(), b.world_from_camera.to_rows())) {
            assert!(a.iter().flatten().zip(b.iter().flatten()).all(|(a, b)| (a - b).abs() < tolerance), "{name}: {a:?} {b:?}");
        }
        assert!(corf_ok(&["dataset", "validate", text(&at(&format!("{name}-ds")))]).contains("passed"));
    }
    refuses(&model("short", 0.01, 15), "colmap", &[], &["0.png", "quaternion", "of length 0.0"]);
    // Poses to render from are taken alike.
    nearest(&at("exact-ds"), &at("run"));
    let pose = exact.poses()[1].world_from_camera;
    fs::write(at("three.json"), json!([rounded(&pose, 3)]).to_string()).unwrap();
    let (_, said) = render(&at("run"), &at("three.json"), &[]);
    assert!(said.contains("rotations of 1 of 1 poses are rounded"), "{said}");
    fs::write(at("mirror.json"), json!([pose.to_rows().map(|[a, b, c, d]| [-a, b, c, d])]).to_string()).unwrap();
    let no = ["render", text(&at("run")), "--poses", text(&at("mirror.json")), "--out", text(&at("no"))].map(str::to_owned);
    corf_refuses(&no.each_ref().map(String::as_str), &["mirror.json: pose 0", "mirrors"]);
}

#[test]
fn a_camera_without_sizes_has_those_of_its_pictures() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let poses: Vec<Value> = places().iter().map(opengl).collect();
    transforms(&at("capture"), &poses, |i| format!("images/{i}.png"));
    let text = fs::read_to_string(at("capture/transforms.json")).unwrap();
    let mut json: Value = serde_json::from_str(&text).unwrap();
    json.as_object_mut().unwrap().retain(|key, _| key != "w" && key != "h");
    fs::write(at("capture/transforms.json"), json.to_string()).unwrap();
    let camera = import(&at("capture"), "nerfstudio", &[], &at("ds")).0.light_camera();
    assert_eq!(camera, Pinhole { width: 16, height: 12, fx: 14.0, fy: 14.0, cx: 8.0, cy: 6.0 });
}
