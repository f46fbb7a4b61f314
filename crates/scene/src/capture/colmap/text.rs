//! COLMAP's text files.

use super::{Camera, Image, MODELS, READ, Sparse};
use crate::dataset::ColoredPoint;
use crate::{Error, Result, io};
use glam::DVec3;
use std::collections::BTreeMap;
use std::path::Path;
use std::str::FromStr;

/// Reads `cameras.txt`, `images.txt` and, where it is there, `points3D.txt`.
pub(super) fn read(folder: &Path) -> Result<Sparse> {
    let points = folder.join("points3D.txt");
    Ok(Sparse {
        cameras: cameras(&folder.join("cameras.txt"))?,
        images: images(&folder.join("images.txt"))?,
        points: if points.is_file() { self::points(&points)? } else { Vec::new() },
    })
}

/// The lines that say something, with their numbers from 1.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines().enumerate().map(|(i, line)| (i + 1, line.trim())).filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

fn fault(path: &Path, line: usize, what: impl Into<String>, help: &str) -> Error {
    Error::invalid(format!("{}:{line}", path.display()), what, help)
}

/// Values of fields, all of them, or the fault of the first that is none.
fn values<T: FromStr>(fields: &[&str], path: &Path, line: usize) -> Result<Vec<T>> {
    let value =
        |field: &&str| field.parse().map_err(|_| fault(path, line, format!("\"{field}\" is no number of that kind"), EXPORT));
    fields.iter().map(value).collect()
}

const EXPORT: &str = "export the model again (`colmap model_converter --output_type TXT`)";

fn cameras(path: &Path) -> Result<BTreeMap<u32, Camera>> {
    let mut cameras = BTreeMap::new();
    for (line, text) in lines(&io::read_text(path)?) {
        let fields: Vec<&str> = text.split_whitespace().collect();
        let [id, name, width, height, parameters @ ..] = fields.as_slice() else {
            return Err(fault(path, line, "not `ID MODEL WIDTH HEIGHT PARAMETERS`", EXPORT));
        };
        let Some(model) = MODELS.into_iter().find(|m| m.name == *name) else {
            let help = format!("these are read: {READ}");
            return Err(fault(path, line, format!("there is no camera model {name}"), &help));
        };
        if parameters.len() != model.parameters {
            let what = format!("{name} has {} parameters, the line {}", model.parameters, parameters.len());
            return Err(fault(path, line, what, EXPORT));
        }
        let [width, height] = [width, height].map(|v| values::<u64>(&[v], path, line));
        let camera = Camera { model, width: width?[0], height: height?[0], parameters: values(parameters, path, line)? };
        if cameras.insert(values::<u32>(&[id], path, line)?[0], camera).is_some() {
            return Err(fault(path, line, format!("there is a camera {id} already"), EXPORT));
        }
    }
    Ok(cameras)
}

/// Two lines an image: pose and name, then 2-D points, which may be none: an empty line.
fn images(path: &Path) -> Result<Vec<Image>> {
    let text = io::read_text(path)?;
    let mut images = Vec::new();
    let mut rest = text.lines().enumerate();
    while let Some((i, line)) = rest.next() {
        let line = line.trim();
        if line.is_empty() || line.starts_with('#') {
            continue;
        }
        images.push(image(line, path, i + 1)?);
        // Its points are not needed.
        rest.next();
    }
    Ok(images)
}

fn image(line: &str, path: &Path, number: usize) -> Result<Image> {
    // The name may hold spaces: it is all that comes behind nine numbers.
    let mut fields = Vec::with_capacity(9);
    let mut rest = line;
    while fields.len() < 9 {
        let Some((field, behind)) = rest.split_once(char::is_whitespace) else {
            return Err(fault(path, number, "not `ID QW QX QY QZ TX TY TZ CAMERA NAME`", EXPORT));
        };
        fields.push(field);
        rest = behind.trim_start();
    }
    values::<u32>(&fields[..1], path, number)?;
    let v: Vec<f64> = values(&fields[1..8], path, number)?;
    Ok(Image {
        quaternion: [v[0], v[1], v[2], v[3]],
        translation: [v[4], v[5], v[6]],
        camera: values::<u32>(&fields[8..], path, number)?[0],
        name: rest.to_owned(),
    })
}

pub(super) fn points(path: &Path) -> Result<Vec<ColoredPoint>> {
    let mut points = Vec::new();
    for (line, text) in lines(&io::read_text(path)?) {
        let fields: Vec<&str> = text.split_whitespace().take(7).collect();
        if fields.len() < 7 {
            return Err(fault(path, line, "not `ID X Y Z R G B ERROR TRACK`", EXPORT));
        }
        let position: Vec<f64> = values(&fields[1..4], path, line)?;
        let color: Vec<u8> = values(&fields[4..7], path, line)?;
        let position = DVec3::from_slice(&position);
        if !position.is_finite() {
            return Err(fault(path, line, "a coordinate is not finite", EXPORT));
        }
        points.push(ColoredPoint { position, color: [color[0], color[1], color[2]] });
    }
    Ok(points)
}
