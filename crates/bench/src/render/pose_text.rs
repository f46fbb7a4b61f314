//! Poses in a text file: a CSV, whose line of names says columns and units, or a trajectory in TUM's layout.

use anyhow::{Result, bail, ensure};
use corf_scene::config::Orientation;
use corf_scene::model::ARRAY_FROM_CAMERA;
use corf_scene::transform::ROUNDED;
use corf_scene::words::nearest;
use corf_scene::{Error, Rigid3};
use glam::DVec3;
use std::path::Path;

/// Columns of a CSV that place a pose.
const POSITION: [&str; 3] = ["x_m", "y_m", "z_m"];
/// Columns that turn it: the boresight's angles as scene files have them …
const ANGLES: [&str; 3] = ["yaw_deg", "pitch_deg", "roll_deg"];
/// … or the rotation of world_from_camera.
const QUATERNION: [&str; 4] = ["qw", "qx", "qy", "qz"];
/// Columns that say nothing of a pose, and are passed over.
const PASSED: [&str; 2] = ["index", "time_s"];
/// Fields of a line in TUM's layout.
const OF_TUM: usize = 8;

/// The layout that a file's ending says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TextLayout {
    /// Names and numbers, with commas between.
    Csv,
    /// `timestamp tx ty tz qx qy qz qw` a line.
    Tum,
}

impl TextLayout {
    /// The layout of a file; none of another ending, which is JSON.
    pub fn of(path: &Path) -> Option<Self> {
        let ending = path.extension()?.to_str()?.to_ascii_lowercase();
        match ending.as_str() {
            "csv" => Some(Self::Csv),
            "txt" | "tum" => Some(Self::Tum),
            _ => None,
        }
    }

    /// The poses of a text, `world_from_camera` with OpenCV axes, and how many of their rotations are rounded.
    ///
    /// # Errors
    /// A column that is none of a pose or is missing, a line of other fields, a number that is none or not finite, a quaternion that is no rotation; each
    /// with its line.
    pub fn read(self, text: &str, place: &str) -> Result<(Vec<Rigid3>, usize)> {
        let text = text.strip_prefix('\u{feff}').unwrap_or(text);
        let lines = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
        let mut lines = lines.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'));
        let columns = match self {
            Self::Tum => None,
            Self::Csv => match lines.next() {
                Some((number, names)) => Some(Columns::of(names, &format!("{place}:{number}"))?),
                None => bail!("{place} is empty\n  help: give a line of names, {}, and a pose a line below it", example()),
            },
        };
        let (mut poses, mut rounded) = (Vec::new(), 0);
        for (number, line) in lines {
            let at = format!("{place}:{number}");
            let (pose, off) = match &columns {
                Some(columns) => columns.pose(line, &at)?,
                None => of_tum(line, &at)?,
            };
            rounded += usize::from(off > ROUNDED);
            poses.push(pose);
        }
        Ok((poses, rounded))
    }
}

fn example() -> String {
    format!("{},{}", POSITION.join(","), ANGLES.join(","))
}

/// A finite number.
fn number(field: &str, name: &str, at: &str) -> Result<f64> {
    let value = field.parse::<f64>().ok().filter(|value| value.is_finite());
    value.ok_or_else(|| {
        let help = "give finite numbers with a decimal point, metres and degrees";
        Error::invalid(at, format!("{name} is \"{field}\", which is no number"), help).into()
    })
}

/// `timestamp tx ty tz qx qy qz qw`.
fn of_tum(line: &str, at: &str) -> Result<(Rigid3, f64)> {
    let fields: Vec<&str> = line.split_ascii_whitespace().collect();
    ensure!(
        fields.len() == OF_TUM,
        "{at}: {} fields where a trajectory in TUM's layout has {OF_TUM}: timestamp tx ty tz qx qy qz qw\n  help: name a CSV .csv and JSON .json",
        fields.len()
    );
    let names = ["timestamp", "tx", "ty", "tz", "qx", "qy", "qz", "qw"];
    let values: Vec<f64> = fields.iter().zip(names).map(|(field, name)| number(field, name, at)).collect::<Result<_>>()?;
    let [x, y, z, w] = [values[4], values[5], values[6], values[7]];
    Ok(Rigid3::from_quaternion([w, x, y, z], DVec3::from_slice(&values[1..4]), at)?)
}

/// Where the columns of a CSV stand.
struct Columns {
    names: Vec<String>,
}

impl Columns {
    fn of(line: &str, at: &str) -> Result<Self> {
        let names: Vec<String> = line.split(',').map(|name| name.trim().trim_matches('"').to_owned()).collect();
        let known = || POSITION.into_iter().chain(ANGLES).chain(QUATERNION).chain(PASSED);
        for (i, name) in names.iter().enumerate() {
            if !known().any(|k| k == name) {
                let meant = nearest(name, known()).map_or(String::new(), |near| format!("did you mean {near}? "));
                let all: Vec<&str> = known().collect();
                let help = format!("{meant}columns are {}; rename yours, or leave it out", all.join(", "));
                return Err(Error::invalid(at, format!("\"{name}\" is no column of poses"), help).into());
            }
            if names[..i].contains(name) {
                return Err(Error::invalid(at, format!("the column {name} is there twice"), "leave one of them out").into());
            }
        }
        let has = |name: &&str| names.iter().any(|n| n == name);
        if let Some(missing) = POSITION.iter().find(|name| !has(name)) {
            let help = format!("give the position in metres, e.g. {}", example());
            return Err(Error::invalid(at, format!("there is no column {missing}"), help).into());
        }
        let (angles, quaternion) = (ANGLES.iter().filter(|n| has(n)).count(), QUATERNION.iter().filter(|n| has(n)).count());
        let turned = match (angles, quaternion) {
            (0, 4) => true,
            (1.., 0) => has(&ANGLES[0]),
            _ => false,
        };
        if !turned {
            let what = "its columns do not say which way a pose looks";
            let help = "give yaw_deg (and pitch_deg, roll_deg) of the boresight, or qw, qx, qy, qz of world_from_camera: one of the two, whole";
            return Err(Error::invalid(at, what, help).into());
        }
        Ok(Self { names })
    }

    fn pose(&self, line: &str, at: &str) -> Result<(Rigid3, f64)> {
        let fields: Vec<&str> = line.split(',').map(|field| field.trim().trim_matches('"')).collect();
        ensure!(
            fields.len() == self.names.len(),
            "{at}: {} fields where the line of names has {}\n  help: give a number for every name, with a decimal point",
            fields.len(),
            self.names.len()
        );
        let of = |name: &str| -> Result<Option<f64>> {
            let field = self.names.iter().position(|n| n == name).map(|i| fields[i]);
            field.map(|field| number(field, name, at)).transpose()
        };
        let all = |names: &[&str]| names.iter().map(|name| Ok(of(name)?.unwrap_or(0.0))).collect::<Result<Vec<f64>>>();
        let translation = DVec3::from_slice(&all(&POSITION)?);
        if self.names.iter().any(|name| name == QUATERNION[0]) {
            let q = all(&QUATERNION)?;
            return Ok(Rigid3::from_quaternion([q[0], q[1], q[2], q[3]], translation, at)?);
        }
        let angles = all(&ANGLES)?;
        let orientation = Orientation { yaw_deg: angles[0], pitch_deg: angles[1], roll_deg: angles[2] };
        orientation.validate(at)?;
        Ok((Rigid3 { rotation: orientation.world_from_array() * ARRAY_FROM_CAMERA.rotation, translation }, 0.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn csv(text: &str) -> Result<Vec<Rigid3>> {
        TextLayout::Csv.read(text, "a.csv").map(|read| read.0)
    }

    #[test]
    fn a_table_and_a_trajectory_of_one_pose_are_that_pose() {
        // At (1, 2, 3), looking along +y with its head up: camera x is world x, y points down, z is world y.
        let pose = Rigid3::looking_at(DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.0, 9.0, 3.0), DVec3::Z);
        let q = glam::DQuat::from_mat3(&pose.rotation);
        let quaternion = format!("z_m,x_m,y_m,qx,qy,qz,qw,time_s\n3,1,2,{},{},{},{},0.5\n", q.x, q.y, q.z, q.w);
        let tum = format!("# timestamp tx ty tz qx qy qz qw\n0.5 1 2 3 {} {} {} {}\n", q.x, q.y, q.z, q.w);
        for read in [
            csv("x_m,y_m,z_m,yaw_deg\n1,2,3,90\n").unwrap(),
            csv("\u{feff}# a way\nindex,x_m,y_m,z_m,yaw_deg,pitch_deg,roll_deg\n\n0, 1, 2, 3, 90, 0, 0\n").unwrap(),
            csv(&quaternion).unwrap(),
            TextLayout::Tum.read(&tum, "a.tum").unwrap().0,
        ] {
            assert_eq!((read.len(), read[0].translation), (1, pose.translation));
            let off = (read[0].rotation - pose.rotation).to_cols_array().iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            assert!(off < 1e-12, "{:?}", read[0]);
        }
        let down = csv("x_m,y_m,z_m,yaw_deg,pitch_deg\n0,0,0,0,30\n").unwrap();
        assert!(
            (down[0].rotation.z_axis - DVec3::new(0.75f64.sqrt(), 0.0, -0.5)).length() < 1e-12,
            "a positive pitch looks down"
        );
    }

    #[test]
    fn what_is_wrong_is_named_with_its_line() {
        for (text, said) in [
            ("x_m,y_m,z_m,yaw\n1,2,3,0\n", "did you mean yaw_deg"),
            ("x,y_m,z_m,yaw_deg\n1,2,3,0\n", "\"x\" is no column of poses"),
            ("x_m,y_m,yaw_deg\n1,2,0\n", "a.csv:1: there is no column z_m"),
            ("x_m,y_m,z_m\n1,2,3\n", "which way a pose looks"),
            ("x_m,y_m,z_m,yaw_deg,qw\n1,2,3,0,1\n", "which way a pose looks"),
            ("x_m,y_m,z_m,pitch_deg\n1,2,3,0\n", "which way a pose looks"),
            ("x_m,y_m,z_m,yaw_deg,yaw_deg\n1,2,3,0,1\n", "yaw_deg is there twice"),
            ("x_m,y_m,z_m,yaw_deg\n1,2,3,0\n1,nan,3,0\n", "a.csv:3: y_m is \"nan\""),
            ("x_m,y_m,z_m,yaw_deg\n1,inf,3,0\n", "a.csv:2: y_m is \"inf\""),
            ("x_m,y_m,z_m,yaw_deg\n1,2,3\n", "a.csv:2: 3 fields where the line of names has 4"),
            ("x_m,y_m,z_m,yaw_deg\n1,2,3,1e9\n", "yaw_deg"),
            ("x_m,y_m,z_m,qw,qx,qy,qz\n1,2,3,9,0,0,0\n", "of length 9"),
            ("", "is empty"),
        ] {
            let error = format!("{:#}", csv(text).unwrap_err());
            assert!(error.contains(said) && error.contains("help: "), "{text}: {error}");
        }
        for (text, said) in [("1 2 3\n", "a.txt:1: 3 fields"), ("0 1 2 x 0 0 0 1\n", "tz is \"x\"")] {
            let error = format!("{:#}", TextLayout::Tum.read(text, "a.txt").unwrap_err());
            assert!(error.contains(said) && error.contains("help: "), "{text}: {error}");
        }
    }

    #[test]
    fn the_ending_says_the_layout() {
        let of = |path: &str| TextLayout::of(Path::new(path));
        assert_eq!(
            [of("a.CSV"), of("b/a.txt"), of("a.tum")],
            [Some(TextLayout::Csv), Some(TextLayout::Tum), Some(TextLayout::Tum)]
        );
        assert_eq!([of("a.json"), of("a")], [None; 2]);
    }
}
