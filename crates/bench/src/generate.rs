//! `lobby.glb + lobby.toml → raytrace at each pose → keyframes`: the world seen by both sensors, frame by frame.

use crate::interrupt;
use crate::note;
use crate::oidn::Oidn;
use crate::optical_sensor::OpticalSensor;
use crate::progress::Progress;
pub use crate::radio_sensor::diffuse_settings;
use crate::radio_sensor::{Extent, Outputs, RadioSensor, SensorPlan, warn_of_geometry};
use crate::run::claim_output;
use anyhow::{Result, bail};
use corf_raytrace::bvh::Bvh;
use corf_raytrace::light::LightTracer;
use corf_raytrace::radio::RadioTracer;
use corf_scene::config::{DatasetConfig, SceneConfig};
use corf_scene::dataset::{self, Dataset, DatasetHeader, DatasetWriter, FrameData};
use corf_scene::trajectory::TrajectoryPose;
use corf_scene::{Error, Finding, Scene, Severity, bounds, radio_check};
use std::path::Path;

/// A dataset, and what is to be said of it.
pub struct Generated {
    /// The finished dataset.
    pub dataset: Dataset,
    /// Warnings: black images, empty depth.
    pub findings: Vec<Finding>,
}

/// How to generate.
#[derive(Clone, Copy, Debug, Default)]
pub struct Options {
    /// Go on in a folder that holds some of it.
    pub resume: bool,
    /// Refuse what would otherwise be a warning about where transmitter and platform stand.
    pub strict: bool,
}

/// Generates a dataset, or what is missing of one.
///
/// # Errors
/// A scene that cannot be read or traced, an occupied or unwritable folder, an interrupt.
pub fn generate(config: &DatasetConfig, out: &Path, options: Options) -> Result<Generated> {
    let scene_config = config.load_scene_config()?;
    let (scene, left_out) = scene_config.load_scene_with_findings()?;
    left_out.iter().for_each(|finding| note!("{finding}"));
    generate_from(config, &scene_config, &scene, out, options)
}

/// [`generate`] of a scene in memory.
///
/// # Errors
/// As [`generate`].
pub fn generate_from(
    config: &DatasetConfig,
    scene_config: &SceneConfig,
    scene: &Scene,
    out: &Path,
    Options { resume, strict }: Options,
) -> Result<Generated> {
    scene_config.check_radio(scene)?;
    let placement = radio_check::placement_findings(scene_config, scene);
    let unwanted = |f: &&Finding| f.severity == Severity::Error || strict && f.severity == Severity::Warning;
    if let Some(Finding { place, what, help, .. }) = placement.iter().find(unwanted) {
        return Err(Error::invalid(place, what, help).into());
    }
    check_memory(config)?;
    let plan = SensorPlan::of(config, scene_config)?;
    let mut header = DatasetHeader::from_configs(config, scene_config, scene, 0.0)?;
    let denoiser = OpticalSensor::denoiser(config)?;
    header.denoiser = denoiser.as_ref().map(Oidn::name);
    if out.join("dataset.json").exists() {
        let _held = claim_output(out, resume)?;
        dataset::check_finished(out, &header)?;
        let findings = dataset::validate(out)?;
        if let Some(finding) = findings.iter().find(|f| f.severity == Severity::Error) {
            bail!("{finding}\n  help: the finished dataset in {} is damaged: generate it anew elsewhere", out.display());
        }
        return tell(Generated { dataset: Dataset::open(out)?, findings });
    }
    // Whatever can be refused is refused before the first file.
    let bvh = Bvh::build(scene);
    let tracer = RadioTracer::new(scene, &bvh, plan.tracing)?;
    let ear = RadioSensor::new(&plan, scene, &tracer)?;
    ear.check_distances(header.poses.iter().map(|pose| &pose.world_from_camera))?;
    let _held = claim_output(out, resume)?;
    placement.iter().for_each(|finding| note!("{finding}"));
    if config.rf.transmission {
        warn_of_geometry(scene);
    }
    let light = LightTracer::new(scene, &bvh);
    let mut camera = OpticalSensor::new(config, &light, denoiser)?;
    if config.optical.exposure_ev.is_none() {
        header.exposure_ev = f64::from(camera.meter(&header.poses)?);
    }
    camera.expose(header.exposure_ev as f32);
    header.sampling_error = ear.sampling_error(&header.rf_camera, &header.poses)?;
    if config.rf.tutorial_compat {
        header.tutorial_range = ear.tutorial_range(&header.poses)?;
    }
    let outputs = Outputs {
        extent: Extent::of_keyframe(&config.rf, &plan.receiver),
        camera: header.rf_camera,
        sphere: header.sphere,
        tutorial: header.tutorial_range,
        paths: config.rf.write_paths,
    };
    let writer = DatasetWriter::create(out, &header, resume)?;
    let poses = &header.poses;
    let missing: Vec<&TrajectoryPose> = poses.iter().filter(|p| !writer.is_complete(p.index)).collect();
    if !missing.is_empty() {
        let mut progress = Progress::start(format!("keyframes of {}", config.name), poses.len(), "keyframes");
        let done_before = poses.len() - missing.len();
        // One keyframe is written while the next is traced.
        let mut traced: Option<(usize, FrameData)> = None;
        for (i, pose) in missing.iter().enumerate() {
            interrupt::check()?;
            let write = || traced.take().map_or(Ok(()), |(index, frame)| writer.write_frame(index, &frame));
            // Where one of them leaves a core idle, the others go on.
            let (written, (seen, heard)) =
                rayon::join(write, || rayon::join(|| camera.see(pose), || ear.keyframe(&pose.world_from_camera, &outputs)));
            written?;
            let (seen, heard) = (seen?, heard?);
            let frame = FrameData {
                spectrum: heard.spectrum,
                sphere: heard.sphere,
                tutorial: heard.tutorial,
                share_in_frame: Some(heard.share_in_frame),
                paths_jsonl: heard.paths_jsonl,
                ..seen
            };
            traced = Some((pose.index, frame));
            progress.set(done_before + i, poses.len());
        }
        if let Some((index, frame)) = traced {
            writer.write_frame(index, &frame)?;
        }
        progress.set(poses.len(), poses.len());
        progress.finish();
    }
    let findings = writer.dark_findings()?;
    writer.finish()?;
    tell(Generated { dataset: Dataset::open(out)?, findings })
}

/// Says what is to be said.
fn tell(generated: Generated) -> Result<Generated> {
    generated.findings.iter().for_each(|finding| note!("{finding}"));
    Ok(generated)
}

/// What a keyframe's images take while they are rendered, filtered and written, bytes a pixel.
const OPTICAL_BYTES_A_PIXEL: f64 = 300.0;
const RF_BYTES_A_PIXEL: f64 = 120.0;

/// Refuses images that do not fit the memory.
fn check_memory(config: &DatasetConfig) -> Result<()> {
    let [sphere_columns, sphere_rows] = config.rf.sphere.unwrap_or([0, 0]);
    for (key, columns, rows, bytes_a_pixel) in [
        ("optical", config.optical.width, config.optical.height, OPTICAL_BYTES_A_PIXEL),
        ("rf", config.rf.width, config.rf.height, RF_BYTES_A_PIXEL),
        ("rf.sphere", sphere_columns, sphere_rows, RF_BYTES_A_PIXEL),
    ] {
        let place = format!("{}: {key}", config.source.display());
        let bytes = bytes_a_pixel * columns as f64 * rows as f64;
        bounds::memory(&place, &format!("images of {columns}x{rows} pixels"), bytes, "give fewer pixels")?;
    }
    Ok(())
}
