//! Pixels of captures that are transparent: in every layout, beside masks, through live folders, and in spectra.

use crate::common::{copy_folder, corf, corf_ok, text, tiny_dataset};
use crate::faults_captures::{SIZE, colmap, fault, import, opengl, picture, places, plain, refuses, transforms};
use corf_scene::dataset::{Dataset, stem};
use corf_scene::{Raster, io};
use serde_json::{Value, json};
use std::fs;
use std::path::Path;

/// Columns of a mask in which no pixel counts; the others count whole.
fn columns_left_out(mask: &Raster<bool>) -> usize {
    let column = |x: usize| (0..mask.height()).filter(|y| !mask[(x, *y)]).count();
    let columns: Vec<usize> = (0..mask.width()).map(column).collect();
    assert!(columns.iter().all(|n| *n == 0 || *n == mask.height()), "{columns:?}");
    columns.iter().filter(|n| **n > 0).count()
}

#[test]
#[cfg_attr(not(reference_data), ignore = "needs reference files: CORF_SHARED")]
fn transparent_pixels_and_those_of_masks_in_alpha_do_not_count() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let Some(capture) = fault("alpha/image-cut-out") else { return };
    let (dataset, said) = import(&capture, "nerfstudio", &[], &at("cut"));
    assert!(said.contains("4 of 4 images have transparent pixels") && said.contains("do not count"), "{said}");
    for i in 0..dataset.len() {
        let light = dataset.keyframe(i).unwrap().light.unwrap();
        // What is below the transparent pixels is painted in a colour of its own.
        assert_eq!(light.mask.unwrap(), light.image.map(|p| *p != [255, 0, 255]), "{i}");
    }
    assert!(corf_ok(&["dataset", "validate", text(&at("cut"))]).contains("passed"));
    let (dataset, said) = import(&capture, "nerfstudio", &["--ignore-masks"], &at("whole"));
    assert!(!dataset.has_masks() && said.contains("transparency of 4 of 4 images was left out"), "{said}");

    let Some(capture) = fault("alpha/mask-in-alpha-of-white") else { return };
    let masks = capture.join("masks");
    let (dataset, said) = import(&capture, "nerfstudio", &["--masks", text(&masks)], &at("masked"));
    assert!(said.contains("30.0 % of the pixels"), "{said}");
    for i in 0..dataset.len() {
        assert_eq!(columns_left_out(&dataset.keyframe(i).unwrap().light.unwrap().mask.unwrap()), 12);
    }
}

/// Which pixels of an image are made transparent here.
fn counts(i: usize) -> Raster<bool> {
    Raster::from_fn(SIZE[0], SIZE[1], |x, _| x >= 2 + i % 3)
}

/// An image of a place that is transparent where it does not count, with alpha of 8 or 16 bits, in colour or grey.
fn cut_out(i: usize, path: &Path) {
    let (image, counts) = (picture(i), counts(i));
    let pixel = |x: u32, y: u32| (image[(x as usize, y as usize)], counts[(x as usize, y as usize)]);
    let (w, h) = (SIZE[0] as u32, SIZE[1] as u32);
    let wide = |v: u8| u16::from(v) * 257;
    let image = match i % 3 {
        // What is half transparent does not count either.
        0 => image::DynamicImage::ImageRgba8(image::RgbaImage::from_fn(w, h, |x, y| {
            let ([r, g, b], counts) = pixel(x, y);
            image::Rgba([r, g, b, if counts { 255 } else { 128 }])
        })),
        1 => image::DynamicImage::ImageRgba16(image::ImageBuffer::from_fn(w, h, |x, y| {
            let ([r, g, b], counts) = pixel(x, y);
            // In eight bits as opaque as the others.
            image::Rgba([wide(r), wide(g), wide(b), if counts { u16::MAX } else { u16::MAX - 1 }])
        })),
        _ => image::DynamicImage::ImageLumaA8(image::ImageBuffer::from_fn(w, h, |x, y| {
            let ([_, g, _], counts) = pixel(x, y);
            image::LumaA([g, if counts { 255 } else { 0 }])
        })),
    };
    image.save_with_format(path, image::ImageFormat::Png).unwrap();
}

#[test]
fn transparency_is_seen_in_every_layout() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    plain(&at("corf-folder"), |pose| json!(pose.to_rows()));
    let poses: Vec<Value> = places().iter().map(opengl).collect();
    transforms(&at("nerfstudio"), &poses, |i| format!("images/{i}.png"));
    let one = [1.0, 0.0, 0.0, 0.0];
    colmap(&at("colmap"), &["0.png", "1.png", "2.png", "3.png", "4.png"].map(|n| (n, one)));
    for layout in ["corf-folder", "nerfstudio", "colmap"] {
        (0..5).for_each(|i| cut_out(i, &at(layout).join(format!("images/{i}.png"))));
        let (dataset, said) = import(&at(layout), layout, &[], &at(&format!("{layout}-ds")));
        assert!(said.contains("5 of 5 images have transparent pixels"), "{layout}: {said}");
        assert!((0..5).all(|i| dataset.keyframe(i).unwrap().light.unwrap().mask == Some(counts(i))), "{layout}");
    }
    // A mask and transparency leave out what either does.
    fs::create_dir(at("masks")).unwrap();
    let upper = Raster::from_fn(SIZE[0], SIZE[1], |_, y| y > 3);
    fs::write(at("masks/1.png"), io::encode_mask(&upper).unwrap()).unwrap();
    fs::write(at("masks/9.png"), io::encode_mask(&upper).unwrap()).unwrap();
    let (dataset, said) = import(&at("colmap"), "colmap", &["--masks", text(&at("masks"))], &at("both"));
    let both = Raster::from_fn(SIZE[0], SIZE[1], |x, y| upper[(x, y)] && counts(1)[(x, y)]);
    assert!(
        dataset.keyframe(1).unwrap().light.unwrap().mask == Some(both)
            && dataset.keyframe(2).unwrap().light.unwrap().mask == Some(counts(2))
    );
    assert!(said.contains("1 mask belongs to no image"), "{said}");
    // Nothing left, and a mask of which nothing can be known.
    let glass = io::encode_cut_out(&picture(2), &Raster::filled(SIZE[0], SIZE[1], false)).unwrap();
    fs::write(at("colmap/images/2.png"), glass).unwrap();
    refuses(&at("colmap"), "colmap", &[], &["2.png", "none of its pixels is opaque", "--ignore-masks"]);
    io::write_png(at("colmap/images/2.png"), &picture(2)).unwrap();
    let black = Raster::filled(SIZE[0], SIZE[1], [0; 3]);
    fs::write(at("masks/1.png"), io::encode_cut_out(&black, &upper).unwrap()).unwrap();
    refuses(&at("colmap"), "colmap", &["--masks", text(&at("masks"))], &["1.png", "black or transparent"]);
    // White masks leave nothing out, which is said.
    plain(&at("opaque"), |pose| json!(pose.to_rows()));
    fs::write(at("masks/1.png"), io::encode_mask(&Raster::filled(SIZE[0], SIZE[1], true)).unwrap()).unwrap();
    let (_, said) = import(&at("opaque"), "corf-folder", &["--masks", text(&at("masks"))], &at("white"));
    assert!(said.contains("1 mask leaves no pixel out"), "{said}");
    // A channel that is opaque everywhere makes no mask.
    let opaque = io::encode_cut_out(&picture(0), &Raster::filled(SIZE[0], SIZE[1], true)).unwrap();
    fs::write(at("opaque/images/0.png"), opaque).unwrap();
    assert!(!import(&at("opaque"), "corf-folder", &[], &at("no-masks")).0.has_masks());
}

#[test]
fn transparency_passes_through_live_folders_and_spectra_have_none() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    // The tiny data set as a capture, of which two images have a hole.
    let ours = Dataset::open(tiny_dataset()).unwrap();
    for below in ["images", "sparse"] {
        copy_folder(&tiny_dataset().join("optical").join(below), &at("capture").join(below));
    }
    let counts = |i: usize| Raster::from_fn(96, 54, |x, y| x > 5 + i || y > 20);
    let holes = [1, 4];
    for i in holes {
        let bytes = io::encode_cut_out(&ours.keyframe(i).unwrap().light.unwrap().image, &counts(i)).unwrap();
        fs::write(at("capture").join(format!("images/{}.png", stem(i))), bytes).unwrap();
    }
    let radio = text(&tiny_dataset().join("rf/spectra")).to_owned();
    import(&at("capture"), "colmap", &["--rf", &radio, "--rf-camera", "90"], &at("ds"));
    corf_ok(&["dataset", "play", text(&at("ds")), "--to", text(&at("live")), "--rate", "1000"]);
    let (live, run) = (at("live"), at("run"));
    let few = ["--set", "iterations_per_keyframe=1", "--device", "cpu"];
    let output = corf(&[&["reconstruct", "--follow", text(&live), "--out", text(&run)], &few[..]].concat());
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success() && said.matches("transparent pixels are neither").count() == 1, "{said}");
    let recorded = Dataset::open(run.join("dataset")).unwrap();
    for i in 0..ours.len() {
        assert_eq!(recorded.keyframe(i).unwrap().light.unwrap().mask, holes.contains(&i).then(|| counts(i)), "{i}");
    }
    assert!(corf_ok(&["dataset", "validate", text(&run.join("dataset"))]).contains("passed"));
    // A spectrum's picture with transparent pixels has values that nobody knows.
    let grey = io::encode_cut_out(&Raster::filled(8, 6, [90; 3]), &Raster::from_fn(8, 6, |x, _| x > 0)).unwrap();
    fs::create_dir(at("pictures")).unwrap();
    (0..ours.len()).for_each(|i| fs::write(at("pictures").join(format!("{}.png", stem(i))), &grey).unwrap());
    let pictures = text(&at("pictures")).to_owned();
    let flags = ["--rf", &pictures, "--rf-camera", "60", "--rf-db=-110,-40"];
    refuses(&at("capture"), "colmap", &flags, &["00001.png", "pixel (0, 0) is transparent"]);
}
