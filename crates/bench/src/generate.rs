//! `lobby.glb + lobby.toml → raytrace at each pose → keyframes`: the world seen by both sensors, frame by frame.

use crate::interrupt;
use crate::progress::Progress;
use crate::run::claim_output;
use anyhow::{Result, bail};
use corf_raytrace::bvh::Bvh;
use corf_raytrace::light::{self, DenoiseSettings, LightFrame, LightSettings, LightTracer};
use corf_raytrace::radio::{
    Antenna, Arrival, DiffuseField, DiffuseSettings, Path as RadioPath, PlanarArray, RadioSettings, RadioTracer, Search,
    Transmitter, json,
};
use corf_raytrace::spectrum::SpectrumSettings;
use corf_scene::config::{AntennaPattern, DatasetConfig, RfConfig, SceneConfig};
use corf_scene::dataset::{self, Dataset, DatasetHeader, DatasetWriter, FrameData};
use corf_scene::trajectory::TrajectoryPose;
use corf_scene::{Pinhole, Raster, Rigid3, Scene, Severity};
use glam::{DMat3, DVec3};
use std::path::Path;

/// Generates a dataset, or what is missing of one.
///
/// # Errors
/// A scene that cannot be read or traced, an occupied or unwritable folder, an interrupt.
pub fn generate(config: &DatasetConfig, out: &Path, resume: bool) -> Result<Dataset> {
    let scene_config = config.load_scene_config()?;
    let scene = scene_config.load_scene()?;
    generate_from(config, &scene_config, &scene, out, resume)
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
    resume: bool,
) -> Result<Dataset> {
    scene_config.check_radio(scene)?;
    scene_config.check_placement(scene)?;
    let bvh = Bvh::build(scene);
    // Whatever can be refused is refused before the first file.
    let settings = RadioSettings {
        max_depth: config.rf.max_reflections,
        search: Search::Auto { rays: config.rf.rays },
        transmission: config.rf.transmission,
        ..radio_settings(scene_config)
    };
    let tracer = RadioTracer::new(scene, &bvh, settings)?;
    let ear = RadioSensor::new(config, scene_config, scene, &tracer)?;
    claim_output(out, resume)?;
    if out.join("dataset.json").exists() {
        let broken = dataset::validate(out)?.into_iter().find(|f| f.severity == Severity::Error);
        if let Some(finding) = broken {
            bail!("{finding}\n  help: the finished dataset in {} is damaged: generate it anew elsewhere", out.display());
        }
        return Ok(Dataset::open(out)?);
    }
    let mut camera = Camera::new(config, scene, &bvh);
    let mut header = DatasetHeader::from_configs(config, scene_config, scene, 0.0)?;
    if config.optical.exposure_ev.is_none() {
        header.exposure_ev = f64::from(camera.meter(&header.poses));
    }
    camera.exposure_ev = header.exposure_ev as f32;
    let writer = DatasetWriter::create(out, &header, resume)?;
    let poses = &header.poses;
    let missing: Vec<&TrajectoryPose> = poses.iter().filter(|p| !writer.is_complete(p.index)).collect();
    if !missing.is_empty() {
        let mut progress = Progress::start(format!("keyframes of {}", config.name), poses.len(), "keyframes");
        let done_before = poses.len() - missing.len();
        for (i, pose) in missing.iter().enumerate() {
            interrupt::check()?;
            let seen = camera.see(pose);
            let (spectrum, paths_jsonl) = ear.hear(&pose.world_from_camera)?;
            let frame = FrameData { spectrum, paths_jsonl, ..seen };
            writer.write_frame(pose.index, &frame)?;
            progress.set(done_before + i + 1, poses.len());
        }
        progress.finish();
    }
    writer.finish()?;
    Ok(Dataset::open(out)?)
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
const METERED_SAMPLES: u32 = 16;
/// What the geometric mean of the metered radiance becomes, as a share of full scale: photography's middle grey, a little up for a
/// room whose walls are light.
const MIDDLE_GREY: f32 = 0.24;
/// A path's indirect light is limited to this radiance: a few times what the brightest diffuse surface of a lit room has.
const INDIRECT_LIMIT: f32 = 8.0;

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
    fn meter(&self, poses: &[TrajectoryPose]) -> f32 {
        let shrink = METERED_WIDTH as f64 / self.intrinsics.width as f64;
        let height = ((self.intrinsics.height as f64 * shrink) as usize).max(1);
        let fov_deg = 2.0 * (0.5 * self.intrinsics.width as f64 / self.intrinsics.fx).atan().to_degrees();
        let small = Pinhole::from_horizontal_fov(METERED_WIDTH, height, fov_deg);
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
        ((MIDDLE_GREY / mean).log2() * 100.0).round() / 100.0
    }

    /// A keyframe without its spectrum.
    fn see(&self, pose: &TrajectoryPose) -> FrameData {
        let frame: LightFrame = self.tracer.render(&self.intrinsics, &pose.world_from_camera, &self.settings, frame_key(pose));
        let radiance = if self.denoise { light::denoise(&frame, &DenoiseSettings::default()) } else { frame.radiance };
        FrameData {
            image: light::develop(&radiance, self.exposure_ev),
            linear: self.write_linear.then_some(radiance),
            depth_m: Some(frame.depth_m),
            surface: Some(frame.surface),
            spectrum: Raster::filled(0, 0, 0.0),
            paths_jsonl: None,
        }
    }
}

fn frame_key(pose: &TrajectoryPose) -> u64 {
    pose.index as u64
}

/// Carrier and antennas of a scene; everything else as by default. The receive element stands in the world's own axes: what turns with
/// the platform is asked for where the platform is.
pub fn radio_settings(scene: &SceneConfig) -> RadioSettings {
    RadioSettings {
        frequency_hz: scene.radio.frequency_hz,
        tx_antenna: Antenna::from(&scene.transmitter),
        rx_antenna: Antenna::element_of(&scene.receiver, DMat3::IDENTITY),
        ..RadioSettings::default()
    }
}

/// How a dataset samples the diffuse field.
pub fn diffuse_settings(rf: &RfConfig) -> DiffuseSettings {
    DiffuseSettings {
        patch_size_m: rf.patch_size_m,
        directions: rf.directions,
        photons: rf.photons,
        ..DiffuseSettings::default()
    }
}

/// The RF half of a keyframe.
struct RadioSensor<'a> {
    scene: &'a Scene,
    transmitter: Transmitter<'a, 'a>,
    diffuse: Option<DiffuseField<'a, 'a>>,
    intrinsics: Pinhole,
    spectrum: SpectrumSettings,
    frequency_hz: f64,
    write_paths: bool,
}

impl<'a> RadioSensor<'a> {
    fn new(config: &DatasetConfig, scene_config: &SceneConfig, scene: &'a Scene, tracer: &'a RadioTracer<'a>) -> Result<Self> {
        let receiver = &scene_config.receiver;
        if receiver.pattern != AntennaPattern::Iso || PlanarArray::from(receiver) != PlanarArray::default() {
            bail!(
                "{}: [receiver]: spectra are formed with 8 x 8 isotropic elements half a wavelength apart\n  help: remove its keys",
                scene_config.source.display()
            );
        }
        let tx = scene_config.transmitter.position();
        let settings = diffuse_settings(&config.rf);
        Ok(Self {
            scene,
            transmitter: tracer.transmitter(tx)?,
            diffuse: config.rf.diffuse.then(|| DiffuseField::new(tracer, tx, &settings)).transpose()?,
            intrinsics: config.rf_camera(),
            spectrum: SpectrumSettings::new(&config.rf, receiver, config.seed),
            frequency_hz: scene_config.radio.frequency_hz,
            write_paths: config.rf.write_paths,
        })
    }

    /// The spectrum at a pose (one path set per position), and its paths as JSON lines where they are wanted.
    fn hear(&self, world_from_camera: &Rigid3) -> Result<(Raster<f32>, Option<String>)> {
        let rx = world_from_camera.translation;
        let paths = self.transmitter.paths(rx)?;
        let mut arrivals: Vec<Arrival> = paths.iter().map(|p| Arrival::from_path(p, self.frequency_hz)).collect();
        if let Some(diffuse) = &self.diffuse {
            arrivals.extend(diffuse.gather_for_view(&self.intrinsics, world_from_camera)?);
        }
        let spectrum = self.spectrum.form(&[arrivals], &self.intrinsics, world_from_camera);
        let lines = self.write_paths.then(|| json_lines(self.scene, self.transmitter.position(), rx, self.frequency_hz, &paths));
        Ok((spectrum, lines))
    }
}

/// Every path as one JSON object a line.
fn json_lines(scene: &Scene, tx: DVec3, rx: DVec3, frequency_hz: f64, paths: &[RadioPath]) -> String {
    let all = json::paths_to_json(scene, frequency_hz, tx, rx, paths);
    let list = all["paths"].as_array().map(Vec::as_slice).unwrap_or_default();
    list.iter().map(|p| format!("{p}\n")).collect()
}
