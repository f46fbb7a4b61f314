//! Maps of known depths in every unit, with holes, and what is said about those that cannot be used.

use super::*;
use crate::config::DepthPriorKind;
use crate::depth::{AlignedPrior, DepthPrior, SparseDepth, align};
use corf_scene::Raster;
use corf_scene::io::{encode_exr_f32, encode_png16, write_atomic};
use corf_scene::npz::{Array, Values};
use std::path::Path;

const SIZE: (usize, usize) = (32, 24);

/// A slanted wall with a nearer half, metres; nothing in a corner and in one pixel.
fn depth() -> Raster<f32> {
    Raster::from_fn(SIZE.0, SIZE.1, |x, y| match (x, y) {
        (28.., 20..) => f32::INFINITY,
        (5, 7) => 0.0,
        (16.., _) => 1.5 + 0.01 * y as f32,
        _ => 3.0 + 0.02 * x as f32,
    })
}

fn prior(folder: &Path, folder_kind: FolderKind, png_scale: f64) -> FolderPrior {
    FolderPrior::new(folder.to_owned(), &DepthConfig { folder_kind, png_scale, ..DepthConfig::default() })
}

fn anchors(count: usize) -> Vec<SparseDepth> {
    let exact = depth();
    let places = (0..count).map(|i| ((i * 7) % SIZE.0, (i * 5) % SIZE.1));
    // A depth is triangulated where the map has a hole too.
    places
        .map(|(x, y)| SparseDepth { x, y, inverse_depth: if exact[(x, y)] > 0.0 { 1.0 / exact[(x, y)] } else { 9.0 } })
        .collect()
}

#[test]
fn maps_in_every_unit_are_aligned_to_the_same_depths() {
    let dir = tempfile::tempdir().unwrap();
    let config = DepthConfig::default();
    let relative = |z: &f32| if *z > 0.0 && z.is_finite() { 40.0 / z - 3.0 } else { 0.0 };
    for (kind, stored) in [
        (FolderKind::InverseRelative, depth().map(relative)),
        (FolderKind::DepthRelative, depth().map(|z| 17.0 * z)),
        (FolderKind::DepthMetric, depth().map(|z| 1.1 * z)),
        (FolderKind::InverseMetric, depth().map(|z| if *z > 0.0 { 0.9 / z } else { f32::NAN })),
    ] {
        write_atomic(dir.path().join("00004.exr"), &encode_exr_f32(&stored, "Y").unwrap()).unwrap();
        let dense = prior(dir.path(), kind, 1.0).read(3, SIZE).unwrap();
        assert!(!dense.is_known(5, 7) && !dense.is_known(30, 22) && dense.is_known(6, 7) && dense.is_known(27, 20));
        let AlignedPrior { inverse_depth, confidence, .. } = align(&dense, &anchors(300), &config).unwrap();
        let exact = depth();
        for (x, y) in (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y))) {
            let (found, z) = (inverse_depth.at(x, y), exact[(x, y)]);
            if z > 0.0 && z.is_finite() {
                assert!((found * z - 1.0).abs() < 1e-3, "{kind:?} ({x}, {y}): {found} and 1/{z}");
            } else {
                assert!(found.is_finite() && confidence.at(x, y) == 0.0);
            }
        }
        assert!(confidence.at(6, 7) > 0.5 && confidence.at(5, 8) > 0.5, "what is beside a hole is as good as before");
        // Where nothing can be aligned to, metres are metres.
        let unaligned = align(&dense, &anchors(5), &config);
        match kind {
            FolderKind::InverseRelative | FolderKind::DepthRelative => assert!(unaligned.is_none()),
            _ => {
                let prior = unaligned.unwrap();
                assert_eq!((prior.scale, prior.offset), (1.0, 0.0));
                assert!((prior.inverse_depth.at(2, 2) * exact[(2, 2)] - 1.0).abs() < 0.11);
            }
        }
    }
}

#[test]
fn a_pngs_unit_is_what_the_configuration_says() {
    let dir = tempfile::tempdir().unwrap();
    let stored = depth().map(|z| if z.is_finite() { (5000.0 * z).round() as u16 } else { 0 });
    write_atomic(dir.path().join("00001.png"), &encode_png16(&stored).unwrap()).unwrap();
    let dense = prior(dir.path(), FolderKind::DepthMetric, 5000.0).read(0, SIZE).unwrap();
    assert!(dense.is_metric() && (1.0 / dense.at(3, 3) - depth()[(3, 3)]).abs() < 1e-3);
    let inverse = prior(dir.path(), FolderKind::InverseMetric, 5000.0).read(0, SIZE).unwrap();
    assert!((inverse.at(3, 3) - depth()[(3, 3)]).abs() < 1e-3);
}

#[test]
fn whole_numbers_of_an_array_are_counted_like_a_pngs_and_no_room_is_kilometres_deep() {
    let dir = tempfile::tempdir().unwrap();
    let stored = depth().map(|z| if z.is_finite() { (1000.0 * z).round() as u32 } else { 0 }).into_vec();
    let array = Array::new("x", &[SIZE.1, SIZE.0], Values::U32(stored)).to_npy();
    write_atomic(dir.path().join("00001.npy"), &array).unwrap();
    let read = |kind, scale| prior(dir.path(), kind, scale).read(0, SIZE);
    let dense = read(FolderKind::DepthMetric, 1000.0).unwrap();
    assert!((1.0 / dense.at(3, 3) - depth()[(3, 3)]).abs() < 1e-3);
    let fault = read(FolderKind::DepthMetric, 1.0).unwrap_err().to_string();
    assert!(fault.contains("no room has") && fault.contains("depth.png_scale"), "{fault}");
    // Relative maps have no unit.
    read(FolderKind::DepthRelative, 1.0).unwrap();
    // Metres as floats, and millimetres that pass for them.
    std::fs::remove_file(dir.path().join("00001.npy")).unwrap();
    for (factor, fine) in [(1.0, true), (1000.0, false), (1e-3, false)] {
        write_atomic(dir.path().join("00001.exr"), &encode_exr_f32(&depth().map(|z| factor * z), "Z").unwrap()).unwrap();
        assert_eq!(read(FolderKind::DepthMetric, 1000.0).is_ok(), fine, "{factor}");
    }
}

#[test]
fn a_map_may_have_any_resolution_of_the_images_shape() {
    let dir = tempfile::tempdir().unwrap();
    let write = |width: usize, height: usize| {
        let map = Raster::from_fn(width, height, |x, y| if x < width / 2 { 1.0 } else { 2.0 + (y as f32 + 0.5) / height as f32 });
        write_atomic(dir.path().join("00001.exr"), &encode_exr_f32(&map, "Z").unwrap()).unwrap();
        prior(dir.path(), FolderKind::InverseRelative, 1.0).read(0, SIZE)
    };
    // An eighth, thrice, and one pixel off, of a 32×24 image.
    for (width, height) in [(4, 3), (96, 72), (300, 223)] {
        let dense = write(width, height).unwrap();
        assert!(dense.grid().width() <= SIZE.0 && dense.grid().height() <= SIZE.1);
        assert_eq!(dense.at(1, 5), 1.0);
        assert!((dense.at(30, 12) - 2.5).abs() < 0.1, "{width}x{height}: {}", dense.at(30, 12));
    }
    let error = write(32, 32).unwrap_err().to_string();
    assert!(error.contains("00001.exr, keyframe 0") && error.contains("32x32") && error.contains("32x24"), "{error}");
}

#[test]
fn what_is_wrong_with_a_folder_is_said_of_the_first_keyframe_it_concerns() {
    let dir = tempfile::tempdir().unwrap();
    let config = DepthConfig { prior: DepthPriorKind::Folder, folder: Some(dir.path().to_owned()), ..DepthConfig::default() };
    let prior = DepthPrior::new(&config, 1).unwrap();
    assert!(!prior.consumes_ground_truth_depth());
    let fault = || prior.check_all(&[0, 2, 3], SIZE).unwrap_err().to_string();
    let write = |name: &str, map: &Raster<f32>| {
        write_atomic(dir.path().join(name), &encode_exr_f32(map, "Z").unwrap()).unwrap();
    };
    assert!(fault().contains("keyframe 0") && fault().contains("00001.exr"), "{}", fault());
    write("00001.exr", &depth());
    write("00004.exr", &Raster::filled(SIZE.0, SIZE.1, f32::NAN));
    assert!(fault().contains("keyframe 2") && fault().contains("00003.npy"), "{}", fault());
    write("00003.exr", &depth());
    assert!(fault().contains("00004.exr, keyframe 3") && fault().contains("no pixel has a value"), "{}", fault());
    write("00004.exr", &depth());
    prior.check_all(&[0, 2, 3], SIZE).unwrap();
    std::fs::write(dir.path().join("00003.npy"), b"").unwrap();
    assert!(fault().contains("00003.npy are there") && fault().contains("leave one"), "{}", fault());
    std::fs::remove_file(dir.path().join("00003.exr")).unwrap();
    assert!(fault().contains("not a .npy file"), "{}", fault());
    drop(dir);
    assert!(fault().contains("no such folder"), "{}", fault());
}
