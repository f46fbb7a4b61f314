//! `corf render`: a reconstructed field at any poses.

use super::{Verdict, show};
use crate::device::DeviceChoice;
use crate::input::Verify;
use crate::methods::open;
use crate::progress::Progress;
use crate::run::claim_output;
use crate::{interrupt, json};
use anyhow::{Context, Result, ensure};
use clap::Args;
use corf_scene::color::quantize8;
use corf_scene::io::sha256_hex;
use corf_scene::{Raster, Rigid3, io};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// `corf render`.
#[derive(Args)]
pub struct Render {
    /// Run folder of `corf reconstruct`.
    run: PathBuf,
    /// Poses: a `trajectory.json` of a dataset, or a JSON array of 4×4 `world_from_camera` matrices by rows.
    #[arg(long)]
    poses: PathBuf,
    /// Output folder.
    #[arg(long)]
    out: PathBuf,
    /// Dataset folder, if it has moved since.
    #[arg(long)]
    dataset: Option<PathBuf>,
    /// Write into a folder that holds renderings already; poses rendered before are skipped.
    #[arg(long)]
    resume: bool,
    #[command(flatten)]
    verify: Verify,
    /// Device that renders the field: auto, cpu, gpu, or gpu:N for the N-th adapter.
    #[arg(long, default_value_t)]
    device: DeviceChoice,
}

/// `render.json`: what the pictures in a folder are of.
#[derive(PartialEq, Serialize, Deserialize)]
struct Source {
    /// SHA-256 of the run's `run.json`.
    run: String,
    /// SHA-256 of the pose file.
    poses: String,
}

#[derive(Deserialize)]
#[serde(untagged)]
enum Poses {
    Matrices(Vec<[[f64; 4]; 4]>),
    Trajectory { keyframes: Vec<TrajectoryEntry> },
}

#[derive(Deserialize)]
struct TrajectoryEntry {
    world_from_camera: [[f64; 4]; 4],
}

/// The `world_from_camera` of every pose of a file.
///
/// # Errors
/// A file that is neither of the two, that names no pose, or one that is no rigid transform.
pub(crate) fn read_poses(path: &Path) -> Result<Vec<Rigid3>> {
    let poses: Poses = json::read_json(path)
        .context("a pose file is a dataset's trajectory.json or a JSON array of 4x4 world_from_camera matrices by rows")?;
    let rows: Vec<[[f64; 4]; 4]> = match poses {
        Poses::Matrices(rows) => rows,
        Poses::Trajectory { keyframes } => keyframes.into_iter().map(|k| k.world_from_camera).collect(),
    };
    ensure!(!rows.is_empty(), "{} names no pose", path.display());
    rows.iter().enumerate().map(|(i, rows)| Ok(Rigid3::from_rows(rows, &format!("{}: pose {i}", path.display()))?)).collect()
}

impl Render {
    /// Runs the command.
    ///
    /// # Errors
    /// Bad poses, a run that cannot be read, an occupied output folder.
    pub fn run(self, json: bool) -> Result<Verdict> {
        let poses = read_poses(&self.poses)?;
        let mut run = open::open(&self.run, self.dataset.as_deref(), self.verify, &self.device.resolve()?)?;
        let _held = claim_output(&self.out, self.resume)?;
        let source =
            Source { run: sha256_hex(&io::read(self.run.join("run.json"))?), poses: sha256_hex(&io::read(&self.poses)?) };
        let source_path = self.out.join("render.json");
        if source_path.exists() {
            let before: Source = json::read_json(&source_path)?;
            ensure!(
                before == source,
                "{} holds renderings of another run or other poses\n  help: choose another --out",
                self.out.display()
            );
        }
        json::write_json(&source_path, &source)?;
        let range = run.input.dataset.db_range();
        let has = run.input.dataset.modalities();
        let light: &[&str] = if has.light { &["images"] } else { &[] };
        let radio: &[&str] = if has.radio { &["jet", "db", "linear"] } else { &[] };
        for folder in light.iter().chain(radio).chain(&["depth"]) {
            std::fs::create_dir_all(self.out.join(folder))
                .with_context(|| format!("cannot create {}/{folder}", self.out.display()))?;
        }
        let mut progress = Progress::start("rendering", poses.len(), "views");
        for (i, pose) in poses.iter().enumerate() {
            interrupt::check()?;
            // The Jet image (without radio, the image) is written last: with it a pose is finished.
            let file = |folder: &str, ending: &str| self.out.join(folder).join(format!("{:05}.{ending}", i + 1));
            let [image, jet] = [file("images", "png"), file("jet", "png")];
            let last = if has.radio { &jet } else { &image };
            if !last.exists() {
                let p = run.predictor.render(pose)?.within(has);
                ensure!(
                    p.is_finite(),
                    "pose {i}: a pixel of the rendering is not a finite number\n  help: the field has diverged; reconstruct it with smaller rates"
                );
                if let Some(depth) = &p.depth_m {
                    write_exr(&file("depth", "exr"), depth)?;
                }
                if let Some(predicted) = &p.image {
                    io::write_png(&image, &predicted.map(|c| c.map(quantize8)))?;
                }
                if let Some(radio) = &p.radio {
                    write_exr(&file("db", "exr"), &radio.scalar.map(|&s| range.db(s) as f32))?;
                    write_exr(
                        &file("linear", "exr"),
                        &radio.scalar.map(|&s| if s > 0.0 { range.linear(s) as f32 } else { 0.0 }),
                    )?;
                    io::write_png(&jet, &radio.jet.map(|c| c.map(quantize8)))?;
                }
            }
            progress.set(i + 1, poses.len());
        }
        progress.finish();
        show(
            json,
            &serde_json::json!({ "rendered": poses.len(), "out": self.out }),
            &format!("{} views in {}", poses.len(), self.out.display()),
        )?;
        Ok(Verdict::Done)
    }
}

/// One f32 channel as EXR.
fn write_exr(path: &Path, image: &Raster<f32>) -> Result<()> {
    Ok(io::write_atomic(path, &io::encode_exr_f32(image, "Y")?)?)
}
