//! `transforms.json` as nerfstudio, Instant-NGP and NeRF write it: camera-to-world matrices in OpenGL axes (x right, y up, z backward).
//!
//! Intrinsics stand at the top or in every frame: `w h fl_x fl_y cx cy`, or `camera_angle_x`; distortion in OpenCV's terms, `k1 k2 k3 p1 p2`.
//! `applied_transform` and `orientation_override` say how the file came about and how it is to be shown; matrices are taken as they are.

use super::lens::Lens;
use super::{Capture, Lists, Shot, json, names};
use crate::contained::{self, Reach};
use crate::{Error, Pinhole, Result, Rigid3, io};
use serde::Deserialize;
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
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    k4: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
    is_fisheye: Option<bool>,
}

/// Models that are a pinhole with OpenCV's distortion, in the names of several writers.
const MODELS: [&str; 6] = ["OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE"];
const HELP: &str = "files of a capture lie in its folder: copy them in, or give images with --images and depth with --depth";

impl Camera {
    /// A frame's own values over those of all frames.
    fn over(&self, all: &Self) -> Self {
        Self {
            camera_model: self.camera_model.clone().or_else(|| all.camera_model.clone()),
            w: self.w.or(all.w),
            h: self.h.or(all.h),
            fl_x: self.fl_x.or(all.fl_x),
            fl_y: self.fl_y.or(all.fl_y),
            cx: self.cx.or(all.cx),
            cy: self.cy.or(all.cy),
            camera_angle_x: self.camera_angle_x.or(all.camera_angle_x),
            k1: self.k1.or(all.k1),
            k2: self.k2.or(all.k2),
            k3: self.k3.or(all.k3),
            k4: self.k4.or(all.k4),
            p1: self.p1.or(all.p1),
            p2: self.p2.or(all.p2),
            is_fisheye: self.is_fisheye.or(all.is_fisheye),
        }
    }

    /// As a pinhole with distortion; `image` tells its size where the file does not.
    fn lens(&self, place: &str, size: impl Fn() -> Result<(usize, usize)>) -> Result<Lens> {
        let model = self.camera_model.as_deref().unwrap_or("OPENCV");
        if self.is_fisheye == Some(true) || !MODELS.contains(&model) {
            let model = if self.is_fisheye == Some(true) { "fisheye" } else { model };
            let help = format!("these are read: {}; undistort the images first (`colmap image_undistorter`)", MODELS.join(", "));
            return Err(Error::invalid(place, format!("camera model {model} is not read"), help));
        }
        if self.k4.is_some_and(|k| k != 0.0) {
            return Err(Error::invalid(
                place,
                "it has a distortion k4",
                "undistort the images first; k1, k2, k3, p1 and p2 are read",
            ));
        }
        let (width, height) = match (self.w, self.h) {
            (Some(w), Some(h)) if w >= 1.0 && h >= 1.0 && w.fract() == 0.0 && h.fract() == 0.0 => (w as usize, h as usize),
            (None, None) => size()?,
            (w, h) => {
                return Err(Error::invalid(
                    place,
                    format!("its size is {w:?} x {h:?}"),
                    "give whole numbers of pixels as w and h",
                ));
            }
        };
        let focal = self.fl_x.or_else(|| self.camera_angle_x.map(|angle| 0.5 * width as f64 / (0.5 * angle).tan()));
        let Some(fx) = focal else {
            return Err(Error::invalid(
                place,
                "it has neither fl_x nor camera_angle_x",
                "give the focal length in pixels as fl_x",
            ));
        };
        let zero = |v: Option<f64>| v.unwrap_or(0.0);
        let lens = Lens {
            pinhole: Pinhole {
                width,
                height,
                fx,
                fy: self.fl_y.unwrap_or(fx),
                cx: self.cx.unwrap_or(0.5 * width as f64),
                cy: self.cy.unwrap_or(0.5 * height as f64),
            },
            radial: [self.k1, self.k2, self.k3].map(zero),
            tangential: [self.p1, self.p2].map(zero),
        };
        lens.check(place)?;
        Ok(lens)
    }
}

/// The pose of a matrix in OpenGL axes.
fn pose(matrix: &[Vec<Option<f64>>], place: &str) -> Result<Rigid3> {
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
    Rigid3::from_rows(&[a, b, c, last], place)
}

/// The file that `file_path` means: some writers leave its ending out.
fn image_path(folder: &Path, name: &str, place: &str) -> Result<PathBuf> {
    let resolve = |name: &str| contained::resolve(folder, Path::new(name), Reach::Folder, place, HELP);
    for ending in ["", ".png", ".jpg", ".jpeg", ".JPG", ".PNG"] {
        let path = resolve(&format!("{name}{ending}"))?;
        if path.is_file() {
            return Ok(path);
        }
    }
    resolve(name)
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
    let mut shots = Vec::with_capacity(file.frames.len());
    for frame in &file.frames {
        let name = frame.file_path.replace('\\', "/");
        let name = name.trim_start_matches("./").to_owned();
        let place = format!("{}: frame {name}", path.display());
        let image = match images {
            Some(dir) => image_path(dir, names::last(&name), &place),
            None => image_path(&folder, &name, &place),
        };
        let below = |name: &Option<String>| -> Result<Option<PathBuf>> {
            let resolve = |n: &String| contained::resolve(&folder, Path::new(n), Reach::Folder, &place, HELP);
            name.as_ref().map(resolve).transpose()
        };
        let size = || {
            io::read_png(image_path(
                images.unwrap_or(&folder),
                if images.is_some() { names::last(&name) } else { &name },
                &place,
            )?)
            .map(|i| (i.width(), i.height()))
        };
        shots.push(Shot {
            lens: frame.camera.over(&file.camera).lens(&place, size)?,
            image: if wanted { Some(image?) } else { None },
            world_from_camera: pose(&frame.transform_matrix, &place)?,
            depth: below(&frame.depth_file_path)?,
            mask: below(&frame.mask_path)?,
            time_s: None,
            name,
        });
    }
    shots.sort_by(|a, b| names::natural(&a.name, &b.name));
    let lists = match (file.train_filenames, file.test_filenames.or(file.val_filenames)) {
        (Some(train), Some(test)) => {
            let plain = |list: Vec<String>| list.into_iter().map(|n| n.trim_start_matches("./").to_owned()).collect();
            Some(Lists { train: plain(train), test: plain(test), place: path.display().to_string() })
        }
        _ => None,
    };
    Ok(Capture { shots, points: Vec::new(), lists, spectra: None, files: vec![path], notes: Vec::new() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn parse(json: &str, wanted: bool) -> Result<Capture> {
        let dir = tempfile::tempdir().unwrap();
        std::fs::write(dir.path().join("transforms.json"), json).unwrap();
        std::fs::write(dir.path().join("a.png"), io::encode_png(&crate::Raster::filled(20, 10, [1; 3])).unwrap()).unwrap();
        read(dir.path(), None, wanted)
    }

    const MATRIX: &str = "[[1,0,0,5],[0,1,0,6],[0,0,1,7],[0,0,0,1]]";

    #[test]
    fn opengl_axes_become_opencv_axes() {
        let json = format!(
            r#"{{"w":20,"h":10,"fl_x":15,"fl_y":16,"cx":9,"cy":4,"k1":-0.1,"p2":0.01,"aabb_scale":4,
            "train_filenames":["b"],"val_filenames":["./a"],
            "frames":[{{"file_path":"./b","transform_matrix":{MATRIX}}},
            {{"file_path":"./a","fl_x":30,"transform_matrix":{MATRIX},"depth_file_path":"d/a.png","mask_path":"m/a.png","sharpness":3}}]}}"#
        );
        let capture = parse(&json, true).unwrap();
        let [a, b] = capture.shots.as_slice() else { panic!("two frames") };
        assert_eq!((a.name.as_str(), b.name.as_str()), ("a", "b"));
        // An OpenGL camera that is not turned looks along -z with its top at +y.
        assert_eq!(a.world_from_camera.transform_vector(DVec3::Z), -DVec3::Z);
        assert_eq!(a.world_from_camera.transform_vector(DVec3::Y), -DVec3::Y);
        assert_eq!(a.world_from_camera.transform_vector(DVec3::X), DVec3::X);
        assert_eq!(a.world_from_camera.translation, DVec3::new(5.0, 6.0, 7.0));
        assert_eq!(a.lens.pinhole, Pinhole { width: 20, height: 10, fx: 30.0, fy: 16.0, cx: 9.0, cy: 4.0 });
        assert_eq!((b.lens.pinhole.fx, b.lens.radial, b.lens.tangential), (15.0, [-0.1, 0.0, 0.0], [0.0, 0.01]));
        assert!(a.depth.as_ref().unwrap().ends_with("d/a.png") && a.mask.is_some() && b.depth.is_none());
        assert!(a.image.as_ref().unwrap().ends_with("a.png"), "an ending that was left out is found");
        let lists = capture.lists.unwrap();
        assert_eq!((lists.train, lists.test), (vec!["b".to_owned()], vec!["a".to_owned()]));
    }

    #[test]
    fn a_field_of_view_and_the_picture_itself_make_a_camera() {
        let json =
            format!(r#"{{"camera_angle_x":1.5707963267948966,"frames":[{{"file_path":"a.png","transform_matrix":{MATRIX}}}]}}"#);
        let lens = parse(&json, true).unwrap().shots[0].lens;
        assert!((lens.pinhole.fx - 10.0).abs() < 1e-12 && lens.pinhole.fx == lens.pinhole.fy);
        assert_eq!((lens.pinhole.width, lens.pinhole.height, lens.pinhole.cx, lens.pinhole.cy), (20, 10, 10.0, 5.0));
    }

    #[test]
    fn what_cannot_be_read_is_refused_with_the_frame_that_says_it() {
        let frame = |camera: &str, matrix: &str| {
            format!(r#"{{"w":20,"h":10,"fl_x":15{camera},"frames":[{{"file_path":"a.png","transform_matrix":{matrix}}}]}}"#)
        };
        let refused = |json: &str, words: &[&str]| {
            let message = parse(json, true).unwrap_err().to_string();
            assert!(words.iter().all(|w| message.contains(w)), "{message}");
        };
        refused(&frame(r#","camera_model":"OPENCV_FISHEYE""#, MATRIX), &["a.png", "OPENCV_FISHEYE", "undistort"]);
        refused(&frame(r#","is_fisheye":true"#, MATRIX), &["fisheye"]);
        refused(&frame(r#","k4":0.1"#, MATRIX), &["k4"]);
        refused(&frame("", "[[1,0,0,5],[0,1,0,6],[0,0,NaN,7],[0,0,0,1]]"), &["a.png", "NaN"]);
        refused(&frame("", "[[2,0,0,5],[0,1,0,6],[0,0,1,7],[0,0,0,1]]"), &["a.png"]);
        refused(&frame("", "[[1,0,0],[0,1,0],[0,0,1]]"), &["4x4"]);
        refused(r#"{"frames":[]}"#, &["no frame"]);
        refused("{", &["transforms.json:1"]);
        refused(&frame("", MATRIX).replace("\"fl_x\":15", "\"cx\":1"), &["fl_x"]);
        refused(&frame("", MATRIX).replace("a.png", "../a.png"), &["leads out"]);
    }
}
