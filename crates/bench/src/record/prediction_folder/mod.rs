//! Folders of predicted images and spectra, which any program can write and `corf` scores.
//!
//! ```text
//! DIR/predictions.json        what its maker says of them ([`PredictionStatement`]); may be left out
//! DIR/images/00017.png        the image: sRGB, 8 or 16 bit
//! DIR/linear/00017.exr|.npy   the spectrum in linear power, in the data set's quantity, for 1 W transmitted
//! DIR/scalar/00017.png        or as grey on the data set's decibel range, 8 or 16 bit
//! DIR/jet/00017.png           or in Jet colours on that range
//! DIR/views.json              where `corf render` drew them from, which has to be where the keyframes are; may be left out
//! ```
//!
//! Either `images/`, or a kind of spectrum, or both; a file a held-out keyframe, named by its stem in the data set or by its index. `jet/` may
//! stand beside `linear/` or `scalar/`: then the metrics of the Jet image are those of `jet/`, as for a method that paints Jet. Folders of
//! `corf render` have this layout. Other files are not looked at.

mod files;
mod statement;
mod views;
mod writer;

use corf_scene::words::{counted, verb};
pub use statement::{Names, PredictionStatement};
pub use views::write_views;
pub use writer::{PredictionWriter, stated_of};

use crate::files::json::read_json;
use crate::metrics::{Halves, PredictedSpectrum};
use crate::split::Split;
use anyhow::{Result, bail, ensure};
use corf_scene::dataset::Dataset;
use corf_scene::keyframe::DbRange;
use corf_scene::{Pinhole, Raster, color, io};
use files::Files;
use std::path::{Path, PathBuf};

/// Name of the statement's file.
pub const STATEMENT: &str = "predictions.json";

/// What of a spectrum is read for the physical metrics.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Linear,
    Scalar,
    Jet,
}

impl Kind {
    fn folder(self) -> &'static str {
        match self {
            Self::Linear => "linear",
            Self::Scalar => "scalar",
            Self::Jet => "jet",
        }
    }
}

/// A folder of predictions of all held-out keyframes of a split.
#[derive(Clone, Debug)]
pub struct PredictionFolder {
    dir: PathBuf,
    statement: Box<PredictionStatement>,
    images: Option<Files>,
    spectra: Option<(Kind, Files)>,
    jet: Option<Files>,
    sha256: String,
}

/// What is predicted of one keyframe.
#[derive(Clone, Debug)]
pub struct Predicted {
    image: Option<Raster<[f32; 3]>>,
    /// Jet colours, and the scalar on the data set's range.
    spectrum: Option<(Raster<[f32; 3]>, Raster<f32>)>,
}

impl Predicted {
    /// As metrics are computed of it.
    pub fn halves(&self) -> Halves<'_> {
        let spectrum = self.spectrum.as_ref().map(|(jet, scalar)| PredictedSpectrum { jet, scalar });
        Halves { image: self.image.as_ref(), spectrum }
    }
}

/// Counts of what a reader of the metrics has to be told about.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Tally {
    /// Pixels of linear power above the upper end of the data set's range.
    pub clipped_pixels: usize,
    /// Spectra on the floor all over.
    pub empty_spectra: usize,
}

impl PredictionFolder {
    /// Opens a folder, checks what it states, that every held-out keyframe is there, and takes the hash of what will be read.
    ///
    /// # Errors
    /// No folder, nothing to score in it, a statement that does not fit, a keyframe that is missing or named twice; what to do is said.
    pub fn open(dir: &Path, dataset: &Dataset, split: &Split) -> Result<Self> {
        ensure!(
            dir.is_dir(),
            "{} is no folder\n  help: give a folder of predictions: images/, and linear/, scalar/ or jet/, with a file for every held-out keyframe",
            dir.display()
        );
        let (place, statement) = (dir.join(STATEMENT), Self::stated(dir)?);
        statement.check(dataset, split.protocol, &place)?;
        let names = statement.names.unwrap_or_default();
        views::check_views(dir, dataset, split, names)?;
        let files = |name: &str, endings: &[&str]| Files::list(dir, name, endings, names, dataset.len(), split);
        let images = files("images", &["png"])?;
        let (linear, scalar) = (files("linear", &["exr", "npy"])?, files("scalar", &["png"])?);
        ensure!(
            linear.is_none() || dataset.fixed_array().is_none(),
            "{}/linear: {} holds grey levels, and no powers that could be predicted\n  help: give the levels in scalar/, as 8-bit grey",
            dir.display(),
            dataset.dir().display()
        );
        let jet = files("jet", &["png"])?;
        let spectra = match (linear, scalar) {
            (Some(_), Some(_)) => {
                bail!(
                    "{} has spectra in linear/ and in scalar/\n  help: they may differ; keep the ones to be scored",
                    dir.display()
                )
            }
            (Some(linear), None) => Some((Kind::Linear, linear)),
            (None, Some(scalar)) => Some((Kind::Scalar, scalar)),
            (None, None) => jet.clone().map(|jet| (Kind::Jet, jet)),
        };
        ensure!(
            images.is_some() || spectra.is_some(),
            "{} holds no predictions\n  help: put images into images/, and spectra into linear/ (EXR or npy), scalar/ or jet/ (PNG)",
            dir.display()
        );
        let read: Vec<&Files> = [&images, &jet].into_iter().flatten().chain(spectra.iter().map(|(_, files)| files)).collect();
        let sha256 = files::hash(dir, &place, &read)?;
        Ok(Self { dir: dir.to_path_buf(), statement: Box::new(statement), images, spectra, jet, sha256 })
    }

    /// What the maker of a folder says; nothing where there is no `predictions.json`.
    ///
    /// # Errors
    /// A file that is not what it should be.
    pub fn stated(dir: &Path) -> Result<PredictionStatement> {
        let place = dir.join(STATEMENT);
        if place.exists() { read_json(&place) } else { Ok(PredictionStatement::default()) }
    }

    /// What its maker says.
    pub fn statement(&self) -> &PredictionStatement {
        &self.statement
    }

    /// Name of the method as it is stated, or of the folder.
    pub fn name(&self) -> String {
        let of_folder =
            || self.dir.file_name().map_or_else(|| self.dir.display().to_string(), |n| n.to_string_lossy().into_owned());
        self.statement.method.clone().unwrap_or_else(of_folder)
    }

    /// What a record keeps of it: the statement, what was read, and the SHA-256 of that.
    pub fn config(&self) -> serde_json::Value {
        serde_json::json!({
            "content_sha256": self.sha256,
            "images": self.images.is_some(),
            "spectra": self.spectra.as_ref().map_or("none", |(kind, _)| kind.folder()),
            "jet": self.jet.is_some(),
            "stated": self.statement,
        })
    }

    /// Reads what is predicted of a held-out keyframe, and counts what has to be said of it.
    ///
    /// # Errors
    /// A file that cannot be read, is of the wrong size, or holds no image or spectrum of its kind.
    pub fn read(&self, index: usize, dataset: &Dataset, tally: &mut Tally) -> Result<Predicted> {
        let image = match &self.images {
            None => None,
            Some(files) => Some(read_colours(files.path(index)?, &dataset.light_camera())?),
        };
        let spectrum = match (&self.spectra, dataset.db_range()) {
            (None, _) | (_, None) => None,
            (Some((kind, files)), Some(range)) => {
                let camera = dataset.radio_camera();
                let jet = self.jet.as_ref().map(|files| read_jet(files.path(index)?, &camera)).transpose()?;
                let path = files.path(index)?;
                let scalar = match (kind, &jet) {
                    (Kind::Linear, _) => read_linear(path, &camera, &range, tally)?,
                    (Kind::Jet, Some(jet)) => jet.map(|&rgb| color::scalar_from_jet(rgb)),
                    (Kind::Scalar | Kind::Jet, _) => read_scalar(path, &camera)?,
                };
                tally.empty_spectra += usize::from(scalar.pixels().iter().all(|&s| s <= 0.0));
                Some((jet.unwrap_or_else(|| scalar.map(|&s| color::jet(s))), scalar))
            }
        };
        Ok(Predicted { image, spectrum })
    }

    /// What has to be said of the metrics of a folder that was read; `range` is that of the data set's spectra.
    pub fn warnings(&self, tally: &Tally, range: Option<&DbRange>) -> Vec<String> {
        let mut out = Vec::new();
        let place = self.dir.display();
        let Some(range) = range else {
            if self.spectra.is_some() {
                out.push(format!("{place}: its spectra are left out, for the data set has none to compare them with"));
            }
            return out;
        };
        if self.spectra.as_ref().is_some_and(|(kind, _)| *kind == Kind::Jet) {
            let step_db = (range.max_db - range.min_db) / 255.0;
            out.push(format!(
                "{place}: spectra are read back from Jet colours, which loses precision: half an 8-bit step is {:.2} dB, and from {:.1} to {:.1} dB \
                 above the floor all colours are one; give linear/ or scalar/ for metrics of power, peaks and beams",
                0.5 * step_db,
                0.11 * 255.0 * step_db,
                0.125 * 255.0 * step_db
            ));
        }
        if tally.clipped_pixels > 0 {
            out.push(format!(
                "{place}: {} of linear/ {} above {} dB, the upper end of the data set's range, and {} as that much",
                counted(tally.clipped_pixels, "pixel"),
                verb(tally.clipped_pixels, "is", "are"),
                range.max_db,
                verb(tally.clipped_pixels, "counts", "count")
            ));
        }
        if tally.empty_spectra > 0 {
            let empty = tally.empty_spectra;
            let (spectra, hold) = (counted(empty, "spectrum"), verb(empty, "holds", "hold"));
            out.push(format!("{place}: {spectra} {hold} no power above the floor of {} dB", range.min_db));
        }
        out
    }
}

/// Checks that a file has the camera's pixels.
fn check_size<T>(raster: Raster<T>, path: &Path, camera: &Pinhole) -> Result<Raster<T>> {
    let (w, h) = (raster.width(), raster.height());
    ensure!(
        (w, h) == (camera.width, camera.height),
        "{}: is {w}x{h} pixels where the data set has {}x{}\n  help: predict at the data set's resolution; resampled predictions are other predictions",
        path.display(),
        camera.width,
        camera.height
    );
    Ok(raster)
}

/// A PNG of 8 or 16 bit as `[0, 1]`.
fn read_colours(path: &Path, camera: &Pinhole) -> Result<Raster<[f32; 3]>> {
    let image = check_size(io::read_png16(path)?, path, camera)?;
    Ok(image.map(|p| p.map(|v| f32::from(v) / 65535.0)))
}

/// A pixel speaks for a Jet where it is this far from the other one's colours at least (full scale is 1; eight bits are off by 0.004), and half as far from
/// its own at most: what a field draws lies off both, and blues are on both.
const TELLING: f32 = 4.0 / 255.0;
/// A picture is in the other Jet where so many pixels say so at least, and this many times as many as say that it is in matplotlib's.
const OTHER_JET: (usize, usize) = (8, 4);

/// Whether the colours of a picture are those of OpenCV's and MATLAB's Jet rather than matplotlib's.
fn is_other_jet(picture: &Raster<[f32; 3]>) -> bool {
    let (mut for_theirs, mut for_ours) = (0, 0);
    for rgb in picture.pixels() {
        let distance = |on: [f32; 3]| on.iter().zip(rgb).map(|(a, b)| (a - b).powi(2)).sum::<f32>().sqrt();
        let ours = distance(color::jet(color::scalar_from_jet(*rgb)));
        let theirs = distance(color::jet_of_trapezoids(color::scalar_from_jet_of_trapezoids(*rgb)));
        for_theirs += usize::from(ours > TELLING && theirs < 0.5 * ours);
        for_ours += usize::from(theirs > TELLING && ours < 0.5 * theirs);
    }
    for_theirs >= OTHER_JET.0 && for_theirs > OTHER_JET.1 * for_ours
}

fn read_jet(path: &Path, camera: &Pinhole) -> Result<Raster<[f32; 3]>> {
    let image = read_colours(path, camera)?;
    ensure!(
        !is_other_jet(&image),
        "{}: it is painted in the Jet of OpenCV and MATLAB, and the data set's pictures are in matplotlib's\n  help: their colours differ by up to 33 of \
         255, and read as the other a level is off by 9: paint it as matplotlib does, or give linear/ or scalar/",
        path.display()
    );
    // No Jet colour is grey.
    ensure!(
        image.pixels().iter().any(|[r, g, b]| r != g || g != b),
        "{}: is grey, and Jet has no grey\n  help: spectra as one number a pixel go into scalar/",
        path.display()
    );
    Ok(image)
}

fn read_scalar(path: &Path, camera: &Pinhole) -> Result<Raster<f32>> {
    let image = read_colours(path, camera)?;
    ensure!(
        image.pixels().iter().all(|[r, g, b]| r == g && g == b),
        "{}: has colours, and a scalar is grey\n  help: spectra in Jet colours go into jet/",
        path.display()
    );
    Ok(image.map(|p| p[0]))
}

/// Linear power as a scalar on the data set's range.
fn read_linear(path: &Path, camera: &Pinhole, range: &DbRange, tally: &mut Tally) -> Result<Raster<f32>> {
    let map = io::read_map(path, io::MapOf::Power)?;
    let place = path.display().to_string();
    if let (Some(floor_db), Some(words)) = (map.stored.floor_db(), map.stored.words_of_power()) {
        ensure!(
            floor_db <= range.min_db,
            "{place}: is stored in {words}; the data set's range begins at {} dB\n  help: write float32",
            range.min_db
        );
    }
    let help = "linear power is finite and at least 0; decibels go into scalar/, as grey on the data set's range";
    let power = check_size(map.into_power(&place, help)?, path, camera)?;
    let most = 10f64.powf(range.max_db / 10.0);
    let (held, above) = power
        .pixels()
        .iter()
        .filter(|v| **v > 0.0)
        .fold((0, 0), |(held, above), v| (held + 1, above + usize::from(f64::from(*v) > most)));
    ensure!(
        held == 0 || above < held,
        "{}: every pixel with power is above {} dB, the strongest of the data set\n  help: values are linear power for 1 W transmitted, as in \
         rf/spectra; a scalar in [0, 1] goes into scalar/",
        path.display(),
        range.max_db
    );
    tally.clipped_pixels += above;
    Ok(power.map(|&v| range.scalar(v)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_other_jet_is_told_by_its_colours() {
        let ramp = |curve: fn(f32) -> [f32; 3]| {
            Raster::from_fn(64, 16, move |x, y| curve((x + 64 * y) as f32 / 1023.0).map(|c| (255.0 * c).round() / 255.0))
        };
        assert!(is_other_jet(&ramp(color::jet_of_trapezoids)) && !is_other_jet(&ramp(color::jet)));
        // What a field draws lies off the curve: half of the way to grey.
        let washed = |picture: Raster<[f32; 3]>| picture.map(|rgb| rgb.map(|c| 0.5 * c + 0.25));
        assert!(!is_other_jet(&washed(ramp(color::jet))));
        // Where both have one colour there is nothing to tell.
        assert!(
            !is_other_jet(&Raster::from_fn(4, 4, |_, _| [0.0, 0.0, 0.5]))
                && !is_other_jet(&Raster::from_fn(4, 4, |_, _| [0.5; 3]))
        );
    }
}
