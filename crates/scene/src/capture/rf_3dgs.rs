//! RF-3DGS sets: a COLMAP model, images, and the lists `train_index.txt` and `test_index.txt` of stems.
//!
//! RF-3DGS is told by a flag which folder it trains on. Where there is a folder `spectrum/`, that holds the spectra and `images/` the images;
//! otherwise `images/` holds spectra, and the set has no images. It takes the field of view from the model and the size from the pictures, so
//! that spectra may be smaller than the model's camera.

use super::{Capture, Lists, Shot, colmap};
use crate::{Error, Pinhole, Result, io};
use std::path::Path;

/// Reads a set; `wanted` says whether its images are needed, `with_lists` whether its lists are.
///
/// # Errors
/// Those of [`colmap::read`]; lists that are missing.
pub(super) fn read(source: &Path, images: &Path, wanted: bool, with_lists: bool) -> Result<Capture> {
    let own = source.join("spectrum");
    let two = own.is_dir();
    let mut capture = colmap::read(source, images, wanted && two)?;
    capture.spectra = Some(if two { own } else { source.join("images") });
    if !two {
        capture.notes.push("images/ was taken for spectra, as there is no folder spectrum/ beside it".into());
    }
    if !with_lists {
        return Ok(capture);
    }
    let (train, test) = (source.join("train_index.txt"), source.join("test_index.txt"));
    let read = |path: &Path| -> Result<Vec<String>> {
        if !path.is_file() {
            return Err(Error::invalid(
                path.display().to_string(),
                "there is no such file",
                "give --split, or import it with --from colmap",
            ));
        }
        Ok(io::read_text(path)?.lines().map(|l| l.trim().to_owned()).filter(|l| !l.is_empty()).collect())
    };
    capture.lists = Some(Lists {
        train: Some(read(&train)?),
        test: Some(read(&test)?),
        others: Vec::new(),
        place: test.display().to_string(),
    });
    capture.files.extend([train, test]);
    Ok(capture)
}

/// The camera of spectra of a size, which is the model's own in other pixels.
///
/// # Errors
/// Several cameras, or one with distortion.
pub(super) fn camera_of_spectra(shots: &[Shot], width: usize, height: usize) -> Result<Pinhole> {
    let first = &shots[0];
    if let Some(other) = shots.iter().find(|s| s.lens != first.lens || !s.lens.is_plain()) {
        return Err(Error::invalid(
            format!("image {}", other.name),
            "the spectra of a set have one camera, without distortion, and this has another",
            "give the camera of the spectra with --rf-camera",
        ));
    }
    Ok(resized(&first.lens.pinhole, width, height))
}

/// The camera of pictures of a size whose field of view is that of a model's camera: the same frame in other pixels.
pub(super) fn resized(camera: &Pinhole, width: usize, height: usize) -> Pinhole {
    let (x, y) = (width as f64 / camera.width as f64, height as f64 / camera.height as f64);
    Pinhole { width, height, fx: x * camera.fx, fy: y * camera.fy, cx: x * camera.cx, cy: y * camera.cy }
}
