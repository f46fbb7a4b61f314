//! `lobby.glb + lobby.toml → raytrace at each pose → keyframes`: the world seen by both sensors, frame by frame.

use crate::interrupt;
use crate::note;
use crate::progress::Progress;
pub use crate::radio_sensor::diffuse_settings;
use crate::radio_sensor::{Extent, Outputs, RadioSensor, SensorPlan, warn_of_geometry};
use crate::run::claim_output;
use anyhow::{Result, bail};
use corf_raytrace::bvh::Bvh;
use corf_raytrace::light::{self, DenoiseSettings, LightFrame, LightSettings, LightTracer};
use corf_raytrace::radio::RadioTracer;
use corf_scene::config::{DatasetConfig, SceneConfig};
use corf_scene::dataset::{self, Dataset, DatasetHeader, DatasetWriter, FrameData};
use corf_scene::trajectory::TrajectoryPose;
use corf_scene::{Error, Finding, Pinhole, Raster, Scene, Severity, bounds, radio_check};
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
    let mut camera = Camera::new(config, scene, &bvh);
    if config.optical.exposure_ev.is_none() {
        header.exposure_ev = f64::from(camera.meter(&header.poses)?);
    }
    camera.exposure_ev = header.exposure_ev as f32;
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
        for (i, pose) in missing.iter().enumerate() {
            interrupt::check()?;
            // Where one of them leaves a core idle, the other goes on.
            let (seen, heard) = rayon::join(|| camera.see(pose), || ear.keyframe(&pose.world_from_camera, &outputs));
            let (seen, heard) = (seen?, heard?);
            let frame = FrameData {
                spectrum: heard.spectrum,
                sphere: heard.sphere,
                tutorial: heard.tutorial,
                share_in_frame: Some(heard.share_in_frame),
                paths_jsonl: heard.paths_jsonl,
                ..seen
            };
            writer.write_frame(pose.index, &frame)?;
            progress.set(done_before + i + 1, poses.len());
        }
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

/// The optical half of a keyframe.
struct Camera<'a> {
    tracer: LightTracer<'a>,
    intrinsics: Pinhole,
    settings: LightSettings,
    denoise: bool,
    write_linear: bool,
    exposure_ev: f32,
}

/// Poses along the trajectory at which the exposure is metered, and the size and samples of each.
const METERED_POSES: usize = 8;
const METERED_WIDTH: usize = 64;
const MAX_METERED_HEIGHT: usize = 512;
const METERED_SAMPLES: u32 = 16;
/// What the geometric mean of the metered radiance becomes, as a share of full scale: photography's middle grey, a little up for a
/// room whose walls are light.
const MIDDLE_GREY: f32 = 0.24;
/// What a path may bring at most by light scattered twice or more: unbounded, so that no light is lost.
const INDIRECT_LIMIT: f32 = f32::INFINITY;

impl<'a> Camera<'a> {
    fn new(config: &DatasetConfig, scene: &'a Scene, bvh: &'a Bvh) -> Self {
        let optical = &config.optical;
        let settings = LightSettings {
            samples_per_pixel: optical.samples_per_pixel,
            max_bounces: optical.max_bounces,
            seed: config.seed,
            indirect_limit: INDIRECT_LIMIT,
            ..LightSettings::default()
        };
        Self {
            tracer: LightTracer::new(scene, bvh),
            intrinsics: config.optical_camera(),
            settings,
            denoise: optical.denoise,
            write_linear: optical.write_linear,
            exposure_ev: optical.exposure_ev.unwrap_or(0.0) as f32,
        }
    }

    /// One exposure for the whole trajectory, EV: brings the geometric mean of what the platform sees to middle grey.
    ///
    /// # Errors
    /// Light that is not a finite number.
    fn meter(&self, poses: &[TrajectoryPose]) -> Result<f32> {
        let (full_width, full_height) = (self.intrinsics.width as f64, self.intrinsics.height as f64);
        let shrink = METERED_WIDTH as f64 / full_width;
        // Images much higher than wide are metered at so many rows, with as few columns as that leaves.
        let (width, height) = if full_height * shrink > MAX_METERED_HEIGHT as f64 {
            ((full_width * MAX_METERED_HEIGHT as f64 / full_height).round().max(1.0) as usize, MAX_METERED_HEIGHT)
        } else {
            (METERED_WIDTH, ((full_height * shrink) as usize).max(1))
        };
        let fov_deg = 2.0 * (0.5 * self.intrinsics.width as f64 / self.intrinsics.fx).atan().to_degrees();
        let small = Pinhole::from_horizontal_fov(width, height, fov_deg);
        let settings = LightSettings { samples_per_pixel: METERED_SAMPLES, ..self.settings };
        let (mut sum, mut n) = (0.0_f64, 0usize);
        for pose in poses.iter().step_by((poses.len() / METERED_POSES).max(1)) {
            let frame = self.tracer.render(&small, &pose.world_from_camera, &settings, frame_key(pose));
            for &rgb in frame.radiance.pixels() {
                sum += f64::from(light::luminance(rgb.into()).max(1e-4).ln());
                n += 1;
            }
        }
        let mean = (sum / n.max(1) as f64).exp() as f32;
        // Hundredths of a stop are finer than anybody sees and read well in dataset.json.
        let exposure_ev = ((MIDDLE_GREY / mean).log2() * 100.0).round() / 100.0;
        if !bounds::EXPOSURE_EV.contains(&f64::from(exposure_ev)) {
            return Err(not_finite("the metered radiance").into());
        }
        Ok(exposure_ev)
    }

    /// A keyframe without its spectrum.
    ///
    /// # Errors
    /// Light that is not a finite number.
    fn see(&self, pose: &TrajectoryPose) -> Result<FrameData> {
        let frame: LightFrame = self.tracer.render(&self.intrinsics, &pose.world_from_camera, &self.settings, frame_key(pose));
        if frame.radiance.pixels().iter().flatten().any(|v| !v.is_finite()) {
            return Err(not_finite(&format!("keyframe {}: the radiance of a pixel", pose.index)).into());
        }
        let radiance = if self.denoise { light::denoise(&frame, &DenoiseSettings::default()) } else { frame.radiance };
        Ok(FrameData {
            image: light::develop(&radiance, self.exposure_ev),
            linear: self.write_linear.then_some(radiance),
            depth_m: Some(frame.depth_m),
            surface: Some(frame.surface),
            spectrum: Raster::filled(0, 0, 0.0),
            sphere: None,
            tutorial: None,
            share_in_frame: None,
            paths_jsonl: None,
        })
    }
}

fn not_finite(what: &str) -> Error {
    Error::invalid("light", format!("{what} is not a finite number"), "check what the scene's materials and lights emit")
}

fn frame_key(pose: &TrajectoryPose) -> u64 {
    pose.index as u64
}
