//! Light that a data set has from another one of the same room and poses: its files are linked or copied, hashes checked, and none is traced again.

use super::file::FileRecord;
use super::header::{DatasetHeader, LightFrom};
use super::identity::compare;
use super::{Dataset, layout};
use crate::trajectory::TrajectoryPose;
use crate::words::counted;
use crate::{Error, Result, io};
use serde_json::{Value, json};
use std::path::Path;

/// Differences that a refusal names; more of them say no more.
const NAMED: usize = 6;

impl LightFrom {
    /// The data set that traced the light of `source`: itself, or the one whose light it has.
    pub fn of(source: &Dataset) -> Self {
        source.header().light_from.clone().unwrap_or_else(|| Self {
            dataset: source.header().name.clone(),
            dataset_hash: source.hash().to_owned(),
            generator: source.generator().to_owned(),
        })
    }
}

impl DatasetHeader {
    /// Takes the light of `source`: what was measured and chosen when it was traced (exposure, filter, adapter) is this data set's as well.
    ///
    /// # Errors
    /// A data set that was not generated; another mesh, other poses, another camera or other settings of light, each by its key.
    pub fn take_light_of(&mut self, source: &Dataset) -> Result<()> {
        let (place, theirs) = (source.dir().display().to_string(), source.header());
        if theirs.config.is_none() || !theirs.modalities.light {
            let what = "its light was not traced from a scene: it is a capture's";
            return Err(Error::invalid(place, what, "name a data set of `corf dataset generate`"));
        }
        let mut lines = Vec::new();
        compare("", &traced(theirs), &traced(self), &mut lines);
        lines.extend(other_pose(&theirs.poses, &self.poses));
        if !lines.is_empty() {
            let more = lines.len().saturating_sub(NAMED);
            lines.truncate(NAMED);
            if more > 0 {
                lines.push(format!("and {more} more"));
            }
            let list: String = lines.iter().map(|line| format!("\n    {line}")).collect();
            let what = format!("its light is not the one that this data set would have:{list}");
            let help = "only the transmitter, the carrier, the receiver and what stands under [rf] may differ: undo the rest, or trace light anew \
                        (leave --light-from out)";
            return Err(Error::invalid(place, what, help));
        }
        self.light_from = Some(LightFrom::of(source));
        self.exposure_ev = theirs.exposure_ev;
        self.denoiser.clone_from(&theirs.denoiser);
        self.light_adapter.clone_from(&theirs.light_adapter);
        Ok(())
    }
}

/// All that traced light depends on, but for the poses.
fn traced(header: &DatasetHeader) -> Value {
    let scene = header.scene.as_ref().map(|scene| &scene.scene);
    json!({
        "seed": header.seed,
        "optical_camera": header.light_camera,
        "optical": header.config.as_ref().map(|config| config.light),
        "scene": { "up": scene.map(|s| s.up), "offset_m": scene.map(|s| s.offset_m) },
        "scene_sha256": header.scene_sha256,
        "scene_content_sha256": header.scene_content_sha256,
    })
}

/// The first difference of two trajectories.
fn other_pose(there: &[TrajectoryPose], here: &[TrajectoryPose]) -> Option<String> {
    if there.len() != here.len() {
        return Some(format!("{} there, {} here", counted(there.len(), "keyframe"), here.len()));
    }
    let at = there.iter().zip(here).position(|(a, b)| a.world_from_camera != b.world_from_camera)?;
    let [a, b] = [there, here].map(|poses| poses[at].world_from_camera.translation);
    let turned = if a == b { ", turned otherwise" } else { "" };
    Some(format!("the pose of keyframe {at}: {a} there, {b} here{turned}"))
}

impl Dataset {
    /// The files of the camera's half of keyframe `index`, below the folder, with their records.
    pub(super) fn light_files(&self, index: usize) -> Vec<(String, FileRecord)> {
        let floats = [layout::LINEAR, layout::ALBEDO, layout::NORMALS].map(|name| layout::float_image(name, index));
        let others = [layout::image, layout::depth, layout::depth_png, layout::surface, layout::mask].map(|path| path(index));
        let there = |path: String| self.file().files.get(&path).cloned().map(|record| (path, record));
        others.into_iter().chain(floats).filter_map(there).collect()
    }
}

/// Puts a file of one data set into another: a second name of the same bytes where the file system has such, a copy elsewhere. Data sets replace their
/// files and never change them in place, so neither alters the other.
pub(super) fn share(source: &Path, target: &Path, record: &FileRecord) -> Result<()> {
    let bytes = io::read(source)?;
    if FileRecord::of(&bytes) != *record {
        let help =
            "restore that data set (`corf dataset validate` lists what is damaged), or trace light anew (leave --light-from out)";
        return Err(Error::invalid(source.display().to_string(), "it is not the file that its dataset.json tells of", help));
    }
    if let Some(folder) = target.parent() {
        std::fs::create_dir_all(folder).map_err(Error::io("create", folder))?;
    }
    if target.exists() {
        std::fs::remove_file(target).map_err(Error::io("replace", target))?;
    }
    match std::fs::hard_link(source, target) {
        Ok(()) => Ok(()),
        Err(_) => io::write_atomic(target, &bytes),
    }
}
