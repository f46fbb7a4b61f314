//! COLMAP models (<https://colmap.github.io/format.html>): cameras, images with camera_from_world poses, and points, as text or binary.
//!
//! Models of COLMAP 3.12 and later have rigs and frames, from which the poses of images follow (`rigs.rs`).

mod binary;
mod rigs;
mod text;

use super::lens::Lens;
use super::rounding::Rounding;
use super::{Capture, Shot, names};
use crate::contained::{self, Reach};
use crate::dataset::ColoredPoint;
use crate::{Error, Pinhole, Result, Rigid3, bounds};
use glam::DVec3;
use rigs::Rigs;
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
    id: u32,
    camera_from_world: Pose,
    camera: u32,
    name: String,
}

/// A rigid transform as it is written.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Pose {
    /// w, x, y, z.
    quaternion: [f64; 4],
    translation: [f64; 3],
}

/// Camera models by their numbers in binary files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Model {
    name: &'static str,
    parameters: usize,
}

/// All that COLMAP has, at the index that is their number.
const MODELS: [Model; 18] = [
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
    Model { name: "SIMPLE_DIVISION", parameters: 4 },
    Model { name: "DIVISION", parameters: 5 },
    Model { name: "SIMPLE_FISHEYE", parameters: 3 },
    Model { name: "FISHEYE", parameters: 4 },
    Model { name: "EUCM", parameters: 6 },
    Model { name: "EQUIRECTANGULAR", parameters: 2 },
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
        bounds::in_pixels(place, &lens.pinhole)?;
        Ok(lens)
    }
}

impl Pose {
    /// Its rotation and translation, and how far its quaternion is off length 1; COLMAP itself takes any length.
    ///
    /// # Errors
    /// A quaternion that is none, or a number that is not finite.
    fn rigid(&self, place: &str) -> Result<(Rigid3, f64)> {
        Rigid3::from_quaternion(self.quaternion, DVec3::from(self.translation), place)
    }
}

/// Endings of a model's files. COLMAP itself prefers binary ones.
const ENDINGS: [&str; 2] = ["bin", "txt"];

/// The ending of the model's files in a folder, if there is a model.
fn ending(folder: &Path) -> Option<&'static str> {
    let has = |name: &str, ending: &str| folder.join(format!("{name}.{ending}")).is_file();
    ENDINGS.into_iter().find(|ending| has("cameras", ending) && has("images", ending))
}

/// The folder of the model: `sparse/0`, `sparse`, or the capture's own.
fn model_folder(source: &Path) -> Result<(PathBuf, &'static str)> {
    let folders = [source.join("sparse/0"), source.join("sparse"), source.to_path_buf()];
    folders.into_iter().find_map(|folder| ending(&folder).map(|ending| (folder, ending))).ok_or_else(|| {
        Error::invalid(
            source.display().to_string(),
            "there are no cameras and images (.bin or .txt) in sparse/0, in sparse, or beside them",
            "give the folder that holds images/ and sparse/0/ of a COLMAP reconstruction",
        )
    })
}

/// A note of the models in `sparse/`, and beside it, that are not read.
fn further_models(source: &Path, read: &Path) -> Option<String> {
    let sparse = source.join("sparse");
    let below = std::fs::read_dir(&sparse).into_iter().flatten().filter_map(|entry| Some(entry.ok()?.path()));
    let is_further = |folder: &PathBuf| folder != read && folder.is_dir() && ending(folder).is_some();
    let mut others: Vec<String> = std::iter::once(sparse.clone())
        .chain(below)
        .filter(is_further)
        .filter_map(|folder| Some(folder.strip_prefix(source).ok()?.display().to_string()))
        .collect();
    others.sort_by(|a, b| names::natural(a, b));
    let Some(first) = others.first() else {
        let beside =
            "the model beside sparse/ was not read: move it into a folder of its own, and give that to `corf dataset import`";
        return is_further(&source.to_path_buf()).then(|| beside.to_owned());
    };
    let were = if others.len() == 1 { "holds a further model, which was" } else { "hold further models, which were" };
    Some(format!(
        "{} {were} not read: a model is a data set of its own (`corf dataset import CAPTURE/{first} --images CAPTURE/images`)",
        others.join(", ")
    ))
}

/// Reads a model and finds its images in `images`; `wanted` says whether they are needed.
///
/// # Errors
/// A file that is missing, cut short or not of the format; a camera model that is not read; a pose that is none; an image that leads out
/// of its folder; rigs and frames that do not fit the images.
pub(super) fn read(source: &Path, images: &Path, wanted: bool) -> Result<Capture> {
    let (folder, ending) = model_folder(source)?;
    let file = |name: &str| folder.join(format!("{name}.{ending}"));
    let mut notes = Vec::new();
    let sparse = if ending == "bin" { binary::read(&folder)? } else { text::read(&folder, &mut notes)? };
    let place = file("images").display().to_string();
    if sparse.images.is_empty() {
        return Err(Error::invalid(place, "it has no image", "give a reconstruction with registered images"));
    }
    let rig_files = rigs::files(&folder, ending)?;
    let rigs = match &rig_files {
        None => None,
        Some(files) => {
            let [rigs, frames] = files;
            let (rigs, frames) = match ending {
                "bin" => (binary::rigs(rigs)?, binary::frames(frames)?),
                _ => (text::rigs(rigs, &mut notes)?, text::frames(frames, &mut notes)?),
            };
            Rigs::new(files, rigs, frames)
        }
    };
    let poses: Vec<Option<(Rigid3, f64)>> = match &rigs {
        Some(rigs) => rigs.camera_from_world(&sparse.images, &place, &mut notes)?,
        None => {
            let pose = |image: &Image| image.camera_from_world.rigid(&format!("{place}: image {}", image.name)).map(Some);
            sparse.images.iter().map(pose).collect::<Result<_>>()?
        }
    };
    let posed = || sparse.images.iter().zip(&poses).filter_map(|(image, pose)| Some((image, pose.as_ref()?)));
    if posed().next().is_none() {
        return Err(Error::invalid(place, "none of its images has a pose", "give a reconstruction with registered images"));
    }
    let mut lenses = BTreeMap::new();
    for (image, _) in posed() {
        let camera = sparse.cameras.get(&image.camera).ok_or_else(|| {
            let what =
                format!("image {} names camera {}, which {} does not have", image.name, image.camera, file("cameras").display());
            Error::invalid(&place, what, "the files do not belong together: export the model again")
        })?;
        lenses.insert(image.camera, camera.lens(&format!("{}: camera {}", file("cameras").display(), image.camera))?);
    }
    let mut rounding = Rounding::default();
    let mut shots = Vec::with_capacity(sparse.images.len());
    for (image, (camera_from_world, off)) in posed() {
        let place = format!("{place}: image {}", image.name);
        let name = image.name.replace('\\', "/");
        shots.push(Shot {
            image: if wanted { Some(picture(images, &image.name, &name, &place)?) } else { None },
            name,
            lens: lenses[&image.camera],
            world_from_camera: rounding.take((camera_from_world.inverse(), *off), &image.name),
            depth: None,
            mask: None,
            time_s: None,
        });
    }
    shots.sort_by(|a, b| names::natural(&a.name, &b.name));
    notes.extend(rounding.note());
    notes.extend(further_models(source, &folder));
    let mut files: Vec<PathBuf> = ["cameras", "images", "points3D"].map(file).into_iter().filter(|f| f.is_file()).collect();
    files.extend(rig_files.into_iter().flatten());
    Ok(Capture { shots, points: sparse.points, lists: None, spectra: None, sensor: None, files, notes })
}

/// The picture of an image in the folder of the images: as the model names it, or without its first folders, as few as can be, where that is a file.
/// `stated` is its name in the model, `name` the same with this system's folders.
fn picture(images: &Path, stated: &str, name: &str, place: &str) -> Result<PathBuf> {
    let resolve = |name: &str| contained::resolve(images, Path::new(name), Reach::Folder, place, HELP);
    let path = resolve(stated)?;
    match names::tails(name).find(|tail| images.join(tail).is_file()) {
        Some(tail) if !path.is_file() => resolve(tail),
        _ => Ok(path),
    }
}

/// The points of a `points3D.txt`, in its order.
///
/// # Errors
/// A file that is missing or not of the format.
pub fn read_points(path: &Path) -> Result<Vec<ColoredPoint>> {
    text::points(path, &mut Vec::new())
}

const HELP: &str = "the images of a capture lie in one folder: give it with --images";

#[cfg(test)]
mod tests;
