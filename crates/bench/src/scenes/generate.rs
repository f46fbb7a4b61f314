//! `lobby.glb + lobby.toml → raytrace at each pose → keyframes`: the world seen by both sensors, frame by frame.

use crate::run::claim_output;
use crate::scenes::in_use;
use crate::scenes::oidn::Oidn;
use crate::terminal::interrupt;
use crate::terminal::messages;
use crate::terminal::progress::Progress;
use anyhow::{Result, bail};
use corf_raytrace::bvh::Bvh;
use corf_raytrace::light::LightTracer;
use corf_raytrace::radio::RadioTracer;
pub use corf_raytrace::sensor::diffuse_settings;
use corf_raytrace::sensor::{Denoise, Extent, OpticalSensor, Outputs, Platform, RadioSensor, SensorPlan, geometry_warnings};
use corf_scene::config::{DatasetConfig, SceneConfig};
use corf_scene::dataset::{self, Dataset, DatasetHeader, DatasetWriter, FrameData};
use corf_scene::trajectory::TrajectoryPose;
use corf_scene::{Error, Finding, Scene, Severity, bounds, radio_check};
use rayon::prelude::*;
use std::path::Path;
use std::sync::Mutex;

/// A dataset, and what is to be said of it.
pub struct Generated {
    /// The finished dataset.
    pub dataset: Dataset,
    /// Warnings: black images, empty depth.
    pub findings: Vec<Finding>,
}

/// Options of the generation of a dataset.
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
    let scene = in_use::load(&scene_config)?;
    generate_from(config, &scene_config, &scene, out, options)
}

/// [`generate`] of a scene in memory.
///
/// # Errors
/// Those of [`generate`].
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
    let denoiser = Oidn::asked_for(config)?;
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
    let array = RadioSensor::new(&plan, scene, &tracer)?;
    messages::findings(array.check(header.poses.iter().map(|pose| &pose.world_from_camera))?);
    let _held = claim_output(out, resume)?;
    messages::findings(placement);
    messages::findings(geometry_warnings(scene, config.rf.transmission));
    let light = LightTracer::new(scene, &bvh);
    let mut camera = camera(config, &light, denoiser)?;
    let exposure_ev = match config.optical.exposure_ev {
        Some(exposure_ev) => exposure_ev,
        None => f64::from(camera.meter(&header.poses)?),
    };
    header.exposure_ev = Some(exposure_ev);
    camera.expose(exposure_ev as f32);
    header.sampling_error = array.sampling_error(&header.rf_camera, &header.poses)?;
    let outputs = Outputs {
        extent: Extent::of_keyframe(&config.rf, &plan.receiver),
        camera: header.rf_camera,
        sphere: header.sphere,
        paths: config.rf.write_paths,
    };
    let platform = Platform { camera, array, outputs };
    let writer = DatasetWriter::create(out, &header, resume)?;
    let poses = &header.poses;
    let missing: Vec<&TrajectoryPose> = poses.iter().filter(|p| !writer.is_complete(p.index)).collect();
    if !missing.is_empty() {
        let mut progress = Progress::start(format!("keyframes of {}", config.name), poses.len(), "keyframes");
        let mut done = poses.len() - missing.len();
        // Keyframes are written while the next are traced.
        let mut traced: Vec<(usize, FrameData)> = Vec::new();
        let write = |traced: &[(usize, FrameData)]| traced.par_iter().try_for_each(|(i, frame)| writer.write_frame(*i, frame));
        let trace = |pose: &&TrajectoryPose| Ok((pose.index, platform.keyframe(pose)?));
        for together in missing.chunks(keyframes_at_once()) {
            interrupt::check()?;
            let (written, frames) =
                rayon::join(|| write(&traced), || together.par_iter().map(trace).collect::<corf_scene::Result<Vec<_>>>());
            written?;
            done += traced.len();
            traced = frames?;
            progress.set(done, poses.len());
        }
        write(&traced)?;
        progress.set(poses.len(), poses.len());
        progress.finish();
    }
    let findings = writer.dark_findings()?;
    writer.finish()?;
    tell(Generated { dataset: Dataset::open(out)?, findings })
}

/// A dataset's camera, ready: with cached light the scene's is solved, under a progress bar.
///
/// # Errors
/// An interrupt.
pub fn camera<'a>(config: &DatasetConfig, tracer: &'a LightTracer<'a>, denoiser: Option<Oidn>) -> Result<OpticalSensor<'a>> {
    let progress = Mutex::new(Progress::start(format!("light of {}", config.name), 1, "tiles"));
    let tell = |done: usize, all: usize| {
        if let Ok(mut progress) = progress.lock() {
            progress.set(done, all);
        }
        interrupt::check().is_ok()
    };
    let denoiser = denoiser.map(|filter| Box::new(filter) as Box<dyn Denoise>);
    let Some(camera) = OpticalSensor::new(config, tracer, denoiser, &tell) else {
        interrupt::check()?;
        bail!("the light of {} was not solved", config.name);
    };
    if let Ok(progress) = progress.into_inner() {
        progress.finish();
    }
    Ok(camera)
}

/// Keyframes traced together: what one of them leaves of many processors idle is used by the others, and few take little memory.
fn keyframes_at_once() -> usize {
    (rayon::current_num_threads() / THREADS_A_KEYFRAME).clamp(1, MOST_AT_ONCE)
}

/// Threads that a single keyframe keeps busy.
const THREADS_A_KEYFRAME: usize = 8;
/// Most keyframes traced together; at 1600×900 each takes some 0.4 GB until it is written.
const MOST_AT_ONCE: usize = 8;

/// Says what is to be said.
fn tell(generated: Generated) -> Result<Generated> {
    messages::findings(&generated.findings);
    Ok(generated)
}

/// Memory of a keyframe's images while they are rendered, filtered and written, bytes a pixel.
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
        let bytes = keyframes_at_once() as f64 * bytes_a_pixel * columns as f64 * rows as f64;
        bounds::memory(&place, &format!("images of {columns}x{rows} pixels"), bytes, "give fewer pixels")?;
    }
    Ok(())
}
