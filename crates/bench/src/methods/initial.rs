//! Gaussians of another program that a method begins with.

use crate::methods::interface::TrainingSet;
use crate::note;
use anyhow::{Result, ensure};
use corf::expansion::initial::{RadioView, coupled, in_view};
use corf::files::ply::{self, ForeignField};
use corf::{Antialias, Gaussians, RadioTarget};
use corf_scene::words::counted;
use glam::DVec3;
use std::path::{Path, PathBuf};

/// A field of light in a file.
pub struct Initial {
    file: PathBuf,
    field: ForeignField,
}

/// Share of the Gaussians by which more must be in view in the capture's frame than in the world for a file to be taken for one of the former.
const MORE_IN_VIEW: f64 = 0.05;
/// A file of which less than this share is in view of the training cameras deserves a word.
const LITTLE_IN_VIEW: f64 = 0.2;

impl Initial {
    /// Reads a PLY of Gaussians.
    ///
    /// # Errors
    /// A file that cannot be read, of another layout, or with numbers that mean nothing.
    pub fn read(file: &Path) -> Result<Self> {
        Ok(Self { file: file.to_path_buf(), field: ply::read_foreign(file)? })
    }

    /// Makes sure that the file can be of this data set.
    ///
    /// # Errors
    /// Gaussians of which the training keyframes see none, or see more when they are taken to be in the frame of the capture.
    pub fn check(&self, training: &TrainingSet<'_>) -> Result<()> {
        let gaussians = &self.field.gaussians;
        let (camera, poses, all) = (training.light_camera(), training.poses(), gaussians.position.len());
        let seen = in_view(gaussians, &camera, &poses);
        if let Some(change) = training.world_from_capture().filter(|change| !change.is_identity()) {
            let mut moved = gaussians.clone();
            for p in &mut moved.position {
                *p = change.transform_point(DVec3::from(p.map(f64::from))).as_vec3().to_array();
            }
            let of_capture = in_view(&moved, &camera, &poses);
            let [here, there] = [seen, of_capture].map(|n| 100.0 * n as f64 / all.max(1) as f64);
            ensure!(
                there < here + 100.0 * MORE_IN_VIEW,
                "{}: {here:.0} % of its Gaussians lie in the view of a training keyframe, and {there:.0} % if they are in the frame of the capture, before its import \
                 turned, scaled or moved it\n  help: the file must be in the data set's world (metres, z up): train the other program on the folder optical/, or import \
                 the capture without --up, --scale and any other change of frame",
                self.file.display()
            );
            note!(
                "{}: taken to be in the data set's world, which is turned, scaled or moved against the capture's frame",
                self.file.display()
            );
        }
        ensure!(
            seen > 0,
            "{}: none of its {all} Gaussians lies in the view of a training keyframe\n  help: the file must be in the data set's frame (metres, z up): \
             train the other program on the folder optical/ and switch off its centring, scaling and turning of the world",
            self.file.display()
        );
        let share = seen as f64 / all as f64;
        if share < LITTLE_IN_VIEW {
            note!(
                "{}: only {:.0} % of its Gaussians lie in the view of a training keyframe; is it in the data set's frame (metres, z up)?",
                self.file.display(),
                100.0 * share
            );
        }
        Ok(())
    }

    /// Says how the file differs from what the method works with.
    pub fn report(&self, method: &str, (sh_degree, key): (usize, Option<&str>), antialias: Antialias) {
        let (file, theirs) = (self.file.display(), self.field.gaussians.appearance.sh_degree);
        note!("{method}: begins with {} of {file}", counted(self.field.gaussians.position.len(), "Gaussian"));
        if self.field.filter_3d {
            note!("{method}: the 3D filter of its column filter_3D was applied to scales and opacities, as Mip-Splatting does");
        }
        if let Some([x, y, z]) = self.field.up.filter(|up| up[2] <= up[0].abs().max(up[1].abs())) {
            note!("{method}: its header says that ({x}, {y}, {z}) is up, and in the data set's frame z is");
        }
        if let Some(first) = self.field.unread.first() {
            let more = self.field.unread.len() - 1;
            let others = if more > 0 { format!(" and {}", counted(more, "more column")) } else { String::new() };
            note!("{method}: its column {first}{others} was not read");
        }
        if theirs > sh_degree {
            note!(
                "{method}: its harmonics of degree {} to {theirs} are left out, for the field's degree is {sh_degree}{}",
                sh_degree + 1,
                key.map_or(String::new(), |key| format!("; --set {key}={theirs} keeps them"))
            );
        }
        let (ours, says) = (antialias != Antialias::Off, self.field.antialiased);
        if ours != says.unwrap_or(false) {
            let trained = match says {
                Some(true) => "its header says that it was trained with antialiasing, and it is drawn without",
                Some(false) => "its header says that it was trained without antialiasing, and it is drawn with it",
                None => "its header does not say that it was trained with antialiasing, and it is drawn with it",
            };
            note!("{method}: {trained}; if so, it is some dB off before training makes up for it");
        }
    }

    /// The file's Gaussians with RF attributes; channels and degrees are those of `none`.
    ///
    /// # Errors
    /// A spectrum that cannot be read.
    pub fn coupled(&self, none: Gaussians, target: RadioTarget, training: &TrainingSet<'_>) -> Result<Gaussians> {
        let mut views = vec![];
        if let Some(range) = training.db_range() {
            for (k, world_from_camera) in training.poses().into_iter().enumerate() {
                views.push(RadioView { world_from_camera, radio: target.encode(&training.spectrum_of(k)?, &range) });
            }
        }
        Ok(coupled(&self.field.gaussians, none, &views, &training.radio_camera(), target.floor_color()))
    }
}
