//! Options of an import.

use super::sensor::SensorOptions;
use super::spectra::{RadioValues, Reading};
use crate::keyframe::DbRange;
use crate::{Error, Pinhole, Result, bounds, io};
use std::path::PathBuf;

/// Layout of a capture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    /// A COLMAP model, text or binary, and a folder of images.
    Colmap,
    /// `transforms.json` of nerfstudio, Instant-NGP and their like.
    Nerfstudio,
    /// A COLMAP model, a folder of spectra, and two lists of stems.
    Rf3dgs,
    /// A NeRF² set, which is refused.
    Nerf2,
    /// `trajectory.json`, `camera.json` and a folder of images.
    CorfFolder,
}

impl Format {
    /// Its name on the command line and in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Colmap => "colmap",
            Self::Nerfstudio => "nerfstudio",
            Self::Rf3dgs => "rf-3dgs",
            Self::Nerf2 => "nerf2",
            Self::CorfFolder => "corf-folder",
        }
    }
}

/// Direction of the capture's frame that is up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Up {
    /// A direction in the capture's frame.
    Direction([f64; 3]),
    /// The mean upward axis of all cameras.
    Cameras,
}

/// What is taken off all positions of a capture, so that the data set lies near its origin, where single precision is fine.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Offset {
    /// This point of the world, z up and in metres as `up` and `metres_per_unit` make it, becomes the origin.
    Point([f64; 3]),
    /// The middle of the cameras does, in whole steps of [`Offset::STEP_M`].
    Cameras,
}

impl Offset {
    /// Steps of [`Offset::Cameras`], metres: round numbers, towards the origin, which leave a capture where it is that has its middle within one of
    /// them.
    pub const STEP_M: f64 = 100.0;
}

/// Camera of the spectra, which shares position and axes with that of the images.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum RadioCamera {
    /// Full horizontal field of view, degrees; square pixels, the axis in the middle of the image.
    HorizontalFovDeg(f64),
    /// fx, fy, cx, cy, pixels.
    Intrinsics([f64; 4]),
}

impl RadioCamera {
    /// The camera of spectra of a size.
    ///
    /// # Errors
    /// A field of view that no pinhole has.
    pub(super) fn of(self, width: usize, height: usize) -> Result<Pinhole> {
        match self {
            Self::HorizontalFovDeg(fov) => {
                bounds::number("--rf-camera", fov, &bounds::FIELD_OF_VIEW_DEG, "degrees of horizontal field of view")?;
                Ok(Pinhole::from_horizontal_fov(width, height, fov))
            }
            Self::Intrinsics([fx, fy, cx, cy]) => Ok(Pinhole { width, height, fx, fy, cx, cy }),
        }
    }
}

/// Rule by which keyframes are held out.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SplitRule {
    /// Those whose index can be divided by this.
    Every(usize),
    /// Those that a file lists, by stem or by index from 0, one a line.
    Listed(PathBuf),
}

/// What to import, and how to read what its files leave open.
#[derive(Clone, Debug, PartialEq)]
pub struct CaptureOptions {
    /// Layout of the capture.
    pub format: Format,
    /// The capture's folder.
    pub source: PathBuf,
    /// Name of the data set; that of the folder if there is none.
    pub name: Option<String>,
    /// Folder of the images, where it is not the layout's own: it holds them as the capture names them, or without the first folders of their names.
    pub images: Option<PathBuf>,
    /// Leaves the images out.
    pub without_images: bool,
    /// Folder of spectra, one for every image by its stem.
    pub radio: Option<PathBuf>,
    /// Camera of the spectra.
    pub radio_camera: Option<RadioCamera>,
    /// Levels of black and white (of blue and red, in Jet), or the range that the data set is to have.
    pub radio_db: Option<DbRange>,
    /// Unit of the values of spectra that are no pictures; linear power if nobody says.
    pub radio_values: Option<RadioValues>,
    /// The sensor of the spectra, their quantity and carrier.
    pub sensor: SensorOptions,
    /// Width of the range below the strongest value where `rf_db` states none, dB; [`Self::DYNAMIC_RANGE_DB`] if nobody says.
    pub dynamic_range_db: Option<f64>,
    /// Folder of depth maps, one for every image by its stem.
    pub depth: Option<PathBuf>,
    /// Folder of masks, for as many images as have one by their stems: black where a pixel does not count. Without it, those that the capture names.
    pub masks: Option<PathBuf>,
    /// Metres that a unit of a depth map counts. Without it floats are metres, steps of a 16-bit PNG millimetres, and other whole numbers refused.
    pub depth_unit_m: Option<f64>,
    /// What is up.
    pub up: Option<Up>,
    /// Metres that a unit of length of the capture counts.
    pub metres_per_unit: f64,
    /// What is taken off all positions; `None` where they are kept, unless they lie beyond [`crate::bounds::MAX_COORDINATE_M`].
    pub offset: Option<Offset>,
    /// Which keyframes are held out, where the capture does not say or is not followed.
    pub split: Option<SplitRule>,
    /// Lets all pixels count, also those that masks leave out or that are transparent.
    pub ignore_masks: bool,
}

impl CaptureOptions {
    /// Width of the range of spectra where nothing says another, dB.
    pub const DYNAMIC_RANGE_DB: f64 = 70.0;

    /// Options of a capture that leaves nothing open.
    pub fn new(format: Format, source: impl Into<PathBuf>) -> Self {
        Self {
            format,
            source: source.into(),
            name: None,
            images: None,
            without_images: false,
            radio: None,
            radio_camera: None,
            radio_db: None,
            radio_values: None,
            sensor: SensorOptions::default(),
            dynamic_range_db: None,
            depth: None,
            masks: None,
            depth_unit_m: None,
            up: None,
            metres_per_unit: 1.0,
            offset: None,
            split: None,
            ignore_masks: false,
        }
    }

    /// Checks the numbers that hold for whatever is imported; those of cameras need the size of their images.
    ///
    /// # Errors
    /// A number out of range, by its flag.
    pub(super) fn check(&self) -> Result<()> {
        if let Some(width) = self.dynamic_range_db {
            bounds::number("--dynamic-range-db", width, &bounds::DYNAMIC_RANGE_DB, "dB")?;
            if self.radio_db.is_some() {
                let what = "the range is stated already, by --rf-db";
                return Err(Error::invalid("--dynamic-range-db", what, "leave one of the two out"));
            }
        }
        bounds::number("--scale", self.metres_per_unit, &(1e-6..=1e6), "metres a unit of the capture")?;
        if let Some(range) = &self.radio_db {
            bounds::db_range("--rf-db", range)?;
        }
        if let Some(unit) = self.depth_unit_m {
            bounds::number("--depth-unit", unit, &io::DEPTH_UNIT_M, "metres a unit")?;
        }
        Ok(())
    }

    /// How its spectra are read.
    pub(super) fn reading(&self) -> Reading<'_> {
        Reading {
            values: self.radio_values.unwrap_or(RadioValues::Linear),
            range: self.radio_db.as_ref(),
            dynamic_range_db: self.dynamic_range_db.unwrap_or(Self::DYNAMIC_RANGE_DB),
        }
    }

    /// The flag of an option that is of spectra alone, where one is given.
    pub(super) fn given_of_radio(&self) -> Option<&'static str> {
        [
            (self.radio_db.is_some(), "--rf-db"),
            (self.radio_camera.is_some(), "--rf-camera"),
            (self.radio_values.is_some(), "--rf-values"),
            (self.dynamic_range_db.is_some(), "--dynamic-range-db"),
        ]
        .into_iter()
        .find_map(|(given, flag)| given.then_some(flag))
        .or_else(|| self.sensor.given())
    }
}
