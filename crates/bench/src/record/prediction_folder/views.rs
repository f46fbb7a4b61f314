//! `views.json`: where the views of a folder were drawn from, so that one is not compared with a keyframe of another place.

use super::Names;
use crate::files::json::{read_json, write_json};
use crate::split::Split;
use anyhow::{Result, ensure};
use corf_scene::Rigid3;
use corf_scene::dataset::Dataset;
use glam::DQuat;
use std::path::Path;

/// Name of the file: `world_from_camera` of each view in the data set's world, 4×4 by rows, in the order of their numbers.
const VIEWS: &str = "views.json";

/// How far a view may be off its keyframe, metres, and radians of turn: files that people write have four digits.
const TOLERANCE: [f64; 2] = [1e-3, 1e-3];

/// Writes where the views of a folder are drawn from.
///
/// # Errors
/// A file that cannot be written.
pub fn write_views(dir: &Path, views: &[Rigid3]) -> Result<()> {
    write_json(&dir.join(VIEWS), &views.iter().map(Rigid3::to_rows).collect::<Vec<_>>())
}

/// Checks that the views of a folder are those of the held-out keyframes, where the folder says what its views are.
///
/// # Errors
/// A damaged file; a view from elsewhere than the keyframe whose number it has.
pub(super) fn check_views(dir: &Path, dataset: &Dataset, split: &Split, names: Names) -> Result<()> {
    let path = dir.join(VIEWS);
    if !path.exists() {
        return Ok(());
    }
    let views: Vec<[[f64; 4]; 4]> = read_json(&path)?;
    for &index in &split.held_out {
        // Numbers count from 1 here.
        let number = if names == Names::Stem { index + 1 } else { index };
        let Some(view) = number.checked_sub(1).and_then(|i| views.get(i)) else { continue };
        let view = Rigid3::from_rows(view, &path.display().to_string())?;
        let keyframe = &dataset.poses()[index].world_from_camera;
        let off = [
            (view.translation - keyframe.translation).length(),
            DQuat::from_mat3(&view.rotation).angle_between(DQuat::from_mat3(&keyframe.rotation)),
        ];
        ensure!(
            off[0] <= TOLERANCE[0] && off[1] <= TOLERANCE[1],
            "{}: view {number:05} was drawn {:.3} m and {:.2} degrees off keyframe {index}, whose number it has\n  help: views are numbered in the \
             order of their file of poses: render the data set's own (--poses DATASET/trajectory.json)",
            path.display(),
            off[0],
            off[1].to_degrees()
        );
    }
    Ok(())
}
