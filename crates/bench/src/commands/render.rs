//! `corf render`: a reconstructed field at any poses.

use super::open_flags::OpenFlags;
use super::{Verdict, show};
use crate::charts::{self, ColourMap, Sensors};
use crate::files::json;
use crate::files::separation::{Reads, keep_apart};
use crate::record::prediction_folder::write_views;
use crate::render::poses::{self, PoseFile, PoseFrame};
use crate::render::video::Video;
use crate::run::claim_output;
use crate::run::open::OpenRun;
use crate::terminal::interrupt;
use crate::terminal::progress::Progress;
use crate::uncertainty::{Calibration, TrainingKeyframes};
use anyhow::{Context, Result, bail, ensure};
use clap::{Args, ValueEnum};
use corf_scene::color::quantize8;
use corf_scene::dataset::Dataset;
use corf_scene::io::sha256_hex;
use corf_scene::words::counted;
use corf_scene::{Pinhole, Raster, Rigid3, io};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// `corf render`.
#[derive(Args)]
pub struct Render {
    /// Run folder of `corf reconstruct`.
    run: PathBuf,
    /// Poses: a `trajectory.json` of a dataset, a `transforms.json` (nerfstudio, Blender, Instant-NGP: OpenGL axes, converted), a JSON array of
    /// 4×4 `world_from_camera` matrices by rows, or a .csv or trajectory in TUM's layout as `corf query` takes them, in the dataset's world (or
    /// --poses-in).
    #[arg(long, required_unless_present = "orbit")]
    poses: Option<PathBuf>,
    /// Frame that --poses is in, where the run's dataset was imported and turned, scaled or moved: that of the capture, whose poses are changed as
    /// the import did, or the dataset's world. Default: what the file says, which is `capture` for the file that was imported and `world` for files
    /// of the dataset; a file of which it cannot be known is refused.
    #[arg(long, value_enum, requires = "poses", conflicts_with = "orbit")]
    poses_in: Option<PoseFrame>,
    /// N poses on a circle instead: around the middle of the dataset's keyframes, at their mean height, looking inwards; or about --keyframe.
    #[arg(long, value_name = "N", conflicts_with = "poses", value_parser = clap::value_parser!(u64).range(1..=poses::MAX_ORBIT as u64))]
    orbit: Option<u64>,
    /// The circle is about this keyframe (its index in the dataset, from 0), in its image plane, and looks at what is in front of it.
    #[arg(long, value_name = "K", requires = "orbit", conflicts_with = "poses")]
    keyframe: Option<usize>,
    /// Radius of the circle, metres (default: the median distance of the keyframes from their middle; about a keyframe 0.3).
    #[arg(long, value_name = "M", requires = "orbit", conflicts_with = "poses")]
    radius: Option<f64>,
    /// Size of the images, pixels, instead of the dataset's; spectra keep theirs. The field of view stays, unless --fov gives another.
    #[arg(long, value_name = "WIDTHxHEIGHT", value_parser = size)]
    size: Option<(usize, usize)>,
    /// Full horizontal field of view of the images, degrees, with square pixels and the axis in the middle.
    #[arg(long, value_name = "DEG")]
    fov: Option<f64>,
    /// Make a video of the pictures as well, .mp4 or .gif, by ffmpeg.
    #[arg(long, value_name = "FILE")]
    video: Option<PathBuf>,
    /// Frames per second of the video.
    #[arg(long, value_name = "FPS", default_value_t = 30.0, requires = "video")]
    fps: f64,
    /// Pictures that the video shows (default: images, or jet where there are none).
    #[arg(long, value_enum, requires = "video")]
    video_of: Option<Pictures>,
    /// Write a figure of every pose as well, figures/00001.svg …: image and spectrum with axes in degrees, colour bar and peaks.
    #[arg(long)]
    figures: bool,
    /// Colours of spectra in the figures.
    #[arg(long, value_enum, default_value_t, requires = "figures")]
    colours: ColourMap,
    /// Write the standard deviation of every pixel's decibels as well, std_db/00001.exr …, by this file of `corf uncertainty fit`.
    #[arg(long, value_name = "FILE.json")]
    uncertainty: Option<PathBuf>,
    /// Output folder.
    #[arg(long)]
    out: PathBuf,
    /// Write into a folder that holds renderings already; poses rendered before are skipped.
    #[arg(long)]
    resume: bool,
    #[command(flatten)]
    opened: OpenFlags,
}

/// `render.json`: what the pictures in a folder are of.
#[derive(PartialEq, Serialize, Deserialize)]
struct Source {
    /// SHA-256 of the run's `run.json`.
    run: String,
    /// SHA-256 of the pose file, or of the poses of a circle.
    poses: String,
    /// Frame of the pose file, where it is not the dataset's world.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    poses_in: Option<PoseFrame>,
    /// Camera of the images, where it is not the dataset's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[serde(rename = "optical_camera")]
    light_camera: Option<Pinhole>,
    /// SHA-256 of the calibration of standard deviations, where they are written.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    uncertainty: Option<String>,
}

/// Pictures that a video can show.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
enum Pictures {
    /// Light.
    Images,
    /// Spectra in the colours of Jet.
    Jet,
}

impl Pictures {
    /// Their folder.
    fn folder(self) -> &'static str {
        match self {
            Self::Images => "images",
            Self::Jet => "jet",
        }
    }
}

/// Distance at which a circle about a keyframe looks where the field shows nothing there, metres.
const UNKNOWN_DISTANCE_M: f64 = 3.0;
/// Radius of a circle about a keyframe, metres.
const KEYFRAME_RADIUS_M: f64 = 0.3;

fn size(text: &str) -> Result<(usize, usize), String> {
    let side = |t: &str| t.trim().parse::<usize>().ok().filter(|n| (8..=16_384).contains(n));
    match text.split_once(['x', 'X']).map(|(w, h)| (side(w), side(h))) {
        Some((Some(width), Some(height))) => Ok((width, height)),
        _ => Err(format!("\"{text}\" is not WIDTHxHEIGHT with 8 to 16384 pixels a side")),
    }
}

impl Render {
    /// Runs the command.
    ///
    /// # Errors
    /// Bad poses, a run that cannot be read, an occupied output folder.
    pub fn run(self, json: bool) -> Result<Verdict> {
        let of_file = self.poses.as_deref().map(PoseFile::read).transpose()?;
        if let Some(radius) = self.radius.filter(|r| !(1e-3..=1e5).contains(r)) {
            bail!("--radius {radius} is no radius\n  help: give metres, e.g. 2");
        }
        let video = self.video.as_deref().map(|file| Video::plan(file, self.fps)).transpose()?;
        let (mut run, _) = self.opened.open(&self.run)?;
        let mut reads = vec![Reads::Folder(&self.run), Reads::Folder(run.input.dataset.dir())];
        keep_apart("--out", &self.out, &reads)?;
        reads.extend(self.poses.as_deref().map(Reads::File));
        self.video.as_deref().map_or(Ok(()), |file| keep_apart("--video", file, &reads))?;
        let has = run.input.dataset.modalities();
        let pictures = self.video_of.unwrap_or(if has.light { Pictures::Images } else { Pictures::Jet });
        let are_there = if pictures == Pictures::Images { has.light } else { has.radio };
        ensure!(are_there, "--video-of {}: the run has none\n  help: choose the other ones", pictures.folder());
        let (poses, poses_sha256, frame) = match of_file {
            Some(file) => {
                let sha256 = file.sha256().to_owned();
                let (poses, frame) = file.in_world_of(&run.input.dataset, self.poses_in)?;
                (poses, sha256, frame)
            }
            None => {
                let poses = self.circle(&mut run)?;
                let sha256 = sha256_hex(&serde_json::to_vec(&poses.iter().map(Rigid3::to_rows).collect::<Vec<_>>())?);
                (poses, sha256, PoseFrame::World)
            }
        };
        let judge = self.uncertainty.as_deref().map(|file| judge(file, &mut run)).transpose()?;
        let camera = self.camera(&run.input.dataset)?;
        if let Some(camera) = camera {
            ensure!(has.light, "--size and --fov are of images, and the run has none\n  help: leave them out");
            run.predictor.set_light_camera(camera)?;
        }
        let _held = claim_output(&self.out, self.resume)?;
        let source = Source {
            run: sha256_hex(&io::read(self.run.join("run.json"))?),
            poses: poses_sha256,
            poses_in: Some(frame).filter(|frame| *frame != PoseFrame::World),
            light_camera: camera,
            uncertainty: self
                .uncertainty
                .as_deref()
                .map(|file| Ok::<_, anyhow::Error>(sha256_hex(&io::read(file)?)))
                .transpose()?,
        };
        let source_path = self.out.join("render.json");
        if source_path.exists() {
            let before: Source = json::read_json(&source_path)?;
            ensure!(
                before == source,
                "{} holds renderings of another run, other poses or another camera\n  help: choose another --out",
                self.out.display()
            );
        }
        json::write_json(&source_path, &source)?;
        write_views(&self.out, &poses)?;
        let range = run.input.dataset.db_range();
        let own = Sensors::of(&run.input.dataset);
        let sensors = Sensors { light: camera.unwrap_or(own.light), ..own };
        let mut progress = Progress::start("rendering", poses.len(), "views");
        for (i, pose) in poses.iter().enumerate() {
            interrupt::check()?;
            // The Jet image (without radio, the image) is written last: with it a pose is finished.
            let file = |folder: &str, ending: &str| self.out.join(folder).join(format!("{:05}.{ending}", i + 1));
            let [image, jet, figure] = [file("images", "png"), file("jet", "png"), file("figures", "svg")];
            let last = if has.radio { &jet } else { &image };
            if !last.exists() || self.figures && !figure.exists() {
                let p = run.predictor.render(pose)?.within(has);
                ensure!(
                    p.is_finite(),
                    "pose {i}: a pixel of the rendering is not a finite number\n  help: the field has diverged; reconstruct it with smaller rates"
                );
                if self.figures {
                    let title = format!("{}, pose {} of {}", run.info.method, i + 1, poses.len());
                    io::write_atomic(&figure, charts::prediction(&title, p.halves(), &sensors, self.colours)?.as_bytes())?;
                }
                if let Some(depth) = &p.depth_m {
                    write_exr(&file("depth", "exr"), depth)?;
                }
                if let Some(predicted) = &p.image {
                    io::write_png(&image, &predicted.map(|c| c.map(quantize8)))?;
                }
                if let (Some(radio), Some((calibration, surroundings))) = (&p.radio, &judge) {
                    let deviations = calibration.deviations_db(&surroundings.signs(pose, &radio.scalar)?);
                    let deviations = deviations.iter().map(|d| *d as f32).collect();
                    let raster = Raster::from_vec(radio.scalar.width(), radio.scalar.height(), deviations);
                    write_exr(&file("std_db", "exr"), &raster)?;
                }
                if let (Some(radio), Some(range)) = (&p.radio, &range) {
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
        let mut text = format!("{} in {}", counted(poses.len(), "view"), self.out.display());
        if let (Some(video), Some(file)) = (video, &self.video) {
            video.encode(&self.out.join(pictures.folder()), poses.len())?;
            text += &format!(", and as a video in {}", file.display());
        }
        show(
            json,
            &serde_json::json!({ "rendered": poses.len(), "out": self.out, "video": self.video, "poses_in": frame }),
            &text,
        )?;
        Ok(Verdict::Done)
    }

    /// The poses of the circle.
    fn circle(&self, run: &mut OpenRun) -> Result<Vec<Rigid3>> {
        let keyframes: Vec<Rigid3> = run.input.dataset.poses().iter().map(|p| p.world_from_camera).collect();
        let count = usize::try_from(self.orbit.unwrap_or(1))?;
        let Some(k) = self.keyframe else { return Ok(poses::around_keyframes(&keyframes, count, self.radius)) };
        let keyframe = keyframes
            .get(k)
            .with_context(|| format!("--keyframe {k}: the dataset has {}\n  help: indices count from 0", keyframes.len()))?;
        let depth = run.predictor.render(keyframe)?.depth_m;
        let mut seen: Vec<f32> = depth.iter().flat_map(|d| d.pixels()).copied().filter(|d| *d > 0.0 && d.is_finite()).collect();
        seen.sort_by(f32::total_cmp);
        let distance_m = seen.get(seen.len() / 2).map_or(UNKNOWN_DISTANCE_M, |d| f64::from(*d));
        Ok(poses::about_keyframe(keyframe, count, self.radius.unwrap_or(KEYFRAME_RADIUS_M), distance_m))
    }

    /// The camera of the images, where it is another than the dataset's.
    fn camera(&self, dataset: &Dataset) -> Result<Option<Pinhole>> {
        let own = dataset.light_camera();
        if let Some(fov) = self.fov.filter(|f| !(1.0..=170.0).contains(f)) {
            bail!("--fov {fov} is no field of view\n  help: give 1 to 170 degrees");
        }
        let (width, height) = self.size.unwrap_or((own.width, own.height));
        Ok(match (self.size, self.fov) {
            (None, None) => None,
            (_, Some(fov)) => Some(Pinhole::from_horizontal_fov(width, height, fov)),
            // The same view across, with the pixels' own shape.
            (Some(_), None) => {
                let scale = width as f64 / own.width as f64;
                let (fx, fy) = (own.fx * scale, own.fy * scale);
                let [right, down] = [own.cx / own.width as f64, own.cy / own.height as f64];
                Some(Pinhole { width, height, fx, fy, cx: right * width as f64, cy: down * height as f64 })
            }
        })
    }
}

/// What standard deviations at a pose of a run follow from: a calibration, and the errors at the run's training keyframes.
fn judge(file: &Path, run: &mut OpenRun) -> Result<(Calibration, TrainingKeyframes)> {
    let calibration = Calibration::read(file, &run.info.method)?;
    let predictor = run.predictor.as_mut();
    let surroundings = TrainingKeyframes::of(&run.input.dataset, &run.split.train, |pose| {
        interrupt::check()?;
        Ok(predictor.render(pose)?.radio.context("the method predicts no spectra")?.scalar)
    })?;
    Ok((calibration, surroundings))
}

/// One f32 channel as EXR.
fn write_exr(path: &Path, image: &Raster<f32>) -> Result<()> {
    Ok(io::write_atomic(path, &io::encode_exr_f32(image, "Y")?)?)
}
