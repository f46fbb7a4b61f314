//! COLMAP models (<https://colmap.github.io/format.html>): cameras, images with camera_from_world poses, and points, as text or binary.

mod binary;
mod text;

use super::lens::Lens;
use super::rounding::Rounding;
use super::{Capture, Shot, names};
use crate::contained::{self, Reach};
use crate::dataset::ColoredPoint;
use crate::{Error, Pinhole, Result, Rigid3};
use glam::DVec3;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A camera of a model: its size, and its parameters under a model's name.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Camera {
    model: Model,
    width: u64,
    height: u64,
    parameters: Vec<f64>,
}

/// An image of a model.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Image {
    /// w, x, y, z of camera_from_world.
    quaternion: [f64; 4],
    translation: [f64; 3],
    camera: u32,
    name: String,
}

/// Camera models by their numbers in binary files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Model {
    name: &'static str,
    parameters: usize,
}

/// All that COLMAP has, at the index that is their number.
const MODELS: [Model; 12] = [
    Model { name: "SIMPLE_PINHOLE", parameters: 3 },
    Model { name: "PINHOLE", parameters: 4 },
    Model { name: "SIMPLE_RADIAL", parameters: 4 },
    Model { name: "RADIAL", parameters: 5 },
    Model { name: "OPENCV", parameters: 8 },
    Model { name: "OPENCV_FISHEYE", parameters: 8 },
    Model { name: "FULL_OPENCV", parameters: 12 },
    Model { name: "FOV", parameters: 5 },
    Model { name: "SIMPLE_RADIAL_FISHEYE", parameters: 4 },
    Model { name: "RADIAL_FISHEYE", parameters: 5 },
    Model { name: "THIN_PRISM_FISHEYE", parameters: 12 },
    Model { name: "RAD_TAN_THIN_PRISM_FISHEYE", parameters: 16 },
];

/// Models whose views are taken.
const READ: &str = "SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL, OPENCV, and FULL_OPENCV without k4 to k6";

/// A model of a folder, by id.
#[derive(Clone, Debug, Default, PartialEq)]
struct Sparse {
    cameras: BTreeMap<u32, Camera>,
    images: Vec<Image>,
    points: Vec<ColoredPoint>,
}

impl Camera {
    /// As a pinhole with distortion.
    fn lens(&self, place: &str) -> Result<Lens> {
        let p = &self.parameters;
        let size = |v: u64| usize::try_from(v).unwrap_or(usize::MAX);
        let pinhole = |fx, fy, cx, cy| Pinhole { width: size(self.width), height: size(self.height), fx, fy, cx, cy };
        let plain = Lens::plain;
        let lens = match (self.model.name, p.as_slice()) {
            ("SIMPLE_PINHOLE", &[f, cx, cy]) => plain(pinhole(f, f, cx, cy)),
            ("PINHOLE", &[fx, fy, cx, cy]) => plain(pinhole(fx, fy, cx, cy)),
            ("SIMPLE_RADIAL", &[f, cx, cy, k]) => Lens { radial: [k, 0.0, 0.0], ..plain(pinhole(f, f, cx, cy)) },
            ("RADIAL", &[f, cx, cy, k1, k2]) => Lens { radial: [k1, k2, 0.0], ..plain(pinhole(f, f, cx, cy)) },
            ("OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2]) => {
                Lens { pinhole: pinhole(fx, fy, cx, cy), radial: [k1, k2, 0.0], tangential: [p1, p2] }
            }
            ("FULL_OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2, k3, k4, k5, k6]) if [k4, k5, k6] == [0.0; 3] => {
                Lens { pinhole: pinhole(fx, fy, cx, cy), radial: [k1, k2, k3], tangential: [p1, p2] }
            }
            (name, _) => {
                let help = format!("these are read: {READ}; undistort the images first (`colmap image_undistorter`)");
                return Err(Error::invalid(place, format!("camera model {name} is not read"), help));
            }
        };
        lens.check(place)?;
        Ok(lens)
    }
}

/// The pose of an image, world_from_camera, and how far its quaternion is off length 1; COLMAP itself takes any length.
fn pose(image: &Image, place: &str) -> Result<(Rigid3, f64)> {
    let (camera_from_world, off) = Rigid3::from_quaternion(image.quaternion, DVec3::from(image.translation), place)?;
    Ok((camera_from_world.inverse(), off))
}

/// The folder of the model: `sparse/0`, `sparse`, or the capture's own.
fn model_folder(source: &Path) -> Result<(PathBuf, &'static str)> {
    for folder in [source.join("sparse/0"), source.join("sparse"), source.to_path_buf()] {
        // COLMAP itself prefers binary files.
        for ending in ["bin", "txt"] {
            let has = |name: &str| folder.join(format!("{name}.{ending}")).is_file();
            if has("cameras") && has("images") {
                return Ok((folder, ending));
            }
        }
    }
    Err(Error::invalid(
        source.display().to_string(),
        "there are no cameras and images (.bin or .txt) in sparse/0, in sparse, or beside them",
        "give the folder that holds images/ and sparse/0/ of a COLMAP reconstruction",
    ))
}

/// Reads a model and finds its images in `images`; `wanted` says whether they are needed.
///
/// # Errors
/// A file that is missing, cut short or not of the format; a camera model that is not read; a pose that is none; an image that leads out
/// of its folder.
pub(super) fn read(source: &Path, images: &Path, wanted: bool) -> Result<Capture> {
    let (folder, ending) = model_folder(source)?;
    let file = |name: &str| folder.join(format!("{name}.{ending}"));
    let sparse = if ending == "bin" { binary::read(&folder)? } else { text::read(&folder)? };
    let place = file("images").display().to_string();
    if sparse.images.is_empty() {
        return Err(Error::invalid(place, "it has no image", "give a reconstruction with registered images"));
    }
    let mut lenses = BTreeMap::new();
    for image in &sparse.images {
        let camera = sparse.cameras.get(&image.camera).ok_or_else(|| {
            let what =
                format!("image {} names camera {}, which {} does not have", image.name, image.camera, file("cameras").display());
            Error::invalid(&place, what, "the files do not belong together: export the model again")
        })?;
        lenses.insert(image.camera, camera.lens(&format!("{}: camera {}", file("cameras").display(), image.camera))?);
    }
    let mut rounding = Rounding::default();
    let mut shots = Vec::with_capacity(sparse.images.len());
    for image in &sparse.images {
        let place = format!("{place}: image {}", image.name);
        let path = contained::resolve(images, Path::new(&image.name), Reach::Folder, &place, HELP);
        shots.push(Shot {
            name: image.name.replace('\\', "/"),
            image: if wanted { Some(path?) } else { None },
            lens: lenses[&image.camera],
            world_from_camera: rounding.take(pose(image, &place)?, &image.name),
            depth: None,
            mask: None,
            time_s: None,
        });
    }
    shots.sort_by(|a, b| names::natural(&a.name, &b.name));
    let files = ["cameras", "images", "points3D"].map(file).into_iter().filter(|f| f.is_file()).collect();
    let notes = rounding.note().into_iter().collect();
    Ok(Capture { shots, points: sparse.points, lists: None, spectra: None, files, notes })
}

/// The points of a `points3D.txt`, in its order.
///
/// # Errors
/// A file that is missing or not of the format.
pub fn read_points(path: &Path) -> Result<Vec<ColoredPoint>> {
    text::points(path)
}

const HELP: &str = "the images of a capture lie in one folder: give it with --images";

#[cfg(test)]
mod tests;
