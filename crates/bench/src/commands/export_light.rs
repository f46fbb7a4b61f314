//! `corf scene export --to mitsuba`: the scene's light, and the views to render it from.

use super::{Verdict, show};
use crate::note;
use crate::render::poses::PoseFile;
use anyhow::{Result, bail, ensure};
use clap::Args;
use corf_scene::config::{DatasetConfig, SceneConfig};
use corf_scene::export::mitsuba::{self, MitsubaSummary, Views};
use corf_scene::words::counted;
use corf_scene::{Pinhole, Rigid3, Scene, trajectory};
use std::path::Path;

/// The camera where no dataset says it.
const DEFAULT_CAMERA: (usize, usize, f64) = (1600, 900, 90.0);

/// Mitsuba's sensors.
#[derive(Args)]
pub struct LightViews {
    /// Columns of every view [default: the dataset's, or 1600].
    #[arg(long)]
    width: Option<usize>,
    /// Rows of every view [default: the dataset's, or 900].
    #[arg(long)]
    height: Option<usize>,
    /// Full horizontal field of view, degrees [default: the dataset's, or 90].
    #[arg(long)]
    fov: Option<f64>,
}

impl LightViews {
    /// Says that these are not Sionna RT's.
    ///
    /// # Errors
    /// One of them is given.
    pub fn refuse(&self) -> Result<()> {
        let given = self.width.is_some() || self.height.is_some() || self.fov.is_some();
        ensure!(!given, "--width, --height and --fov are of images\n  help: leave them out, or export --to mitsuba");
        Ok(())
    }

    /// The camera and its poses; `None` where none was asked for.
    ///
    /// # Errors
    /// Poses that cannot be read, or a camera that is none.
    pub fn resolve(&self, scene: Option<&SceneConfig>, poses: &str) -> Result<Option<Views>> {
        if poses == "0" {
            return Ok(None);
        }
        let (mut camera, along): (_, Vec<Rigid3>) = match poses.parse::<usize>() {
            Ok(count) => {
                let Some(way) = scene.and_then(|s| s.trajectory.as_ref()) else {
                    bail!(
                        "--poses {count}: the scene has no [trajectory]\n  help: add one, or name a dataset's configuration or a pose file"
                    );
                };
                (DEFAULT_CAMERA, world_from_camera(trajectory::generate(way, count)?))
            }
            Err(_) if poses.to_ascii_lowercase().ends_with(".toml") => {
                let dataset = DatasetConfig::load(poses)?;
                let config = dataset.load_scene_config()?;
                let Some(way) = &config.trajectory else {
                    bail!(
                        "{}: there is no [trajectory]\n  help: add one to the scene that {poses} names",
                        config.source.display()
                    );
                };
                let o = &dataset.light;
                let poses = trajectory::generate_between(way, dataset.keyframes, dataset.way)?;
                ((o.width, o.height, o.horizontal_fov_deg), world_from_camera(poses))
            }
            Err(_) => (DEFAULT_CAMERA, PoseFile::read(Path::new(poses))?.as_they_are()?),
        };
        camera = (self.width.unwrap_or(camera.0), self.height.unwrap_or(camera.1), self.fov.unwrap_or(camera.2));
        let (width, height, fov_deg) = camera;
        let sides = 1..=16_384;
        ensure!(sides.contains(&width) && sides.contains(&height), "{width}x{height} pixels\n  help: give 1 to 16384 a side");
        ensure!(
            (0.01..=179.0).contains(&fov_deg),
            "--fov {fov_deg} is no pinhole's field of view\n  help: give 0.01 to 179 degrees"
        );
        Ok(Some(Views { camera: Pinhole::from_horizontal_fov(width, height, fov_deg), poses: along }))
    }
}

fn world_from_camera(poses: Vec<trajectory::TrajectoryPose>) -> Vec<Rigid3> {
    poses.into_iter().map(|pose| pose.world_from_camera).collect()
}

/// Writes the folder.
///
/// # Errors
/// As [`mitsuba::write`].
pub fn write(scene: &Scene, views: Option<&Views>, folder: &Path) -> Result<MitsubaSummary> {
    let summary = mitsuba::write(scene, views, folder)?;
    summary.approximated.iter().for_each(|what| note!("note: {what}"));
    Ok(summary)
}

/// Says what is in it.
///
/// # Errors
/// Standard output that cannot be written.
pub fn report(summary: &MitsubaSummary, out: &Path, json: bool) -> Result<Verdict> {
    let text = format!(
        "{}: {}, {}, {}, {}, {}, {}",
        out.display(),
        counted(summary.shapes, "shape"),
        counted(summary.materials, "material"),
        counted(summary.textures, "texture"),
        counted(summary.emitters, "emitter"),
        counted(summary.triangles, "triangle"),
        counted(summary.sensors, "sensor")
    );
    show(json, summary, &text)?;
    Ok(Verdict::Done)
}
