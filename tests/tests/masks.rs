//! Masks of images: what they leave out is neither learnt from nor compared.

use crate::common::{corf_ok, corf_refuses, text, tiny_dataset};
use corf_scene::dataset::{Dataset, stem};
use corf_scene::{Raster, io};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// Whether a pixel of every image counts: not where the platform itself stands in it.
fn counts(x: usize, y: usize) -> bool {
    !(24..56).contains(&x) || y < 34
}

/// A data set's images as a capture of nerfstudio's, with something painted into each that moves as the camera does, and masks that know it.
fn capture(of: &Path, folder: &Path, paint: bool) {
    let dataset = Dataset::open(of).unwrap();
    for below in ["images", "masks"] {
        fs::create_dir_all(folder.join(below)).unwrap();
    }
    let frame = |index: usize| {
        let keyframe = dataset.keyframe(index).unwrap();
        let (name, image) = (format!("images/{}.png", stem(index)), keyframe.light.unwrap().image);
        let painted = Raster::from_fn(image.width(), image.height(), |x, y| match paint && !counts(x, y) {
            true => [255, (97 * (x / 4 + y / 4 + index) % 256) as u8, 0],
            false => image[(x, y)],
        });
        let mask = Raster::from_fn(image.width(), image.height(), counts);
        fs::write(folder.join(&name), io::encode_png(&painted).unwrap()).unwrap();
        fs::write(folder.join(format!("masks/{}.png", stem(index))), io::encode_mask(&mask).unwrap()).unwrap();
        let rows = keyframe.world_from_camera.to_rows().map(|[a, b, c, d]| [a, -b, -c, d]);
        json!({ "file_path": name, "transform_matrix": rows })
    };
    let frames: Vec<Value> = (0..dataset.len()).map(frame).collect();
    let c = dataset.light_camera();
    let json = json!({ "w": c.width, "h": c.height, "fl_x": c.fx, "fl_y": c.fy, "cx": c.cx, "cy": c.cy, "frames": frames });
    fs::write(folder.join("transforms.json"), json.to_string()).unwrap();
}

/// PSNR of held-out images after a short reconstruction.
fn psnr(dataset: &Path, run: &Path) -> f64 {
    let settings = ["--set", "depth.prior=\"exact\"", "--set", "iterations_per_keyframe=40", "--device", "cpu"];
    corf_ok(&[&["reconstruct", text(dataset), "--out", text(run)], &settings[..]].concat());
    let record: Value = serde_json::from_str(&corf_ok(&["evaluate", text(run), "--json"])).unwrap();
    record["means"]["psnr_opt"].as_f64().unwrap()
}

#[test]
fn what_a_mask_leaves_out_spoils_nothing_and_counts_nowhere() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    let (room, painted, clean) = (path("room"), path("painted"), path("clean"));
    corf_ok(&["dataset", "generate", "scenes/room-tiny.toml", "--out", text(&room)]);
    capture(&room, &painted, true);
    capture(&room, &clean, false);
    let depth = room.join("optical/depth");
    let import = |from: &Path, masks: Option<&Path>, out: &Path| {
        let flags =
            ["--depth", text(&depth)].into_iter().chain(masks.iter().flat_map(|m| ["--masks", text(m)])).collect::<Vec<_>>();
        corf_ok(&[&["dataset", "import", text(from), "--from", "nerfstudio", "--out", text(out)], &flags[..]].concat());
    };
    let (masked, whole, truth) = (path("masked"), path("whole"), path("truth"));
    import(&painted, Some(&painted.join("masks")), &masked);
    import(&painted, None, &whole);
    import(&clean, Some(&clean.join("masks")), &truth);
    assert!(corf_ok(&["dataset", "validate", text(&masked)]).contains("passed"));
    let dataset = Dataset::open(&masked).unwrap();
    let mask = dataset.keyframe(3).unwrap().light.unwrap().mask.unwrap();
    assert!(dataset.has_masks() && mask == Raster::from_fn(mask.width(), mask.height(), counts));
    assert!(!Dataset::open(&whole).unwrap().has_masks());
    let [masked_db, whole_db, truth_db] =
        [(&masked, "run-masked"), (&whole, "run-whole"), (&truth, "run-truth")].map(|(data, run)| psnr(data, &path(run)));
    // What is painted stands in another place of the room in every image, and is not seen through the mask.
    assert!(masked_db > whole_db + 3.0, "{masked_db} dB with masks, {whole_db} without");
    assert!((masked_db - truth_db).abs() < 0.5, "{masked_db} dB with paint behind the masks, {truth_db} without");
}

#[test]
fn masks_go_out_to_nerfstudio_and_come_back_by_their_names() {
    let folder = tempfile::tempdir().unwrap();
    let path = |name: &str| folder.path().join(name);
    capture(tiny_dataset(), &path("capture"), true);
    // One image has none.
    fs::remove_file(path("capture").join(format!("masks/{}.png", stem(2)))).unwrap();
    let import = |from: &str, out: &str, more: &[&str]| {
        let (from, out) = (path(from), path(out));
        corf_ok(&[&["dataset", "import", text(&from), "--from", "nerfstudio", "--out", text(&out)], more].concat());
    };
    import("capture", "ours", &["--masks", text(&path("capture/masks"))]);
    corf_ok(&["dataset", "export", text(&path("ours")), "--to", "nerfstudio", "--out", text(&path("theirs"))]);
    let transforms: Value = serde_json::from_str(&fs::read_to_string(path("theirs/transforms.json")).unwrap()).unwrap();
    let frames = transforms["frames"].as_array().unwrap();
    assert!(frames.iter().all(|f| f["mask_path"].is_string()), "nerfstudio takes masks of all images or of none");
    import("theirs", "back", &[]);
    let (ours, back) = (Dataset::open(path("ours")).unwrap(), Dataset::open(path("back")).unwrap());
    for i in 0..ours.len() {
        let [a, b] = [&ours, &back].map(|d| d.keyframe(i).unwrap().light.unwrap());
        assert_eq!(a.mask.is_none(), i == 2);
        assert_eq!(a.mask.unwrap_or_else(|| Raster::filled(a.image.width(), a.image.height(), true)), b.mask.unwrap(), "{i}");
    }
    import("theirs", "ignored", &["--ignore-masks"]);
    assert!(!Dataset::open(path("ignored")).unwrap().has_masks());
    // A mask of another size, and a folder in which no image has one.
    let (theirs, out) = (path("theirs"), path("refused"));
    let command = |masks: &Path| {
        ["dataset", "import", text(&theirs), "--from", "nerfstudio", "--out", text(&out), "--masks", text(masks)]
            .map(str::to_owned)
    };
    let wrong = path("wrong");
    fs::create_dir(&wrong).unwrap();
    fs::write(wrong.join("nobody.png"), io::encode_mask(&Raster::filled(96, 54, true)).unwrap()).unwrap();
    let refuses = |words: &[&str]| corf_refuses(&command(&wrong).each_ref().map(String::as_str), words);
    refuses(&["no image has a mask here"]);
    fs::write(wrong.join("00001.png"), io::encode_mask(&Raster::filled(95, 54, true)).unwrap()).unwrap();
    refuses(&["95x54", "masks of the images' size"]);
    assert!(!out.exists());
}
