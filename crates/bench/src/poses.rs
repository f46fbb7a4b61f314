//! Poses to render from: read from files, or around a circle.

use crate::json;
use anyhow::{Context, Result, ensure};
use corf_scene::Rigid3;
use glam::{DMat3, DVec3};
use serde::Deserialize;
use std::f64::consts::TAU;
use std::path::Path;

/// Most poses of a circle.
pub const MAX_ORBIT: usize = 100_000;

#[derive(Deserialize)]
#[serde(untagged)]
enum Poses {
    Matrices(Vec<[[f64; 4]; 4]>),
    Trajectory { keyframes: Vec<TrajectoryEntry> },
    Transforms { frames: Vec<TransformsFrame> },
}

#[derive(Deserialize)]
struct TrajectoryEntry {
    world_from_camera: [[f64; 4]; 4],
}

#[derive(Deserialize)]
struct TransformsFrame {
    transform_matrix: [[f64; 4]; 4],
}

/// The `world_from_camera` of every pose of a file, OpenCV axes, in the file's order. The frames of a `transforms.json` have OpenGL axes (x right, y up, z backward) and are turned;
/// the world is taken as it is.
///
/// # Errors
/// A file of another shape, that names no pose, or one that is no rigid transform.
pub fn read_poses(path: &Path) -> Result<Vec<Rigid3>> {
    let poses: Poses = json::read_json(path).context(
        "a pose file is a dataset's trajectory.json, a transforms.json with 4x4 transform_matrix (nerfstudio, Blender, Instant-NGP), or a JSON array of \
         4x4 world_from_camera matrices by rows",
    )?;
    // OpenGL's y is up and its z points backward.
    let turned = |mut rows: [[f64; 4]; 4]| {
        rows.iter_mut().take(3).for_each(|row| (row[1], row[2]) = (-row[1], -row[2]));
        rows
    };
    let rows: Vec<[[f64; 4]; 4]> = match poses {
        Poses::Matrices(rows) => rows,
        Poses::Trajectory { keyframes } => keyframes.into_iter().map(|k| k.world_from_camera).collect(),
        Poses::Transforms { frames } => frames.into_iter().map(|f| turned(f.transform_matrix)).collect(),
    };
    ensure!(!rows.is_empty(), "{} names no pose", path.display());
    rows.iter().enumerate().map(|(i, rows)| Ok(Rigid3::from_rows(rows, &format!("{}: pose {i}", path.display()))?)).collect()
}

/// A circle around the middle of some keyframes, as high as they are on average and as far from it as half of them are, looking inwards: `count` poses, the first in the
/// direction of +x. `radius_m` takes the place of that distance.
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

/// A circle about a keyframe in its own image plane, `radius_m` wide, looking at the point `distance_m` in front of it: `count` poses, the first to the right.
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
        read_poses(&path)
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
        for text in ["{}", "[]", "{\"frames\": []}", "[[[1,0,0,0],[0,2,0,0],[0,0,1,0],[0,0,0,1]]]"] {
            assert!(read(text).is_err(), "{text}");
        }
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
