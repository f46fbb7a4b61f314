//! Readers of captures that others' programs made: the input is a file of one, and the rest of it is as it should be.

use crate::files::{parts, put};
use anyhow::Result;
use corf_scene::capture::{self, CaptureOptions, Format, RadioCamera};
use corf_scene::dataset::{Dataset, import_fixed_array, stem};
use corf_scene::keyframe::DbRange;
use corf_scene::{Raster, io};
use std::path::Path;

/// Size of the pictures, pixels.
const SIZE: (usize, usize) = (4, 3);
const CAMERAS: &str = "1 PINHOLE 4 3 2 2 2 1.5\n";
const IMAGES: &str = "1 1 0 0 0 0 0 0 1 a.png\n\n2 1 0 0 0 -1 0 0 1 b.png\n\n";
const POINTS: &str = "1 0 0 2 9 9 9 0\n";

/// Puts the two pictures that all corpora name into a folder, once.
fn pictures(folder: &Path, name: &str) -> Result<()> {
    for (i, picture) in ["a.png", "b.png"].iter().enumerate() {
        let path = folder.join(name).join(picture);
        if !path.exists() {
            io::write_png(path, &Raster::from_fn(SIZE.0, SIZE.1, |x, y| [(60 * x + 20 * y + i) as u8; 3]))?;
        }
    }
    Ok(())
}

/// Reads a capture. A number of keyframes that is none is as bad as a panic.
fn examine(options: &CaptureOptions) -> Result<()> {
    let count = capture::examine(options)?;
    assert!(count > 0 && stem(count - 1).len() >= 5, "a capture of {count} keyframes");
    Ok(())
}

fn colmap(bytes: &[u8], folder: &Path, ending: &str) -> Result<()> {
    pictures(folder, "images")?;
    std::fs::create_dir_all(folder.join("sparse/0"))?;
    let files: [&[u8]; 5] = parts(bytes);
    for (name, content) in ["cameras", "images", "points3D", "rigs", "frames"].iter().zip(files) {
        let path = put(folder, &format!("sparse/0/{name}.{ending}"), content)?;
        // A model of before there were rigs has no such files.
        if content.is_empty() && ["rigs", "frames"].contains(name) {
            std::fs::remove_file(path)?;
        }
    }
    examine(&CaptureOptions::new(Format::Colmap, folder))
}

pub(crate) fn colmap_text(bytes: &[u8], folder: &Path) -> Result<()> {
    colmap(bytes, folder, "txt")
}

pub(crate) fn colmap_binary(bytes: &[u8], folder: &Path) -> Result<()> {
    colmap(bytes, folder, "bin")
}

pub(crate) fn transforms(bytes: &[u8], folder: &Path) -> Result<()> {
    pictures(folder, "images")?;
    put(folder, "transforms.json", bytes)?;
    examine(&CaptureOptions { ignore_masks: true, ..CaptureOptions::new(Format::Nerfstudio, folder) })
}

/// A whole COLMAP model of the two pictures.
fn model(folder: &Path) -> Result<()> {
    if !folder.join("sparse/0/points3D.txt").exists() {
        std::fs::create_dir_all(folder.join("sparse/0"))?;
        for (name, content) in [("cameras", CAMERAS), ("images", IMAGES), ("points3D", POINTS)] {
            put(folder, &format!("sparse/0/{name}.txt"), content.as_bytes())?;
        }
    }
    pictures(folder, "images")
}

const LEVELS: DbRange = DbRange { min_db: -110.0, max_db: -40.0 };

pub(crate) fn rf_3dgs_lists(bytes: &[u8], folder: &Path) -> Result<()> {
    model(folder)?;
    pictures(folder, "spectrum")?;
    let [train, test] = parts(bytes);
    put(folder, "train_index.txt", train)?;
    put(folder, "test_index.txt", test)?;
    examine(&CaptureOptions { radio_db: Some(LEVELS), ..CaptureOptions::new(Format::Rf3dgs, folder) })
}

/// Both pictures with one spectrum.
fn spectrum(bytes: &[u8], folder: &Path, ending: &str) -> Result<()> {
    model(folder)?;
    let spectra = folder.join("spectra");
    std::fs::create_dir_all(&spectra)?;
    for name in ["a", "b"] {
        put(&spectra, &format!("{name}.{ending}"), bytes)?;
    }
    let options = CaptureOptions::new(Format::Colmap, folder);
    examine(&CaptureOptions {
        radio: Some(spectra),
        radio_camera: Some(RadioCamera::HorizontalFovDeg(90.0)),
        radio_db: (ending == "png").then_some(LEVELS),
        ..options
    })
}

pub(crate) fn spectrum_npy(bytes: &[u8], folder: &Path) -> Result<()> {
    spectrum(bytes, folder, "npy")
}

pub(crate) fn spectrum_png(bytes: &[u8], folder: &Path) -> Result<()> {
    spectrum(bytes, folder, "png")
}

/// A plain capture of spectra alone, whose sensor this file states.
pub(crate) fn spectra_json(bytes: &[u8], folder: &Path) -> Result<()> {
    let spectra = folder.join("spectra");
    if !spectra.exists() {
        std::fs::create_dir_all(&spectra)?;
        let pose = |x: usize| format!("[[1,0,0,{x}],[0,1,0,0],[0,0,1,0],[0,0,0,1]]");
        let keyframe = |(x, name): (usize, &str)| format!("{{\"file\": \"{name}\", \"world_from_camera\": {}}}", pose(x));
        let keyframes: Vec<String> = ["a", "b"].into_iter().enumerate().map(keyframe).collect();
        put(folder, "trajectory.json", format!("{{\"keyframes\": [{}]}}", keyframes.join(",")).as_bytes())?;
        for name in ["a", "b"] {
            put(&spectra, &format!("{name}.npy"), include_bytes!("../corpus/spectrum-npy/f4.npy"))?;
        }
    }
    put(folder, "spectra.json", bytes)?;
    examine(&CaptureOptions {
        without_images: true,
        radio: Some(spectra),
        radio_camera: Some(RadioCamera::HorizontalFovDeg(90.0)),
        ..CaptureOptions::new(Format::CorfFolder, folder)
    })
}

/// A set of an array that stands still, with two spectra: the gateway, places and both lists. What was taken is a data set.
pub(crate) fn fixed_array(bytes: &[u8], folder: &Path) -> Result<()> {
    let (set, out) = (folder.join("set"), folder.join("out"));
    std::fs::create_dir_all(set.join("spectrum"))?;
    for name in ["00001", "00002"] {
        let path = set.join("spectrum").join(name).with_extension("png");
        if !path.exists() {
            put(folder, "level.png", &io::encode_png8(&Raster::from_fn(360, 90, |x, y| (x + y) as u8))?)?;
            std::fs::rename(folder.join("level.png"), path)?;
        }
    }
    let files: [&[u8]; 4] = parts(bytes);
    for (name, content) in ["gateway_info.yml", "tx_pos.csv", "train_index.txt", "test_index.txt"].iter().zip(files) {
        put(&set, name, content)?;
    }
    std::fs::remove_dir_all(&out).ok();
    let taken = import_fixed_array(&set, &out, "fuzz", &|_, _| Ok::<(), corf_scene::Error>(()))?;
    let dataset = Dataset::open_any(&out)?;
    let array = dataset.fixed_array().expect("the set is of an array that stands still");
    assert!(dataset.len() == taken.keyframes && taken.keyframes > 0, "{} keyframes of {}", dataset.len(), taken.keyframes);
    assert!(array.directions().pixels().iter().all(|d| (d.length() - 1.0).abs() < 1e-9), "a direction is no unit vector");
    Ok(())
}
