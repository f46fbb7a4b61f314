//! Depth maps that are there already: one a keyframe, in a folder.

use super::dense::Dense;
use crate::config::{DepthConfig, FolderKind};
use crate::{Error, Result};
use corf_scene::io::{self, Map, Stored};
use corf_scene::{bounds, dataset};
use rayon::prelude::*;
use std::path::PathBuf;

/// File extensions of the maps.
const EXTENSIONS: [&str; 3] = ["exr", "npy", "png"];
/// Tolerance between the aspect ratios of a map and of the image.
const ASPECT_TOLERANCE: f64 = 0.01;

/// A folder of maps, one a keyframe.
#[derive(Clone, Debug)]
pub struct FolderPrior {
    folder: PathBuf,
    kind: FolderKind,
    /// Whole number at one metre, or at 1/m.
    png_scale: f32,
}

impl FolderPrior {
    /// The maps in a folder, to be read as a configuration says.
    pub fn new(folder: PathBuf, config: &DepthConfig) -> Self {
        Self { folder, kind: config.folder_kind, png_scale: config.png_scale as f32 }
    }

    /// The file of a keyframe's map.
    ///
    /// # Errors
    /// There is none, or more than one.
    pub fn file(&self, index: usize) -> Result<PathBuf> {
        let stem = dataset::stem(index);
        let named = |extension: &str| self.folder.join(format!("{stem}.{extension}"));
        let there: Vec<PathBuf> = EXTENSIONS.iter().map(|e| named(e)).filter(|path| path.is_file()).collect();
        let place = format!("{} (depth.folder), keyframe {index}", self.folder.display());
        match there.as_slice() {
            [file] => Ok(file.clone()),
            [] if !self.folder.is_dir() => Err(Error::invalid(
                place,
                "there is no such folder",
                "give the folder of the maps (tools/depth_prior.py makes one)",
            )),
            [] => Err(Error::invalid(
                place,
                format!("there is no map {stem}.exr, {stem}.npy or {stem}.png"),
                "every training keyframe needs one, named as its image is (tools/depth_prior.py makes them)",
            )),
            [a, b, ..] => Err(Error::invalid(
                place,
                format!("both {} and {} are there", a.display(), b.display()),
                "leave one of them there",
            )),
        }
    }

    /// The inverse depth of keyframe `index`, whose image has `image` pixels (columns, rows): relative or in 1/m, as the maps are, at the map's
    /// resolution or the image's, whichever is lower. Zeros and what is not finite are holes; so are negative depths.
    ///
    /// # Errors
    /// Those of [`Self::file`]; a file that cannot be read; a map of another shape than the image, or without a value.
    pub fn read(&self, index: usize, image: (usize, usize)) -> Result<Dense> {
        let file = self.file(index)?;
        let Map { values: map, stored } = io::read_map(&file, io::MapOf::Depth)?;
        let place = || format!("{}, keyframe {index}", file.display());
        let (width, height) = (map.width(), map.height());
        let ratio = (width * image.1) as f64 / (height * image.0) as f64;
        if !((1.0 - ASPECT_TOLERANCE)..=(1.0 + ASPECT_TOLERANCE)).contains(&ratio) {
            return Err(Error::invalid(
                place(),
                format!("the map is {width}x{height} and the image {}x{}: not of one shape", image.0, image.1),
                "give a map of the whole image, at any resolution",
            ));
        }
        let is_metric = matches!(self.kind, FolderKind::DepthMetric | FolderKind::InverseMetric);
        let unit = if matches!(stored, Stored::Picture | Stored::Whole) && is_metric { self.png_scale } else { 1.0 };
        let inverse = map.map(|v| {
            let inverse = match self.kind {
                FolderKind::InverseRelative if *v == 0.0 => f32::NAN,
                FolderKind::InverseRelative => *v,
                _ if *v <= 0.0 => f32::NAN,
                FolderKind::DepthRelative => 1.0 / v,
                FolderKind::DepthMetric => unit / v,
                FolderKind::InverseMetric => v / unit,
            };
            // An infinite depth is unknown too, not an inverse depth of 0.
            if inverse == 0.0 { f32::NAN } else { inverse }
        });
        if !inverse.pixels().iter().any(|v| v.is_finite()) {
            return Err(Error::invalid(place(), "no pixel has a value: all are zero or no number", "make this map again"));
        }
        if is_metric {
            let help = "maps of a metric kind hold metres (or 1/m) as floats, or whole numbers of which depth.png_scale are a metre; other maps are relative \
                        (depth.folder_kind)";
            bounds::room_depth(&place(), inverse.pixels().iter().map(|v| 1.0 / v), help)?;
        }
        let dense = Dense::reduced(inverse, image);
        if !dense.grid().pixels()[0].is_finite() {
            return Err(Error::invalid(place(), "the map is nearly all holes", "make this map again"));
        }
        Ok(if is_metric { dense.in_metres() } else { dense })
    }

    /// Refuses a keyframe that has no map; what is in the map is not looked at.
    ///
    /// # Errors
    /// Those of [`Self::file`].
    pub fn check(&self, index: usize) -> Result<()> {
        self.file(index).map(|_| ())
    }

    /// Reads the maps of all these keyframes, and throws them away: whatever is wrong with one is known then.
    ///
    /// # Errors
    /// Those of [`Self::read`], of the first one in which something is wrong.
    pub fn check_all(&self, indices: &[usize], image: (usize, usize)) -> Result<()> {
        let found: Vec<Result<()>> = indices.par_iter().map(|&index| self.read(index, image).map(|_| ())).collect();
        found.into_iter().collect()
    }
}

#[cfg(test)]
#[path = "folder_tests.rs"]
mod tests;
