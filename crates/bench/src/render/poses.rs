//! Poses to render from: read from files, or around a circle.

use crate::files::json;
use crate::note;
use crate::render::pose_text::TextLayout;
use anyhow::{Context, Result, bail, ensure};
use clap::ValueEnum;
use corf_scene::dataset::Dataset;
use corf_scene::transform::ROUNDED;
use corf_scene::words::counted;
use corf_scene::{Error, Rigid3, Similarity3, bounds, io};
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;
use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

/// Most poses of a circle.
pub const MAX_ORBIT: usize = 100_000;
/// Distance of two poses that are one, metres and elements of the rotation: single precision, a thousand metres from the origin.
const SAME_POSE: f64 = 1e-4;
/// Poses of a file that are looked for among the keyframes.
const LOOKED_FOR: usize = 256;

/// The frame that a pose file is in.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PoseFrame {
    /// The data set's world: z up, metres.
    World,
    /// The frame of the capture that the data set was imported from, before it was turned, scaled and moved.
    Capture,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Shape {
    Matrices(Vec<Rows>),
    Trajectory { schema: Option<String>, keyframes: Vec<TrajectoryEntry> },
    Transforms { frames: Vec<TransformsFrame> },
}

/// A matrix by rows, of which the last may be left out.
type Rows = Vec<[f64; 4]>;

#[derive(Deserialize)]
struct TrajectoryEntry {
    world_from_camera: Rows,
}

#[derive(Deserialize)]
struct TransformsFrame {
    transform_matrix: Rows,
}

/// A file of poses.
pub struct PoseFile {
    path: PathBuf,
    /// OpenCV axes, in the file's order and frame; rigid.
    poses: Vec<Rigid3>,
    /// Whether the file's form is this program's own, of which poses of a data set's world are written.
    is_ours: bool,
    sha256: String,
}

impl PoseFile {
    /// Reads a file and says where its rotations are rounded. The frames of a `transforms.json` have OpenGL axes (x right, y up, z backward) and are
    /// turned.
    ///
    /// # Errors
    /// A file of another shape, that names no pose, or one that is no rigid transform.
    pub fn read(path: &Path) -> Result<Self> {
        if let Some(layout) = TextLayout::of(path) {
            let (place, bytes) = (path.display().to_string(), io::read(path)?);
            let text = std::str::from_utf8(&bytes).map_err(|_| Error::invalid(&place, "it is no text", "save it as UTF-8"))?;
            let (poses, rounded) = layout.read(text, &place)?;
            ensure!(!poses.is_empty(), "{place} names no pose");
            if rounded > 0 {
                note!("{place}: rotations of {rounded} of {} poses are rounded; the nearest were taken", poses.len());
            }
            return Ok(Self { path: path.to_owned(), poses, is_ours: false, sha256: io::sha256_hex(&bytes) });
        }
        let file: Shape = json::read_json(path).context(
            "a pose file is a dataset's trajectory.json, a transforms.json with 4x4 transform_matrix (nerfstudio, Blender, Instant-NGP), a JSON array of \
             4x4 world_from_camera matrices by rows, a .csv with columns x_m, y_m, z_m, yaw_deg, or a trajectory in TUM's layout (.txt, .tum)",
        )?;
        // OpenGL's y is up and its z points backward.
        let turned = |mut rows: Rows| {
            rows.iter_mut().take(3).for_each(|row| (row[1], row[2]) = (-row[1], -row[2]));
            rows
        };
        let is_ours = match &file {
            Shape::Matrices(_) => true,
            // The plain layout of captures has no schema.
            Shape::Trajectory { schema, .. } => schema.is_some(),
            Shape::Transforms { .. } => false,
        };
        let rows: Vec<Rows> = match file {
            Shape::Matrices(rows) => rows,
            Shape::Trajectory { keyframes, .. } => keyframes.into_iter().map(|k| k.world_from_camera).collect(),
            Shape::Transforms { frames } => frames.into_iter().map(|f| turned(f.transform_matrix)).collect(),
        };
        let place = path.display();
        ensure!(!rows.is_empty(), "{place} names no pose");
        let mut poses = Vec::with_capacity(rows.len());
        let (mut rounded, mut worst) = (0, (0.0, 0));
        for (i, rows) in rows.iter().enumerate() {
            let whole = match *rows.as_slice() {
                [a, b, c] => [a, b, c, [0.0, 0.0, 0.0, 1.0]],
                [a, b, c, d] => [a, b, c, d],
                _ => bail!("{place}: pose {i} has {}\n  help: give 4x4 matrices by rows", counted(rows.len(), "row")),
            };
            let (pose, off) = Rigid3::nearest(&whole, &format!("{place}: pose {i}"))?;
            rounded += usize::from(off > ROUNDED);
            if off > worst.0 {
                worst = (off, i);
            }
            poses.push(pose);
        }
        if rounded > 0 {
            let (off, i) = worst;
            note!(
                "{place}: rotations of {rounded} of {} poses are rounded: that of pose {i} is {off:.1e} off one; the nearest were taken",
                poses.len()
            );
        }
        Ok(Self { path: path.to_owned(), poses, is_ours, sha256: io::sha256_hex(&io::read(path)?) })
    }

    /// Its SHA-256.
    pub fn sha256(&self) -> &str {
        &self.sha256
    }

    /// The `world_from_camera` of every pose, as the file has them: its frame is taken for the world.
    ///
    /// # Errors
    /// A position beyond [`bounds::MAX_COORDINATE_M`]; more poses than a data set has ([`bounds::MAX_KEYFRAMES`]).
    pub fn as_they_are(self) -> Result<Vec<Rigid3>> {
        let (place, count) = (self.path.display(), self.poses.len());
        ensure!(
            count <= bounds::MAX_KEYFRAMES,
            "{place} names {count} poses\n  help: give at most {}, and the rest in further files",
            bounds::MAX_KEYFRAMES
        );
        for (i, pose) in self.poses.iter().enumerate() {
            bounds::position(&format!("{place}: pose {i}"), pose.translation)?;
        }
        Ok(self.poses)
    }

    /// The `world_from_camera` of every pose in the world of a data set, and the frame that the file is in: that which is `stated`, or what the
    /// file's bytes, its poses or its form say. Where the data set was imported and its frame changed, what was decided is said.
    ///
    /// # Errors
    /// A file that may be in either of two frames; poses in the frame of a capture where there was none; a position beyond
    /// [`bounds::MAX_COORDINATE_M`].
    pub fn in_world_of(self, dataset: &Dataset, stated: Option<PoseFrame>) -> Result<(Vec<Rigid3>, PoseFrame)> {
        let place = self.path.display().to_string();
        let (poses, frame) = self.changed_to_world_of(dataset, stated)?;
        for (i, pose) in poses.iter().enumerate() {
            bounds::position(&format!("{place}: pose {i}"), pose.translation)?;
        }
        Ok((poses, frame))
    }

    fn changed_to_world_of(self, dataset: &Dataset, stated: Option<PoseFrame>) -> Result<(Vec<Rigid3>, PoseFrame)> {
        let Some(change) = dataset.world_from_capture() else {
            ensure!(
                stated != Some(PoseFrame::Capture),
                "--poses-in capture: {} was not imported, so there is no frame but its world\n  help: leave --poses-in out",
                dataset.dir().display()
            );
            return Ok((self.poses, PoseFrame::World));
        };
        if change.is_identity() {
            return Ok((self.poses, stated.unwrap_or(PoseFrame::World)));
        }
        let place = self.path.display();
        let (frame, why) = match stated {
            Some(frame) => (frame, "as --poses-in says"),
            None => self.recognised(dataset, &change).with_context(|| {
                format!(
                    "{place}: its poses may be in the frame of the capture or in the data set's world, which is turned, scaled or moved against it\n  \
                     help: say --poses-in capture or --poses-in world; dataset.json has the change as header.imported.world_from_capture"
                )
            })?,
        };
        match frame {
            PoseFrame::World => {
                note!("{place}: its poses are in the data set's world, {why}");
                Ok((self.poses, frame))
            }
            PoseFrame::Capture => {
                note!(
                    "{place}: its poses are in the capture's frame, {why}; they are turned, scaled and moved as the import did"
                );
                Ok((self.poses.iter().map(|pose| change.pose(pose)).collect(), frame))
            }
        }
    }

    /// The frame that the file can be known to be in, and by what.
    fn recognised(&self, dataset: &Dataset, change: &Similarity3) -> Option<(PoseFrame, &'static str)> {
        if dataset.is_of_capture(&self.sha256) {
            return Some((PoseFrame::Capture, "for it is the file that was imported"));
        }
        if dataset.is_own(&self.sha256) {
            return Some((PoseFrame::World, "for it is a file of the data set"));
        }
        let same = |a: &Rigid3, b: &Rigid3| {
            let turn = (a.rotation - b.rotation).to_cols_array().iter().fold(0.0_f64, |m, v| m.max(v.abs()));
            turn <= SAME_POSE && a.translation.distance(b.translation) <= SAME_POSE
        };
        let is_keyframe = |pose: &Rigid3| dataset.poses().iter().any(|k| same(pose, &k.world_from_camera));
        let count =
            |changed: &dyn Fn(&Rigid3) -> Rigid3| self.poses.iter().take(LOOKED_FOR).filter(|p| is_keyframe(&changed(p))).count();
        // A camera at the origin may be the same in both.
        match count(&|pose| *pose).cmp(&count(&|pose| change.pose(pose))) {
            Ordering::Greater => Some((PoseFrame::World, "where keyframes have the same poses")),
            Ordering::Less => Some((PoseFrame::Capture, "where keyframes had the same poses")),
            Ordering::Equal => self.is_ours.then_some((PoseFrame::World, "as files of this form are")),
        }
    }
}

/// A circle around the middle of some keyframes, as high as they are on average and as far from it as half of them are, looking inwards: `count`
/// poses, the first in the direction of +x. `radius_m` takes the place of that distance.
pub fn around_keyframes(keyframes: &[Rigid3], count: usize, radius_m: Option<f64>) -> Vec<Rigid3> {
    let positions = || keyframes.iter().map(|k| k.translation);
    let low = positions().fold(DVec3::INFINITY, DVec3::min);
    let high = positions().fold(DVec3::NEG_INFINITY, DVec3::max);
    let mean_z = positions().map(|p| p.z).sum::<f64>() / keyframes.len().max(1) as f64;
    let middle = (0.5 * (low + high)).with_z(mean_z);
    let mut distances: Vec<f64> = positions().map(|p| p.truncate().distance(middle.truncate())).collect();
    distances.sort_by(f64::total_cmp);
    let median = distances.get(distances.len() / 2).copied().unwrap_or(1.0);
    // A platform that stood still still has a circle around it.
    let radius = radius_m.unwrap_or(if median > 1e-3 { median } else { 1.0 });
    let pose = |i: usize| {
        let angle = TAU * i as f64 / count as f64;
        let eye = middle + radius * DVec3::new(angle.cos(), angle.sin(), 0.0);
        Rigid3::looking_at(eye, middle, DVec3::Z)
    };
    (0..count).map(pose).collect()
}

/// A circle about a keyframe in its own image plane, `radius_m` wide, looking at the point `distance_m` in front of it: `count` poses, the first to
/// the right.
pub fn about_keyframe(keyframe: &Rigid3, count: usize, radius_m: f64, distance_m: f64) -> Vec<Rigid3> {
    let [right, down, ahead] = [keyframe.rotation.x_axis, keyframe.rotation.y_axis, keyframe.rotation.z_axis];
    let target = keyframe.translation + distance_m * ahead;
    let pose = |i: usize| {
        let angle = TAU * i as f64 / count as f64;
        let eye = keyframe.translation + radius_m * (angle.cos() * right - angle.sin() * down);
        let z = (target - eye).normalize();
        let x = down.cross(z).normalize();
        Rigid3 { rotation: DMat3::from_cols(x, z.cross(x), z), translation: eye }
    };
    (0..count).map(pose).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<Rigid3>> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("poses.json");
        std::fs::write(&path, text).unwrap();
        PoseFile::read(&path).and_then(PoseFile::as_they_are)
    }

    fn is_rigid(pose: &Rigid3) -> bool {
        let error = pose.rotation.transpose() * pose.rotation - DMat3::IDENTITY;
        error.to_cols_array().iter().all(|e| e.abs() < 1e-12) && (pose.rotation.determinant() - 1.0).abs() < 1e-12
    }

    #[test]
    fn the_three_shapes_of_pose_files_are_told_apart() {
        // A camera at (1, 2, 3) that looks along +y of the world, with its head up.
        let pose = Rigid3::looking_at(DVec3::new(1.0, 2.0, 3.0), DVec3::new(1.0, 9.0, 3.0), DVec3::Z);
        let rows = serde_json::json!(pose.to_rows());
        // The same by hand in OpenGL's axes: x right, y up, z backward.
        let opengl = "[[1, 0, 0, 1], [0, 0, -1, 2], [0, 1, 0, 3], [0, 0, 0, 1]]";
        let same = [
            format!("[{rows}]"),
            format!("{{\"schema\": \"corf-trajectory/1\", \"keyframes\": [{{\"index\": 0, \"world_from_camera\": {rows}}}]}}"),
            format!(
                "{{\"camera_angle_x\": 0.7, \"frames\": [{{\"file_path\": \"./r_0\", \"rotation\": 0.01, \"transform_matrix\": {opengl}}}]}}"
            ),
        ];
        for text in same {
            let read = read(&text).unwrap();
            let difference = read[0].rotation - pose.rotation;
            assert!(difference.to_cols_array().iter().all(|d| d.abs() < 1e-12), "{text}: {:?}", read[0]);
            assert_eq!(read[0].translation, pose.translation);
        }
        for text in ["{}", "[]", "{\"frames\": []}", "[[[1,0,0,0],[0,2,0,0],[0,0,1,0],[0,0,0,1]]]", "[[[1,0,0,0],[0,1,0,0]]]"] {
            assert!(read(text).is_err(), "{text}");
        }
        // Metres that no room has, and more poses than any data set.
        let said = read("[[[1,0,0,0],[0,1,0,2e6],[0,0,1,0]]]").unwrap_err().to_string();
        assert!(said.contains("poses.json: pose 0") && said.contains("1e6"), "{said}");
        let many = vec!["[[1,0,0,0],[0,1,0,0],[0,0,1,0]]"; bounds::MAX_KEYFRAMES + 1].join(",");
        let said = read(&format!("[{many}]")).unwrap_err().to_string();
        assert!(said.contains("names 100001 poses") && said.contains("100000"), "{said}");
        // The last row may be left out, and three decimals are enough.
        let read = read("[[[0.878,-0.479,0,1],[0.479,0.878,0,2],[0,0,1,3]]]").unwrap();
        assert!(is_rigid(&read[0]) && read[0].translation == DVec3::new(1.0, 2.0, 3.0));
    }

    #[test]
    fn circles_close_and_look_where_they_should() {
        let keyframes: Vec<Rigid3> = [[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [0.0, 2.0]]
            .map(|[x, y]| Rigid3 { translation: DVec3::new(x, y, 1.5), ..Rigid3::IDENTITY })
            .to_vec();
        let circle = around_keyframes(&keyframes, 8, None);
        let middle = DVec3::new(2.0, 1.0, 1.5);
        for pose in &circle {
            assert!(is_rigid(pose) && (pose.translation.distance(middle) - 5f64.sqrt()).abs() < 1e-12);
            assert!((pose.rotation.z_axis - (middle - pose.translation).normalize()).length() < 1e-12);
        }
        assert!((circle[0].translation - DVec3::new(2.0 + 5f64.sqrt(), 1.0, 1.5)).length() < 1e-12);
        assert!((around_keyframes(&keyframes, 8, Some(0.5))[2].translation - DVec3::new(2.0, 1.5, 1.5)).length() < 1e-12);
        assert!(around_keyframes(&keyframes[..1], 3, None).iter().all(is_rigid));

        let keyframe = Rigid3::looking_at(DVec3::new(1.0, 1.0, 1.0), DVec3::new(4.0, 2.0, 0.5), DVec3::Z);
        let target = keyframe.translation + 3.0 * keyframe.rotation.z_axis;
        for pose in about_keyframe(&keyframe, 5, 0.3, 3.0) {
            assert!(is_rigid(&pose) && (pose.translation.distance(keyframe.translation) - 0.3).abs() < 1e-12);
            assert!(((target - pose.translation).normalize() - pose.rotation.z_axis).length() < 1e-12);
            assert!(pose.rotation.y_axis.dot(keyframe.rotation.y_axis) > 0.9, "its head stays up");
        }
    }
}
