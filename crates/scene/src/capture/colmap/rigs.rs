//! Rigs and frames (COLMAP 3.12 and later): cameras that are mounted together, and where their mount was when they took an image each.
//!
//! The pose of an image is `camera_from_world = sensor_from_rig ∘ rig_from_world`: the sensor's place on the rig from `rigs`, that of the rig from
//! `frames`. A rig's reference sensor is the rig's own frame. Poses in `images` are derived from these and are not used where there are frames.

use super::{Image, Pose};
use crate::words::{counted, verb};
use crate::{Error, Result, Rigid3};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Kinds of sensors.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) enum Kind {
    Camera,
    /// Inertial unit, which takes no images.
    Imu,
}

/// A sensor by its number among those of its kind; of a camera it is that in `cameras`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Sensor {
    pub kind: Kind,
    pub id: u32,
}

/// Sensors that are mounted together.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Rig {
    pub id: u32,
    /// The sensor whose frame is the rig's; none of a rig without sensors.
    pub reference: Option<Sensor>,
    /// The others, with sensor_from_rig where it is known.
    pub others: Vec<(Sensor, Option<Pose>)>,
}

/// What a rig took at one time.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Frame {
    pub id: u32,
    pub rig: u32,
    pub rig_from_world: Pose,
    /// What each sensor took; of a camera the number of the image.
    pub data: Vec<(Sensor, u64)>,
}

/// Rigs and frames of a model, and the names of their files.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Rigs {
    rigs: Vec<Rig>,
    frames: Vec<Frame>,
    rigs_file: String,
    frames_file: String,
}

const EXPORT: &str = "the files do not belong together: export the whole model again (`colmap model_converter`)";

/// Names of the files `rigs` and `frames` of the form that the model has; `None` of a model without.
///
/// # Errors
/// One without the other, or both in the other form alone.
pub(super) fn files(folder: &Path, ending: &str) -> Result<Option<[PathBuf; 2]>> {
    let other = if ending == "bin" { "txt" } else { "bin" };
    let path = |name: &str, ending: &str| folder.join(format!("{name}.{ending}"));
    let [rigs, frames] = ["rigs", "frames"].map(|name| path(name, ending));
    let fault = |here: &Path, what: String| Err(Error::invalid(here.display().to_string(), what, EXPORT));
    match (rigs.is_file(), frames.is_file()) {
        (true, true) => Ok(Some([rigs, frames])),
        (true, false) => fault(&rigs, format!("it is there without {}", frames.display())),
        (false, true) => fault(&frames, format!("it is there without {}", rigs.display())),
        (false, false) => match ["frames", "rigs"].map(|name| path(name, other)).into_iter().find(|p| p.is_file()) {
            Some(stray) => fault(&stray, format!("it is of another form than {}", path("images", ending).display())),
            None => Ok(None),
        },
    }
}

/// Differences from the poses in `images` that are rounding: degrees, and a share of the distance from the origin or of one unit.
const ROUNDING_DEG: f64 = 1e-3;
const ROUNDING: f64 = 1e-5;

impl Rigs {
    /// Those of two files; `None` where both are empty, which COLMAP, too, takes for a model of before there were any.
    pub fn new([rigs_file, frames_file]: &[PathBuf; 2], rigs: Vec<Rig>, frames: Vec<Frame>) -> Option<Self> {
        let [rigs_file, frames_file] = [rigs_file, frames_file].map(|file| file.display().to_string());
        (!rigs.is_empty() || !frames.is_empty()).then_some(Self { rigs, frames, rigs_file, frames_file })
    }

    /// camera_from_world of every image, and how far the quaternions it comes from are off length 1; `None` where the rig does not say where its
    /// camera is. `images_file` is where the images stand.
    ///
    /// # Errors
    /// Numbers that are there twice or that nobody has, an image in no frame or in two, a pose that is none.
    pub fn camera_from_world(
        &self,
        images: &[Image],
        images_file: &str,
        notes: &mut Vec<String>,
    ) -> Result<Vec<Option<(Rigid3, f64)>>> {
        let mut rigs = BTreeMap::new();
        for rig in &self.rigs {
            let place = || format!("{}: rig {}", self.rigs_file, rig.id);
            if rigs.insert(rig.id, rig).is_some() {
                return Err(Error::invalid(place(), "there are two of this number", EXPORT));
            }
            let mut mounted = BTreeSet::new();
            let all = rig.reference.iter().chain(rig.others.iter().map(|(sensor, _)| sensor));
            if let Some(twice) = all.into_iter().find(|sensor| !mounted.insert(**sensor)) {
                return Err(Error::invalid(place(), format!("it has {twice} twice"), EXPORT));
            }
        }
        let mut frame_ids = BTreeSet::new();
        // Number of an image to its frame, the place of that, and the camera that took it.
        let mut taken: BTreeMap<u64, (&Frame, String, Sensor)> = BTreeMap::new();
        for frame in &self.frames {
            let place = format!("{}: frame {}", self.frames_file, frame.id);
            if !frame_ids.insert(frame.id) {
                return Err(Error::invalid(place, "there are two of this number", EXPORT));
            }
            for (sensor, id) in frame.data.iter().filter(|(sensor, _)| sensor.kind == Kind::Camera) {
                if let Some((_, other, _)) = taken.insert(*id, (frame, place.clone(), *sensor)) {
                    return Err(Error::invalid(place, format!("image {id} is also in {other}"), EXPORT));
                }
            }
        }
        let mut without: BTreeMap<(u32, Sensor), usize> = BTreeMap::new();
        let (mut worst_deg, mut worst, mut differs) = (0.0_f64, 0.0_f64, false);
        let mut poses = Vec::with_capacity(images.len());
        for image in images {
            let at = format!("{images_file}: image {}", image.name);
            let Some((frame, place, sensor)) = taken.remove(&u64::from(image.id)) else {
                let what = format!("its number {} is in no frame of {}", image.id, self.frames_file);
                return Err(Error::invalid(at, what, EXPORT));
            };
            if sensor.id != image.camera {
                let what = format!("its camera is {}, and {place} says {}", image.camera, sensor.id);
                return Err(Error::invalid(at, what, EXPORT));
            }
            let Some(rig) = rigs.get(&frame.rig) else {
                return Err(Error::invalid(place, format!("{} has no rig {}", self.rigs_file, frame.rig), EXPORT));
            };
            let (rig_from_world, off) = frame.rig_from_world.rigid(&place)?;
            let camera_from_rig = if rig.reference == Some(sensor) {
                Some((Rigid3::IDENTITY, 0.0))
            } else {
                let Some((_, pose)) = rig.others.iter().find(|(other, _)| *other == sensor) else {
                    return Err(Error::invalid(place, format!("{}: rig {} has no {sensor}", self.rigs_file, rig.id), EXPORT));
                };
                let place = || format!("{}: rig {}: {sensor}", self.rigs_file, rig.id);
                pose.map(|pose| pose.rigid(&place())).transpose()?
            };
            let Some((camera_from_rig, mounted_off)) = camera_from_rig else {
                *without.entry((rig.id, sensor)).or_default() += 1;
                poses.push(None);
                continue;
            };
            let camera_from_world = camera_from_rig.compose(&rig_from_world);
            // What images say need not be a pose at all.
            if let Ok((said, _)) = image.camera_from_world.rigid("") {
                let (ours, theirs) = (camera_from_world.inverse(), said.inverse());
                let angle_deg = angle_deg(&ours, &theirs);
                let apart = ours.translation.distance(theirs.translation);
                differs |= angle_deg > ROUNDING_DEG || apart > ROUNDING * ours.translation.length().max(1.0);
                (worst_deg, worst) = (worst_deg.max(angle_deg), worst.max(apart));
            }
            poses.push(Some((camera_from_world, off.max(mounted_off))));
        }
        // Notes are kept in the data set, whose hash is not to depend on where the capture lies.
        let file_name = Path::new(images_file).file_name().unwrap_or_default().to_string_lossy();
        if differs {
            notes.push(format!(
                "poses are those of frames and rigs, as COLMAP reads them; those in {file_name} differ by up to {worst_deg:.3}° and {worst:.4} units"
            ));
        }
        for ((rig, sensor), count) in without {
            notes.push(format!(
                "rig {rig} does not say where its {sensor} is: {} {} no pose and {} left out",
                counted(count, "image"),
                verb(count, "has", "have"),
                verb(count, "was", "were")
            ));
        }
        if let Some((id, (frame, ..))) = taken.first_key_value() {
            notes.push(format!(
                "{} {} in frames and not in {file_name}, as {id} of frame {}",
                counted(taken.len(), "image"),
                verb(taken.len(), "is", "are"),
                frame.id
            ));
        }
        Ok(poses)
    }
}

/// Angle between two orientations, degrees.
fn angle_deg(a: &Rigid3, b: &Rigid3) -> f64 {
    // |R_a - R_b| = 2·sqrt(2)·sin(angle/2) in Frobenius' norm, which is exact near 0 where the trace is not.
    let difference = (a.rotation - b.rotation).to_cols_array().iter().map(|v| v * v).sum::<f64>().sqrt();
    2.0 * (difference / 8.0_f64.sqrt()).min(1.0).asin().to_degrees()
}

impl std::fmt::Display for Sensor {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let kind = match self.kind {
            Kind::Camera => "camera",
            Kind::Imu => "inertial unit",
        };
        write!(f, "{kind} {}", self.id)
    }
}
