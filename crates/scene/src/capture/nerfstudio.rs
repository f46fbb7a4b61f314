//! `transforms.json` as nerfstudio, Instant-NGP and NeRF write it: camera-to-world matrices in OpenGL axes (x right, y up, z backward).
//!
//! Intrinsics stand at the top or in every frame: `w h cx cy`, and of each axis a focal length, `fl_x fl_y` in pixels, or a full field of view,
//! `camera_angle_x camera_angle_y` in radians (NeRF, Instant-NGP) or `x_fov y_fov` in degrees (Instant-NGP); distortion in OpenCV's terms, `k1 k2 k3
//! p1 p2`, or all at once as nerfstudio's `distortion_params`, which are k1, k2, k3, k4, p1, p2 and come before the others. Each axis goes by its own: what the frame says comes before what the file says, and of each `x_fov` before `fl_x` before `camera_angle_x`,
//! as Instant-NGP reads them; an axis of which nothing is said has the other's focal length. `applied_transform` and `orientation_override` say how
//! the file came about and how it is to be shown; matrices are taken as they are.

use super::lens::Lens;
use super::rounding::Rounding;
use super::{Capture, Lists, Shot, json, names};
use crate::contained::{self, Reach};
use crate::words::{counted, verb};
use crate::{Error, Pinhole, Result, Rigid3, bounds, io};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// What is read of the file; it has much that is not.
#[derive(Deserialize)]
struct Transforms {
    #[serde(flatten)]
    camera: Camera,
    frames: Vec<Frame>,
    train_filenames: Option<Vec<String>>,
    val_filenames: Option<Vec<String>>,
    test_filenames: Option<Vec<String>>,
}

#[derive(Deserialize)]
struct Frame {
    file_path: String,
    depth_file_path: Option<String>,
    mask_path: Option<String>,
    transform_matrix: Vec<Vec<Option<f64>>>,
    #[serde(flatten)]
    camera: Camera,
}

/// Intrinsics, at the top or of one frame.
#[derive(Clone, Default, Deserialize)]
struct Camera {
    camera_model: Option<String>,
    w: Option<f64>,
    h: Option<f64>,
    fl_x: Option<f64>,
    fl_y: Option<f64>,
    cx: Option<f64>,
    cy: Option<f64>,
    camera_angle_x: Option<f64>,
    camera_angle_y: Option<f64>,
    x_fov: Option<f64>,
    y_fov: Option<f64>,
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
    distortion_params: Option<Vec<f64>>,
    // Terms of larger models, which are not read.
    k5: Option<f64>,
    k6: Option<f64>,
    skew: Option<f64>,
    is_fisheye: Option<bool>,
    // Instant-NGP's names of lenses that are no pinhole's.
    ftheta_p0: Option<f64>,
    latlong: Option<bool>,
    equirectangular: Option<bool>,
}

/// An axis of the image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Axis {
    X,
    Y,
}

/// A focal length that one place of the file states, pixels, and another that the same place states and that is not the same.
struct Focal {
    pixels: f64,
    /// Whether it is stated so, and not as a field of view.
    in_pixels: bool,
    contradicts: Option<f64>,
}

/// What was found in the intrinsics of a capture that deserves a word: how many frames each is of, and the first of them.
#[derive(Default)]
struct Words(BTreeMap<&'static str, (usize, String)>);

impl Words {
    fn add(&mut self, what: &'static str, example: impl FnOnce() -> String) {
        self.0.entry(what).or_insert_with(|| (0, example())).0 += 1;
    }

    fn notes(self) -> impl Iterator<Item = String> {
        self.0.into_iter().map(|(what, (count, first))| format!("{what} ({}, the first {first})", counted(count, "frame")))
    }
}

/// Share by which two statements of a number differ that is not rounding.
const SAME_NUMBER: f64 = 1e-3;

const CONTRADICTION: &str = "a focal length and a field of view say different things, and x_fov comes before fl_x before camera_angle_x, as in Instant-NGP";
const OVERRIDDEN: &str =
    "frames state other focal lengths than the file; the frames' were taken, where nerfstudio takes the file's";
const OTHERWISE: &str =
    "frames state another principal point or distortion than the file; the frames' were taken, where nerfstudio takes the file's";
const HALF_OVERRIDDEN: &str =
    "frames state another focal length than the file along one axis alone; along the other the file's was taken";

/// Models that are a pinhole with OpenCV's distortion, in the names of several writers.
const MODELS: [&str; 6] = ["OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE"];
const HELP: &str = "files of a capture lie in its folder: copy them in, or give images with --images and depth with --depth";

impl Camera {
    /// The same with `distortion_params` written out as the numbers they are.
    fn written_out(&self, place: &str) -> Result<Self> {
        let Some(params) = &self.distortion_params else { return Ok(self.clone()) };
        let &[k1, k2, k3, k4, p1, p2] = params.as_slice() else {
            let what = format!("distortion_params has {}", counted(params.len(), "number"));
            return Err(Error::invalid(place, what, "give six as nerfstudio reads them: k1, k2, k3, k4, p1, p2"));
        };
        let [k1, k2, k3, k4, p1, p2] = [k1, k2, k3, k4, p1, p2].map(Some);
        Ok(Self { k1, k2, k3, k4, p1, p2, distortion_params: None, ..self.clone() })
    }

    /// Whether `all` states another principal point or distortion.
    fn otherwise(&self, all: &Self) -> bool {
        let values = |c: &Self| [c.cx, c.cy, c.k1, c.k2, c.k3, c.k4, c.p1, c.p2];
        values(self).into_iter().zip(values(all)).any(|pair| matches!(pair, (Some(a), Some(b)) if differ(a, b)))
    }

    /// A frame's own values over those of all frames, but for the focal lengths, which go by axis.
    fn over(&self, all: &Self) -> Self {
        Self {
            camera_model: self.camera_model.clone().or_else(|| all.camera_model.clone()),
            w: self.w.or(all.w),
            h: self.h.or(all.h),
            cx: self.cx.or(all.cx),
            cy: self.cy.or(all.cy),
            k1: self.k1.or(all.k1),
            k2: self.k2.or(all.k2),
            k3: self.k3.or(all.k3),
            k4: self.k4.or(all.k4),
            p1: self.p1.or(all.p1),
            p2: self.p2.or(all.p2),
            k5: self.k5.or(all.k5),
            k6: self.k6.or(all.k6),
            skew: self.skew.or(all.skew),
            is_fisheye: self.is_fisheye.or(all.is_fisheye),
            ftheta_p0: self.ftheta_p0.or(all.ftheta_p0),
            latlong: self.latlong.or(all.latlong),
            equirectangular: self.equirectangular.or(all.equirectangular),
            ..Self::default()
        }
    }

    /// The focal length along an axis of `side` pixels that this place states, if any.
    fn focal(&self, axis: Axis, side: usize, place: &str) -> Result<Option<Focal>> {
        let (fov, fl, angle, names) = match axis {
            Axis::X => (self.x_fov, self.fl_x, self.camera_angle_x, ["x_fov", "fl_x", "camera_angle_x"]),
            Axis::Y => (self.y_fov, self.fl_y, self.camera_angle_y, ["y_fov", "fl_y", "camera_angle_y"]),
        };
        let of_angle = |angle: f64, name: &str, unit: &str, stated: f64| {
            if bounds::FIELD_OF_VIEW_DEG.contains(&angle.to_degrees()) {
                return Ok(0.5 * side as f64 / (0.5 * angle).tan());
            }
            let what = format!("{name} is {stated} {unit}, which is no pinhole's field of view");
            Err(Error::invalid(
                place,
                what,
                "give camera_angle_x and camera_angle_y in radians, x_fov and y_fov in degrees, or fl_x and fl_y in pixels",
            ))
        };
        let length = |f: f64| match f.is_finite() && f > 0.0 {
            true => Ok(f),
            false => {
                Err(Error::invalid(place, format!("{} is {f}, which is no focal length", names[1]), "give pixels, more than 0"))
            }
        };
        let stated = [
            fov.map(|v| of_angle(v.to_radians(), names[0], "degrees", v)).transpose()?,
            fl.map(length).transpose()?,
            angle.map(|v| of_angle(v, names[2], "radians", v)).transpose()?,
        ];
        let mut stated = stated.into_iter().flatten();
        let Some(pixels) = stated.next() else { return Ok(None) };
        let in_pixels = fov.is_none() && fl.is_some();
        Ok(Some(Focal { pixels, in_pixels, contradicts: stated.find(|other| differ(*other, pixels)) }))
    }

    /// The camera of a frame, whose own values are `self`, as a pinhole with distortion; `size` tells the picture's size where the file does not.
    /// Words are of the frame `name`, errors of `place`, which names the file as well.
    fn lens(
        &self,
        all: &Self,
        (name, place): (&str, &str),
        words: &mut Words,
        size: impl Fn() -> Result<(usize, usize)>,
    ) -> Result<Lens> {
        let stated = self.written_out(place)?;
        if stated.otherwise(all) {
            words.add(OTHERWISE, || name.to_owned());
        }
        let own = stated.over(all);
        let model = own.camera_model.as_deref().unwrap_or("OPENCV");
        let other = [
            (own.is_fisheye == Some(true), "fisheye"),
            (own.ftheta_p0.is_some(), "f-theta"),
            (own.latlong == Some(true), "latlong"),
            (own.equirectangular == Some(true), "equirectangular"),
            (!MODELS.contains(&model), model),
        ];
        if let Some((_, model)) = other.iter().find(|(is, _)| *is) {
            let help = format!("these are read: {}; undistort the images first (`colmap image_undistorter`)", MODELS.join(", "));
            return Err(Error::invalid(place, format!("camera model {model} is not read"), help));
        }
        let terms = [("a distortion k4", own.k4), ("a distortion k5", own.k5), ("a distortion k6", own.k6), ("a skew", own.skew)];
        if let Some((term, _)) = terms.iter().find(|(_, value)| value.is_some_and(|v| v != 0.0)) {
            let help = "undistort the images first; k1, k2, k3, p1 and p2 are read";
            return Err(Error::invalid(place, format!("it has {term}"), help));
        }
        let pixels = |side: Option<f64>, name: &str| match side {
            None => Ok(None),
            Some(n) if n >= 1.0 && n.fract() == 0.0 && n <= io::MAX_PIXELS as f64 => Ok(Some(n as usize)),
            Some(n) => Err(Error::invalid(place, format!("{name} is {n}"), "give whole numbers of pixels as w and h")),
        };
        let (width, height) = match (pixels(own.w, "w")?, pixels(own.h, "h")?) {
            (Some(w), Some(h)) => (w, h),
            // A side that is not stated is the picture's; one that is must be, which is found where the picture is read.
            (w, h) => size().map(|(width, height)| (w.unwrap_or(width), h.unwrap_or(height)))?,
        };
        let mut focal = [None; 2];
        let mut overridden = [false; 2];
        let mut of_file = [false; 2];
        let mut contradiction = None;
        let mut in_pixels = false;
        for (i, (axis, side)) in [(Axis::X, width), (Axis::Y, height)].into_iter().enumerate() {
            let (frame, file) = (self.focal(axis, side, place)?, all.focal(axis, side, place)?);
            of_file[i] = frame.is_none() && file.is_some();
            overridden[i] = matches!((&frame, &file), (Some(a), Some(b)) if differ(a.pixels, b.pixels));
            let Some(stated) = frame.or(file) else { continue };
            if let (Some(other), None) = (stated.contradicts, &contradiction) {
                contradiction = Some(format!("{name}: {:.3} and {other:.3} pixels along {axis:?}", stated.pixels));
            }
            focal[i] = Some(stated.pixels);
            in_pixels |= stated.in_pixels;
        }
        if let Some(example) = contradiction {
            words.add(CONTRADICTION, || example);
        }
        if overridden.contains(&true) {
            let what = if of_file.contains(&true) { HALF_OVERRIDDEN } else { OVERRIDDEN };
            words.add(what, || name.to_owned());
        }
        let (fx, fy) = match focal {
            [Some(x), Some(y)] => (x, y),
            [Some(f), None] | [None, Some(f)] => (f, f),
            [None, None] => {
                return Err(Error::invalid(
                    place,
                    "nothing says its focal length: neither fl_x, fl_y nor camera_angle_x, camera_angle_y",
                    "give the focal length in pixels as fl_x, and fl_y where it is another",
                ));
            }
        };
        let zero = |v: Option<f64>| v.unwrap_or(0.0);
        let lens = Lens {
            pinhole: Pinhole {
                width,
                height,
                fx,
                fy,
                cx: own.cx.unwrap_or(0.5 * width as f64),
                cy: own.cy.unwrap_or(0.5 * height as f64),
            },
            radial: [own.k1, own.k2, own.k3].map(zero),
            tangential: [own.p1, own.p2].map(zero),
        };
        lens.check(place)?;
        if in_pixels {
            bounds::in_pixels(place, &lens.pinhole)?;
        }
        bounds::centre_in_pixels(place, &lens.pinhole)?;
        Ok(lens)
    }
}

/// Whether two statements are of two numbers.
fn differ(a: f64, b: f64) -> bool {
    (a - b).abs() > SAME_NUMBER * a.abs().max(b.abs())
}

/// The pose of a matrix in OpenGL axes, and how far its rotation is off one.
fn pose(matrix: &[Vec<Option<f64>>], place: &str) -> Result<(Rigid3, f64)> {
    let row = |r: usize| -> Option<[f64; 4]> {
        let row: [Option<f64>; 4] = matrix.get(r)?.as_slice().try_into().ok()?;
        // JSON has no NaN; some writers put null in its place.
        Some(row.map(|v| v.unwrap_or(f64::NAN)))
    };
    let last = if matrix.len() == 3 { Some([0.0, 0.0, 0.0, 1.0]) } else { row(3) };
    let (Some(a), Some(b), Some(c), Some(last)) = (row(0), row(1), row(2), last) else {
        return Err(Error::invalid(place, "transform_matrix is no 4x4 matrix by rows", "give camera-to-world in OpenGL axes"));
    };
    // OpenGL's y and z axes point against OpenCV's.
    let [a, b, c] = [a, b, c].map(|[x, y, z, t]| [x, -y, -z, t]);
    Rigid3::nearest(&[a, b, c, last], place)
}

/// The file that `file_path` means below the capture's folder, or below a folder of images that was given by itself: there as it stands, where that
/// is a file, and otherwise without its first folders, as few as can be. Some writers leave the ending out.
fn image_path(folder: &Path, given: Option<&Path>, name: &str, place: &str) -> Result<PathBuf> {
    let file = |folder: &Path, name: &str| -> Result<Option<PathBuf>> {
        for ending in ["", ".png", ".jpg", ".jpeg", ".JPG", ".PNG"] {
            let path = contained::resolve(folder, Path::new(&format!("{name}{ending}")), Reach::Folder, place, HELP)?;
            if path.is_file() {
                return Ok(Some(path));
            }
        }
        Ok(None)
    };
    let Some(given) = given else {
        return Ok(file(folder, name)?.unwrap_or_else(|| folder.join(name)));
    };
    for tail in names::tails(name) {
        // A folder of that name is no file, and no fault.
        if !given.join(tail).is_dir()
            && let Some(path) = file(given, tail)?
        {
            return Ok(path);
        }
    }
    Ok(given.join(names::last(name)))
}

/// A word about masks that lie beside images as Instant-NGP looks for them, and that are not read.
fn unread_masks(shots: &[Shot]) -> Option<String> {
    let beside = |shot: &&Shot| {
        let stem = shot.image.as_ref().and_then(|image| image.file_stem()?.to_str());
        let mask = stem.map(|stem| format!("dynamic_mask_{stem}.png"));
        shot.image.as_ref().zip(mask).is_some_and(|(image, mask)| image.with_file_name(mask).is_file())
    };
    let count = shots.iter().filter(beside).count();
    (count > 0).then(|| {
        format!(
            "{} {} a dynamic_mask_*.png beside {}, as Instant-NGP reads, which was not read: there white pixels do not count (--masks takes masks \
             in which black ones do not)",
            counted(count, "image"),
            verb(count, "has", "have"),
            verb(count, "it", "them")
        )
    })
}

/// Reads `transforms.json` of a folder, or the JSON file itself; images lie in `images` where that is given, and are needed if `wanted`.
///
/// # Errors
/// A file that is missing or not of the format, a camera model that is not read, a pose that is none, a path that leads out.
pub(super) fn read(source: &Path, images: Option<&Path>, wanted: bool) -> Result<Capture> {
    let path = if source.is_file() { source.to_path_buf() } else { source.join("transforms.json") };
    let folder = path.parent().unwrap_or(Path::new(".")).to_path_buf();
    if !path.is_file() {
        return Err(Error::invalid(path.display().to_string(), "there is no such file", "give a folder with a transforms.json"));
    }
    let file: Transforms = json::read(&path, "give nerfstudio's form: frames with file_path and transform_matrix")?;
    if file.frames.is_empty() {
        return Err(Error::invalid(path.display().to_string(), "it has no frame", "give a capture with frames"));
    }
    let of_all = file.camera.written_out(&path.display().to_string())?;
    let (mut rounding, mut words) = (Rounding::default(), Words::default());
    let mut shots = Vec::with_capacity(file.frames.len());
    for frame in &file.frames {
        let name = frame.file_path.replace('\\', "/");
        let name = name.trim_start_matches("./").to_owned();
        let place = format!("{}: frame {name}", path.display());
        let image = image_path(&folder, images, &name, &place);
        let below = |name: &Option<String>| -> Result<Option<PathBuf>> {
            let resolve = |n: &String| contained::resolve(&folder, Path::new(n), Reach::Folder, &place, HELP);
            name.as_ref().map(resolve).transpose()
        };
        let size = || io::image_size(image_path(&folder, images, &name, &place)?);
        shots.push(Shot {
            lens: frame.camera.lens(&of_all, (&name, &place), &mut words, size)?,
            image: if wanted { Some(image?) } else { None },
            world_from_camera: rounding.take(pose(&frame.transform_matrix, &place)?, &name),
            depth: below(&frame.depth_file_path)?,
            mask: below(&frame.mask_path)?,
            time_s: None,
            name,
        });
    }
    shots.sort_by(|a, b| names::natural(&a.name, &b.name));
    let plain = |list: Option<Vec<String>>| -> Option<Vec<String>> {
        Some(list?.into_iter().map(|n| n.replace('\\', "/").trim_start_matches("./").to_owned()).collect())
    };
    let (train, val, test) = (plain(file.train_filenames), plain(file.val_filenames), plain(file.test_filenames));
    let (test, others) = if test.is_some() { (test, val.unwrap_or_default()) } else { (val, Vec::new()) };
    let missing = match (&train, &test) {
        (None, Some(_)) => Some("it lists what is held out and not what is trained with: all that it does not list is"),
        (Some(_), None) => Some("it lists what is trained with and not what is held out: all that it does not list is"),
        _ => None,
    };
    let stated = train.is_some() || test.is_some();
    let lists = stated.then(|| Lists { train, test, others, place: path.display().to_string() });
    let missing = missing.map(|what| format!("{}: {what}", path.display()));
    let notes = words.notes().chain(rounding.note()).chain(unread_masks(&shots)).chain(missing).collect();
    Ok(Capture { shots, points: Vec::new(), lists, spectra: None, sensor: None, files: vec![path], notes })
}

#[cfg(test)]
mod tests;
