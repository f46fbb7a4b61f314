//! Checks of the paths of a dataset's files, and of the values of spectra.

use super::layout;
use crate::contained::{self, Reach};
use crate::{Error, Raster, Result};
use std::path::{Path, PathBuf};

/// The path of a file that a data set in `dir` names: its own, in its folder and regular.
pub(super) fn own_file(dir: &Path, name: &str) -> Result<PathBuf> {
    let place = dir.join(layout::DATASET_JSON).display().to_string();
    contained::resolve(dir, Path::new(name), Reach::Folder, &place, contained::DATASET_HELP)
}

/// Every value finite and at least 0.
pub(super) fn check_spectrum(spectrum: &Raster<f32>, place: &str) -> Result<()> {
    match spectrum.pixels().iter().position(|v| !(v.is_finite() && *v >= 0.0)) {
        None => Ok(()),
        Some(i) => Err(Error::invalid(
            place,
            format!("pixel ({}, {}) is {}", i % spectrum.width(), i / spectrum.width(), spectrum.pixels()[i]),
            "a spectrum is linear power: finite and at least 0",
        )),
    }
}
