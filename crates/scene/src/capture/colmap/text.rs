//! COLMAP's text files. Lines that begin with `#` are comments; a byte-order mark and Windows' ends of lines are no matter.

use super::rigs::{Frame, Kind, Rig, Sensor};
use super::{Camera, Image, MODELS, Pose, READ, Sparse};
use crate::dataset::ColoredPoint;
use crate::{Error, Result, io};
use glam::DVec3;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::str::FromStr;

/// Reads `cameras.txt`, `images.txt` and, where it is there, `points3D.txt`.
pub(super) fn read(folder: &Path, notes: &mut Vec<String>) -> Result<Sparse> {
    let points = folder.join("points3D.txt");
    Ok(Sparse {
        cameras: cameras(&folder.join("cameras.txt"), notes)?,
        images: images(&folder.join("images.txt"), notes)?,
        points: if points.is_file() { self::points(&points, notes)? } else { Vec::new() },
    })
}

/// The text of a file.
fn content(path: &Path) -> Result<String> {
    let text = io::read_text(path)?;
    Ok(text.strip_prefix('\u{feff}').map(str::to_owned).unwrap_or(text))
}

/// The lines that say something, with their numbers from 1.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines().enumerate().map(|(i, line)| (i + 1, line.trim())).filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

/// A note where COLMAP's comment `# Number of WHAT: N` says another number than there are: the file was cut or changed behind its writer.
fn count(path: &Path, text: &str, what: &str, found: usize, notes: &mut Vec<String>) {
    let comments = text.lines().map(str::trim).take_while(|line| line.is_empty() || line.starts_with('#'));
    let stated = comments.filter_map(|line| line.split_once(&format!("Number of {what}:"))).find_map(|(_, rest)| {
        let digits: String = rest.trim_start().chars().take_while(char::is_ascii_digit).collect();
        digits.parse::<usize>().ok()
    });
    if let Some(stated) = stated.filter(|stated| *stated != found) {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        notes.push(format!("{name} has {found} {what}, and its comment says {stated}: was it cut short?"));
    }
}

fn fault(path: &Path, line: usize, what: impl Into<String>, help: &str) -> Error {
    Error::invalid(format!("{}:{line}", path.display()), what, help)
}

/// The value of a field, or its fault.
fn value<T: FromStr>(field: &str, path: &Path, line: usize) -> Result<T> {
    field.parse().map_err(|_| fault(path, line, format!("\"{field}\" is no number of that kind"), EXPORT))
}

/// Values of fields, all of them, or the fault of the first that is none.
fn values<T: FromStr>(fields: &[&str], path: &Path, line: usize) -> Result<Vec<T>> {
    fields.iter().map(|field| value(field, path, line)).collect()
}

const EXPORT: &str = "export the model again (`colmap model_converter --output_type TXT`)";

fn cameras(path: &Path, notes: &mut Vec<String>) -> Result<BTreeMap<u32, Camera>> {
    let mut cameras = BTreeMap::new();
    let content = content(path)?;
    for (line, text) in lines(&content) {
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
        let [width, height] = [width, height].map(|v| value::<u64>(v, path, line));
        let camera = Camera { model, width: width?, height: height?, parameters: values(parameters, path, line)? };
        if cameras.insert(value::<u32>(id, path, line)?, camera).is_some() {
            return Err(fault(path, line, format!("there is a camera {id} already"), EXPORT));
        }
    }
    count(path, &content, "cameras", cameras.len(), notes);
    Ok(cameras)
}

/// Two lines an image: pose and name, then 2-D points, which may be none: an empty line.
fn images(path: &Path, notes: &mut Vec<String>) -> Result<Vec<Image>> {
    let text = content(path)?;
    let mut images = Vec::new();
    let mut ids = BTreeSet::new();
    let mut rest = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim())).filter(|(_, line)| !line.starts_with('#'));
    while let Some((number, line)) = rest.next() {
        if line.is_empty() {
            continue;
        }
        let image = image(line, path, number)?;
        if !ids.insert(image.id) {
            return Err(fault(path, number, format!("there is an image {} already", image.id), EXPORT));
        }
        images.push(image);
        // The last image's may be missing at the end of the file.
        if let Some((number, line)) = rest.next() {
            observations(line, path, number)?;
        }
    }
    count(path, &text, "images", images.len(), notes);
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
    let v: Vec<f64> = values(&fields[1..8], path, number)?;
    Ok(Image {
        id: value(fields[0], path, number)?,
        camera_from_world: Pose { quaternion: [v[0], v[1], v[2], v[3]], translation: [v[4], v[5], v[6]] },
        camera: value(fields[8], path, number)?,
        name: rest.to_owned(),
    })
}

/// Makes sure that a line is the list of an image's 2-D points. They are not needed; but a file in which these lines are missing has every other
/// image in their place, which would be lost without a word.
fn observations(line: &str, path: &Path, number: usize) -> Result<()> {
    let no_list = |what: String| {
        let help = "two lines an image: its pose and name, then its 2-D points, or an empty line where it has none; export the model again \
                    (`colmap model_converter --output_type TXT`), or add the empty lines";
        Err(fault(path, number, format!("not the 2-D points of the image before, `X Y POINT3D_ID` each: {what}"), help))
    };
    let mut fields = line.split_whitespace();
    while let Some(x) = fields.next() {
        let (Some(y), Some(id)) = (fields.next(), fields.next()) else {
            return no_list(format!("{} fields", line.split_whitespace().count()));
        };
        for field in [x, y] {
            if field.parse::<f64>().is_err() {
                return no_list(format!("\"{field}\" is no coordinate"));
            }
        }
        // COLMAP writes -1 for none, or the largest number of 64 bits.
        if id.parse::<i64>().is_err() && id.parse::<u64>().is_err() {
            return no_list(format!("\"{id}\" is no number of a point"));
        }
    }
    Ok(())
}

pub(super) fn points(path: &Path, notes: &mut Vec<String>) -> Result<Vec<ColoredPoint>> {
    let mut points = Vec::new();
    let content = content(path)?;
    for (line, text) in lines(&content) {
        let mut fields = text.split_whitespace();
        let head: Vec<&str> = fields.by_ref().take(7).collect();
        if head.len() < 7 {
            return Err(fault(path, line, "not `ID X Y Z R G B ERROR TRACK`", EXPORT));
        }
        // Behind the error stand pairs: an image, and the point's place among its 2-D points.
        let behind = fields.count();
        if behind > 0 && behind % 2 == 0 {
            return Err(fault(
                path,
                line,
                format!("its track has {} fields, no pairs of IMAGE_ID POINT2D_IDX", behind - 1),
                EXPORT,
            ));
        }
        value::<u64>(head[0], path, line)?;
        let position: Vec<f64> = values(&head[1..4], path, line)?;
        let color: Vec<u8> = values(&head[4..7], path, line)?;
        let position = DVec3::from_slice(&position);
        if !position.is_finite() {
            return Err(fault(path, line, "a coordinate is not finite", EXPORT));
        }
        points.push(ColoredPoint { position, color: [color[0], color[1], color[2]] });
    }
    count(path, &content, "points", points.len(), notes);
    Ok(points)
}

/// Fields of a line, one after the other.
struct Fields<'a> {
    rest: std::str::SplitWhitespace<'a>,
    path: &'a Path,
    line: usize,
    form: &'static str,
}

impl<'a> Fields<'a> {
    fn of(text: &'a str, path: &'a Path, line: usize, form: &'static str) -> Self {
        Self { rest: text.split_whitespace(), path, line, form }
    }

    fn fault(&self, what: impl Into<String>) -> Error {
        fault(self.path, self.line, what, EXPORT)
    }

    fn word(&mut self) -> Result<&'a str> {
        self.rest.next().ok_or_else(|| self.fault(format!("it ends too soon: not `{}`", self.form)))
    }

    fn number<T: FromStr>(&mut self) -> Result<T> {
        value(self.word()?, self.path, self.line)
    }

    fn pose(&mut self) -> Result<Pose> {
        let mut v = [0.0; 7];
        for value in &mut v {
            *value = self.number()?;
        }
        Ok(Pose { quaternion: [v[0], v[1], v[2], v[3]], translation: [v[4], v[5], v[6]] })
    }

    fn sensor(&mut self) -> Result<Sensor> {
        let kind = match self.word()? {
            "CAMERA" => Kind::Camera,
            "IMU" => Kind::Imu,
            other => return Err(self.fault(format!("there is no kind of sensor \"{other}\""))),
        };
        Ok(Sensor { kind, id: self.number()? })
    }

    fn end(mut self) -> Result<()> {
        match self.rest.next() {
            None => Ok(()),
            Some(more) => Err(self.fault(format!("\"{more}\" follows on its last field: not `{}`", self.form))),
        }
    }
}

/// `rigs.txt`.
pub(super) fn rigs(path: &Path, notes: &mut Vec<String>) -> Result<Vec<Rig>> {
    const FORM: &str =
        "RIG_ID NUM_SENSORS REF_SENSOR_TYPE REF_SENSOR_ID (SENSOR_TYPE SENSOR_ID HAS_POSE [QW QX QY QZ TX TY TZ])...";
    let mut rigs = Vec::new();
    let content = content(path)?;
    for (line, text) in lines(&content) {
        let mut fields = Fields::of(text, path, line, FORM);
        let id = fields.number()?;
        let sensors: u64 = fields.number()?;
        let reference = if sensors > 0 { Some(fields.sensor()?) } else { None };
        let mut others = Vec::new();
        for _ in 1..sensors {
            let sensor = fields.sensor()?;
            let pose = match fields.word()? {
                "0" => None,
                "1" => Some(fields.pose()?),
                other => return Err(fields.fault(format!("HAS_POSE of {sensor} is \"{other}\", not 0 or 1"))),
            };
            others.push((sensor, pose));
        }
        fields.end()?;
        rigs.push(Rig { id, reference, others });
    }
    count(path, &content, "rigs", rigs.len(), notes);
    Ok(rigs)
}

/// `frames.txt`.
pub(super) fn frames(path: &Path, notes: &mut Vec<String>) -> Result<Vec<Frame>> {
    const FORM: &str = "FRAME_ID RIG_ID QW QX QY QZ TX TY TZ NUM_DATA_IDS (SENSOR_TYPE SENSOR_ID DATA_ID)...";
    let mut frames = Vec::new();
    let content = content(path)?;
    for (line, text) in lines(&content) {
        let mut fields = Fields::of(text, path, line, FORM);
        let (id, rig, rig_from_world) = (fields.number()?, fields.number()?, fields.pose()?);
        let count: u64 = fields.number()?;
        let mut data = Vec::new();
        for _ in 0..count {
            data.push((fields.sensor()?, fields.number()?));
        }
        fields.end()?;
        frames.push(Frame { id, rig, rig_from_world, data });
    }
    count(path, &content, "frames", frames.len(), notes);
    Ok(frames)
}
