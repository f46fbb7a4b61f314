//! Captures that others' programs made: camera poses, images, spectra and depth, read from their layouts and written as a data set.
//!
//! | layout | reader | poses | cameras |
//! |---|---|---|---|
//! | `colmap` | `colmap.rs`, text or binary | camera_from_world, OpenCV axes | one or several, with distortion |
//! | `nerfstudio` | `nerfstudio.rs`, `transforms.json` | world_from_camera, OpenGL axes | for all or by frame, with distortion |
//! | `rf-3dgs` | `colmap.rs` and two lists of stems | as COLMAP's | without distortion |
//! | `corf-folder` | `plain.rs`, `trajectory.json` and `camera.json` | world_from_camera, OpenCV axes | one, with distortion |
//!
//! A reader gives a `Capture` in the capture's own frame; [`import()`] turns and scales it, takes the distortion out, matches spectra and depth
//! by file stem, and writes. NeRF² sets are refused: there the transmitter moves and the receiver stands still, which no keyframe can say.

mod colmap;
mod frame;
mod import;
mod jet;
mod json;
mod left_out;
mod lens;
mod names;
mod nerfstudio;
mod options;
mod plain;
mod plan;
mod rf_3dgs;
mod rounding;
mod sensor;
mod spectra;
mod split;

pub use colmap::read_points;
pub use import::{CaptureReport, examine, import};
pub use options::{CaptureOptions, Format, Offset, RadioCamera, SplitRule, Up};
pub use sensor::{ArrayOptions, SensorOptions, Spacing};
pub use spectra::RadioValues;

use crate::Rigid3;
use crate::dataset::ColoredPoint;
use lens::Lens;
use std::path::PathBuf;

/// A capture as its files describe it.
#[derive(Clone, Debug, PartialEq)]
struct Capture {
    /// In the order of [`names::natural`].
    shots: Vec<Shot>,
    /// Points of the scene, in the capture's frame.
    points: Vec<ColoredPoint>,
    /// Names of held-out and of training shots, where the capture lists them.
    lists: Option<Lists>,
    /// Folder with a spectrum for every shot, where the layout has one.
    spectra: Option<PathBuf>,
    /// What it states of the sensor of its spectra.
    sensor: Option<sensor::SensorOptions>,
    /// Files that were read for it.
    files: Vec<PathBuf>,
    /// What a user should know of how it was read.
    notes: Vec<String>,
}

/// Training and held-out shots by name; of one list that is missing are all that no other names.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Lists {
    train: Option<Vec<String>>,
    test: Option<Vec<String>>,
    /// Those that are named for something else.
    others: Vec<String>,
    /// The file that says so.
    place: String,
}

/// One place at which the capture looked.
#[derive(Clone, Debug, PartialEq)]
struct Shot {
    /// Path of its image below the folder of images, or its file name, as the capture writes it.
    name: String,
    /// Its image; none where the capture has no images.
    image: Option<PathBuf>,
    lens: Lens,
    /// In the capture's frame and unit of length.
    world_from_camera: Rigid3,
    depth: Option<PathBuf>,
    mask: Option<PathBuf>,
    time_s: Option<f64>,
}

#[cfg(test)]
mod tests;
