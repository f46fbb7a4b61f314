//! The plain layout, for captures of no program: `trajectory.json` with poses, `camera.json` with one camera, and a folder `images/`.
//!
//! ```json
//! { "keyframes": [{ "file": "00001", "time_s": 0.0, "world_from_camera": [[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]] }] }
//! { "width": 640, "height": 480, "fx": 500, "fy": 500, "cx": 320, "cy": 240, "k1": 0, "k2": 0, "k3": 0, "p1": 0, "p2": 0 }
//! ```
//!
//! `spectra.json` may state the sensor of the spectra ([`SensorOptions`]). A data set's own `trajectory.json` is of this form.

use super::json::read as json;
use super::lens::Lens;
use super::names::{self, Folder};
use super::rounding::Rounding;
use super::sensor::{self, SensorOptions};
use super::{Capture, Shot};
use crate::{Error, Pinhole, Result, Rigid3, bounds};
use serde::Deserialize;
use std::path::Path;

#[derive(Deserialize)]
struct Trajectory {
    keyframes: Vec<Keyframe>,
}

#[derive(Deserialize)]
struct Keyframe {
    file: String,
    time_s: Option<f64>,
    world_from_camera: [[Option<f64>; 4]; 4],
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Camera {
    width: usize,
    height: usize,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    #[serde(default)]
    k1: f64,
    #[serde(default)]
    k2: f64,
    #[serde(default)]
    k3: f64,
    #[serde(default)]
    p1: f64,
    #[serde(default)]
    p2: f64,
}

/// Reads a folder; `camera` is that of the spectra, for captures without images, which need none of their own.
///
/// # Errors
/// A file that is missing or not of the format, a pose that is none, a stem without an image.
pub(super) fn read(source: &Path, images: &Path, wanted: bool) -> Result<Capture> {
    let (trajectory, camera) = (source.join("trajectory.json"), source.join("camera.json"));
    let place = trajectory.display().to_string();
    let file: Trajectory = json(&trajectory, "give keyframes with file, world_from_camera and, if known, time_s")?;
    if file.keyframes.is_empty() {
        return Err(Error::invalid(place, "it has no keyframe", "give a capture with keyframes"));
    }
    let mut files = vec![trajectory];
    let lens = if wanted {
        let c: Camera =
            json(&camera, "give width, height, fx, fy, cx, cy in pixels, and k1, k2, k3, p1, p2 where there is distortion")?;
        let Camera { width, height, fx, fy, cx, cy, .. } = c;
        let lens =
            Lens { pinhole: Pinhole { width, height, fx, fy, cx, cy }, radial: [c.k1, c.k2, c.k3], tangential: [c.p1, c.p2] };
        lens.check(&camera.display().to_string())?;
        bounds::in_pixels(&camera.display().to_string(), &lens.pinhole)?;
        files.push(camera);
        lens
    } else {
        Lens::plain(Pinhole::from_horizontal_fov(1, 1, 90.0))
    };
    let stated = source.join(sensor::FILE);
    let sensor = stated.is_file().then(|| SensorOptions::read(&stated)).transpose()?;
    files.extend(sensor.is_some().then_some(stated));
    let names: Vec<&str> = file.keyframes.iter().map(|k| k.file.as_str()).collect();
    let found = match wanted {
        true => Some(Folder::list(images, &["png", "jpg", "jpeg"], "--images")?.of(&names, "image")?),
        false => None,
    };
    let mut rounding = Rounding::default();
    let shot = |(i, k): (usize, &Keyframe)| {
        let rows = k.world_from_camera.map(|row| row.map(|v| v.unwrap_or(f64::NAN)));
        Ok(Shot {
            name: k.file.clone(),
            image: found.as_ref().map(|f| f[i].clone()),
            lens,
            world_from_camera: rounding.take(Rigid3::nearest(&rows, &format!("{place}: keyframe {}", k.file))?, &k.file),
            depth: None,
            mask: None,
            time_s: k.time_s.filter(|t| t.is_finite()),
        })
    };
    let mut shots: Vec<Shot> = file.keyframes.iter().enumerate().map(shot).collect::<Result<_>>()?;
    shots.sort_by(|a, b| names::natural(&a.name, &b.name));
    Ok(Capture {
        shots,
        points: Vec::new(),
        lists: None,
        spectra: None,
        sensor,
        files,
        notes: rounding.note().into_iter().collect(),
    })
}
