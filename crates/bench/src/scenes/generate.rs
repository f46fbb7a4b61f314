//! `lobby.glb + lobby.toml → raytrace at each pose → keyframes`: the world seen by both sensors, frame by frame.

use crate::device::Backend;
use crate::note;
use crate::run::claim_output;
use crate::scenes::in_use;
use crate::scenes::oidn::Oidn;
use crate::terminal::interrupt;
use crate::terminal::messages;
use crate::terminal::progress::{Progress, Stage};
use anyhow::{Result, bail};
use corf_raytrace::bvh::Bvh;
use corf_raytrace::light::{LightTracer, Spent, Stages};
use corf_raytrace::radio::RadioTracer;
pub use corf_raytrace::sensor::diffuse_settings;
use corf_raytrace::sensor::{
    Denoise, Extent, LightSensor, Outputs, Platform, RadioSensor, SensorPlan, geometry_warnings, heard, joined,
};
use corf_scene::config::{DatasetConfig, SceneConfig};
use corf_scene::dataset::{self, Dataset, DatasetHeader, DatasetWriter, Extras, KeyframeContent, SamplingError};
use corf_scene::lock::FolderLock;
use corf_scene::trajectory::TrajectoryPose;
use corf_scene::{Error, Finding, Light, Pinhole, Scene, Severity, bounds, radio_check};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::VecDeque;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::sync::{Arc, Mutex};
use std::time::Duration;

/// A dataset, and what is to be said of it.
pub struct Generated {
    /// The finished dataset.
    pub dataset: Dataset,
    /// Warnings: black images, empty depth.
    pub findings: Vec<Finding>,
}

/// Options of the generation of a dataset.
#[derive(Clone, Debug, Default)]
pub struct GenerateOptions {
    /// Go on in a folder that holds some of it.
    pub resume: bool,
    /// Refuse what would otherwise be a warning about where transmitter and platform stand.
    pub strict: bool,
    /// Device that traces light.
    pub light: Backend,
    /// A data set of the same room and poses whose light this one has, instead of tracing it.
    pub light_from: Option<Dataset>,
    /// What of the scene file's radio is another here.
    pub other_radio: OtherRadio,
}

/// What of a scene file's radio is another for one data set.
#[derive(Clone, Copy, Debug, Default)]
pub struct OtherRadio {
    /// Place of the transmitter, metres, world frame.
    pub transmitter_m: Option<DVec3>,
    /// Carrier, Hz.
    pub frequency_hz: Option<f64>,
}

impl OtherRadio {
    /// Puts it over a scene file's values: of the transmitter that a data set's configuration names.
    ///
    /// # Errors
    /// A transmitter that the scene does not have; a place or a carrier out of range.
    fn over(self, scene: &mut SceneConfig, config: &DatasetConfig) -> Result<()> {
        config.transmitter_of(scene)?;
        let named = config.transmitter.as_ref().and_then(|name| scene.transmitters.get_mut(name));
        if let Some(place_m) = self.transmitter_m {
            named.unwrap_or(&mut scene.transmitter).position_m = place_m.to_array();
        }
        scene.radio.frequency_hz = self.frequency_hz.unwrap_or(scene.radio.frequency_hz);
        Ok(scene.validate()?)
    }
}

/// Generates a dataset, or what is missing of one.
///
/// # Errors
/// A scene that cannot be read or traced, an occupied or unwritable folder, an interrupt.
pub fn generate(config: &DatasetConfig, out: &Path, options: GenerateOptions) -> Result<Generated> {
    let mut scene_config = config.load_scene_config()?;
    options.other_radio.over(&mut scene_config, config)?;
    let scene = in_use::load(&scene_config)?;
    generate_from(config, &scene_config, &scene, out, options)
}

/// [`generate`] of a scene in memory, whose configuration is `scene_config` as it stands.
///
/// # Errors
/// Those of [`generate`].
pub fn generate_from(
    config: &DatasetConfig,
    scene_config: &SceneConfig,
    scene: &Scene,
    out: &Path,
    GenerateOptions { resume, strict, light: device, light_from, other_radio: _ }: GenerateOptions,
) -> Result<Generated> {
    scene_config.check_radio(scene)?;
    let placement = radio_check::placement_findings(scene_config, scene);
    let unwanted = |f: &&Finding| f.severity == Severity::Error || strict && f.severity == Severity::Warning;
    if let Some(Finding { place, what, help, .. }) = placement.iter().find(unwanted) {
        return Err(Error::invalid(place, what, help).into());
    }
    let at_once = keyframes_at_once(&device);
    let waiting = if device.adapter().is_some() { keyframes_waiting(config) } else { 0 };
    check_memory(config, at_once, waiting)?;
    let plan = SensorPlan::of(config, scene_config)?;
    let mut header = DatasetHeader::from_configs(config, scene_config, scene, 0.0)?;
    for on_surface in &header.on_surfaces {
        note!("{}", on_surface.words());
    }
    let denoiser = if light_from.is_some() { None } else { Oidn::asked_for(config)? };
    match &light_from {
        Some(source) => header.take_light_of(source)?,
        None => {
            header.denoiser = denoiser.as_ref().map(Oidn::name);
            header.light_adapter = device.adapter().map(str::to_owned);
        }
    }
    if out.join("dataset.json").exists() {
        let _held = claim_output(out, resume)?;
        dataset::check_finished(out, &header)?;
        let findings = dataset::validate(out)?;
        if let Some(finding) = findings.iter().find(|f| f.severity == Severity::Error) {
            bail!("{finding}\n  help: the finished dataset in {} is damaged: generate it anew elsewhere", out.display());
        }
        return report(Generated { dataset: Dataset::open(out)?, findings });
    }
    // Whatever can be refused is refused before the first file. Where one half of the set-up leaves processors idle, the other goes on.
    let bvh = Stage::of("search tree of the scene", || Bvh::build(scene));
    let array = Array { config, plan: &plan, scene, out, resume, radio_camera: header.radio_camera };
    if let Some(source) = light_from {
        let tracer = Stage::of("faces of the scene", || RadioTracer::new(scene, &bvh, plan.tracing))?;
        return array.hear_beside(source, header, &tracer, placement);
    }
    let set_up = Stage::start("faces and lights of the scene");
    let (tracer, light) = rayon::join(|| RadioTracer::new(scene, &bvh, plan.tracing), || LightTracer::new(scene, &bvh));
    drop(set_up);
    let tracer = tracer?;
    let refused = AtomicBool::new(false);
    let poses = header.poses.clone();
    let see = || -> Result<(LightSensor<'_>, f64)> {
        let mut camera = camera_unless(config, &light, &device, denoiser, &refused)?;
        let exposure_ev = match config.light.exposure_ev {
            Some(exposure_ev) => exposure_ev,
            None => f64::from(Stage::of("exposure", || camera.meter(&poses))?),
        };
        camera.expose(exposure_ev as f32);
        camera.reserve()?;
        Ok((camera, exposure_ev))
    };
    let hear = || array.make_ready(&tracer, &poses, placement);
    let hear = || {
        let heard = hear();
        refused.store(heard.is_err(), Ordering::Relaxed);
        heard
    };
    std::thread::scope(|scope| -> Result<Generated> {
        let hearing = scope.spawn(hear);
        let heard = || hearing.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        let (camera, exposure_ev) = match see() {
            Ok(seen) => seen,
            Err(error) => return heard().and(Err(error)),
        };
        std::thread::scope(|scope| -> Result<Generated> {
            // What a GPU sees, it sees ahead of radio and files; where nothing is there yet, of radio's set-up as well.
            let ahead = camera.adapter().is_some();
            let start = |poses| Ahead::start(scope, &camera, poses, waiting);
            let early = (ahead && !resume).then(|| start(poses.iter().collect()));
            let (array, _held, sampling_error) = heard()?;
            header.sampling_error = sampling_error;
            header.exposure_ev = Some(exposure_ev);
            let outputs = outputs(config, &plan, &header);
            let platform = Platform { camera: &camera, array, outputs };
            let writer = DatasetWriter::create(out, &header, resume)?;
            let missing: Vec<&TrajectoryPose> = poses.iter().filter(|p| !writer.is_complete(p.index)).collect();
            let seen = early.or_else(|| (ahead && !missing.is_empty()).then(|| start(missing.clone())));
            trace_and_write(&platform, &writer, &missing, seen, at_once, (&config.name, poses.len()))?;
            let findings = writer.dark_findings()?;
            writer.finish()?;
            report(Generated { dataset: Dataset::open(out)?, findings })
        })
    })
}

/// What is computed of radio at every pose.
fn outputs(config: &DatasetConfig, plan: &SensorPlan, header: &DatasetHeader) -> Outputs {
    Outputs {
        extent: Extent::of_keyframe(&config.radio, &plan.receiver),
        camera: header.radio_camera,
        sphere: header.sphere,
        paths: config.radio.write_paths,
    }
}

/// The radio half of a generation.
struct Array<'a> {
    config: &'a DatasetConfig,
    plan: &'a SensorPlan,
    scene: &'a Scene,
    out: &'a Path,
    resume: bool,
    radio_camera: Pinhole,
}

impl<'a> Array<'a> {
    /// The array made ready, the folder held, and the sampling error of its spectra, in this order; what is to be said of the scene is said.
    fn make_ready<'t>(
        &self,
        tracer: &'t RadioTracer<'t>,
        poses: &[TrajectoryPose],
        placement: Vec<Finding>,
    ) -> Result<(RadioSensor<'t>, FolderLock, Option<SamplingError>)>
    where
        'a: 't,
    {
        let array = Stage::of("mirrors and photons of the radio field", || RadioSensor::new(self.plan, self.scene, tracer))?;
        messages::findings(array.check(poses.iter().map(|pose| &pose.world_from_camera))?);
        let held = claim_output(self.out, self.resume)?;
        messages::findings(placement);
        messages::findings(geometry_warnings(self.scene, self.config.radio.transmission));
        let error = Stage::of("sampling error of the spectra", || array.sampling_error(&self.radio_camera, poses))?;
        Ok((array, held, error))
    }

    /// Traces radio alone, beside the light of `source`, which `header` has taken.
    fn hear_beside(
        &self,
        source: Dataset,
        mut header: DatasetHeader,
        tracer: &RadioTracer<'_>,
        placement: Vec<Finding>,
    ) -> Result<Generated> {
        let (array, _held, sampling_error) = self.make_ready(tracer, &header.poses, placement)?;
        header.sampling_error = sampling_error;
        let outputs = outputs(self.config, self.plan, &header);
        let writer = DatasetWriter::create(self.out, &header, self.resume)?.with_light_of(source);
        let missing: Vec<&TrajectoryPose> = header.poses.iter().filter(|p| !writer.is_complete(p.index)).collect();
        let (mut done, all) = (header.poses.len() - missing.len(), header.poses.len());
        let mut progress = Progress::start(format!("radio of {}", self.config.name), all, "keyframes").begun_at(done);
        for together in missing.chunks((rayon::current_num_threads() / THREADS_OF_RADIO).clamp(1, MOST_AT_ONCE)) {
            interrupt::check()?;
            together.par_iter().try_for_each(|pose| {
                let radio = array.keyframe(&pose.world_from_camera, &outputs)?;
                writer.write_frame(pose.index, &heard(radio))
            })?;
            done += together.len();
            progress.set(done, all);
        }
        progress.finish();
        let findings = writer.dark_findings()?;
        writer.finish()?;
        report(Generated { dataset: Dataset::open(self.out)?, findings })
    }
}

/// Traces and writes what is missing of a data set of this name and number of keyframes, so many keyframes at once; keyframes are written
/// while the next are traced. Images come from what a GPU has `seen`, or are traced beside the radio.
fn trace_and_write(
    platform: &Platform<'_, '_>,
    writer: &DatasetWriter,
    missing: &[&TrajectoryPose],
    mut seen: Option<Ahead>,
    at_once: usize,
    (name, all): (&str, usize),
) -> Result<()> {
    if missing.is_empty() {
        return Ok(());
    }
    let mut done = all - missing.len();
    let mut progress = Progress::start(format!("keyframes of {name}"), all, "keyframes").begun_at(done);
    let stages = Stages::default();
    let mut traced: Vec<(usize, KeyframeContent)> = Vec::new();
    let write = |traced: &[(usize, KeyframeContent)]| {
        traced.par_iter().try_for_each(|(i, frame)| stages.time("files", || writer.write_frame(*i, frame)))
    };
    for together in missing.chunks(at_once) {
        interrupt::check()?;
        traced = match &mut seen {
            Some(seen) => {
                let hear = |pose: &&TrajectoryPose| stages.time("radio", || platform.hear(pose));
                let hear = || together.par_iter().map(hear).collect::<corf_scene::Result<Vec<_>>>();
                let (written, heard) = rayon::join(|| write(&traced), hear);
                written?;
                done += traced.len();
                let keyframe = |(pose, radio): (&&TrajectoryPose, _)| {
                    Ok((pose.index, joined(stages.time("waiting for light", || seen.next())?, radio)))
                };
                together.iter().zip(heard?).map(keyframe).collect::<Result<Vec<_>>>()?
            }
            None => {
                let trace = |pose: &&TrajectoryPose| Ok((pose.index, platform.keyframe(pose)?));
                let trace = || together.par_iter().map(trace).collect::<corf_scene::Result<Vec<_>>>();
                let (written, frames) = rayon::join(|| write(&traced), trace);
                written?;
                done += traced.len();
                frames?
            }
        };
        progress.set(done, all);
    }
    write(&traced)?;
    progress.set(all, all);
    progress.finish();
    if seen.is_some() {
        let spent: Vec<String> = stages.spent().iter().map(|s| format!("{} {:.1}", s.what, s.seconds)).collect();
        note!("  in seconds of threads: {}", spent.join(", "));
        note!("  light, in seconds: {}", spent_text(&platform.camera.spent()));
    }
    Ok(())
}

/// A dataset's camera, ready: with cached light the scene's is solved, under a progress bar.
///
/// # Errors
/// An interrupt.
pub fn camera<'a>(
    config: &DatasetConfig,
    tracer: &'a LightTracer<'a>,
    device: &Backend,
    denoiser: Option<Oidn>,
) -> Result<LightSensor<'a>> {
    camera_unless(config, tracer, device, denoiser, &AtomicBool::new(false))
}

/// [`camera`], given up where something else is `refused` meanwhile.
fn camera_unless<'a>(
    config: &DatasetConfig,
    tracer: &'a LightTracer<'a>,
    device: &Backend,
    denoiser: Option<Oidn>,
    refused: &AtomicBool,
) -> Result<LightSensor<'a>> {
    let progress = Mutex::new(Progress::start(format!("light of {}", config.name), 1, "tiles"));
    let report = |done: usize, all: usize| {
        if let Ok(mut progress) = progress.lock() {
            progress.set(done, all);
        }
        interrupt::check().is_ok() && !refused.load(Ordering::Relaxed)
    };
    let denoiser = denoiser.map(|filter| Box::new(filter) as Box<dyn Denoise>);
    let Some(camera) = LightSensor::new(config, tracer, &device.for_light(), denoiser, &report)? else {
        interrupt::check()?;
        bail!("the light of {} was not solved", config.name);
    };
    if let Ok(progress) = progress.into_inner() {
        progress.finish();
    }
    Ok(camera)
}

/// Where a GPU's time went, in one line.
pub fn spent_text(spent: &[Spent]) -> String {
    let one = |s: &Spent| format!("{} {:.2} ({})", s.what, s.seconds, s.times);
    spent.iter().map(one).collect::<Vec<_>>().join(", ")
}

/// What the GPU has seen of some keyframes.
type Seen = corf_scene::Result<Vec<(Light, Extras)>>;

/// Keyframes seen by the GPU while others are heard and written, in their order: two threads take turns at it, so that one's
/// pictures are unpacked while the other's are rendered.
struct Ahead {
    seen: [Receiver<Seen>; 2],
    /// Handovers so far.
    count: usize,
    /// Handed over and not yet taken.
    ready: VecDeque<(Light, Extras)>,
}

impl Ahead {
    /// Begins to see these poses in their order; about so many finished keyframes may wait to be taken.
    fn start<'scope, 'env>(
        scope: &'scope std::thread::Scope<'scope, 'env>,
        camera: &'env LightSensor<'_>,
        poses: Vec<&'env TrajectoryPose>,
        waiting: usize,
    ) -> Self {
        let most = camera.together();
        let poses = Arc::new(poses);
        let seen = [0, 1].map(|first| {
            let (sender, receiver) = sync_channel(waiting / (2 * most));
            let poses = poses.clone();
            scope.spawn(move || {
                for together in handovers(&poses, most).into_iter().skip(first).step_by(2) {
                    let frames = camera.see_all(together);
                    let failed = frames.is_err();
                    // Nobody waits for it where the work was given up.
                    if sender.send(frames).is_err() || failed {
                        return;
                    }
                }
            });
            receiver
        });
        Self { seen, count: 0, ready: VecDeque::new() }
    }

    /// The next keyframe's images.
    ///
    /// # Errors
    /// The device's; an interrupt.
    fn next(&mut self) -> Result<(Light, Extras)> {
        loop {
            if let Some(frame) = self.ready.pop_front() {
                return Ok(frame);
            }
            interrupt::check()?;
            match self.seen[self.count % 2].recv_timeout(Duration::from_millis(100)) {
                Ok(frames) => {
                    self.count += 1;
                    self.ready = frames?.into();
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => bail!("light: a thread ended before its time"),
            }
        }
    }
}

/// Poses in handovers of `most`; the first are smaller, so that there is soon something to go on with.
fn handovers<'p, 'q>(mut poses: &'p [&'q TrajectoryPose], most: usize) -> Vec<&'p [&'q TrajectoryPose]> {
    let (mut parts, mut size) = (Vec::new(), 1);
    while !poses.is_empty() {
        let (part, rest) = poses.split_at(size.min(most).min(poses.len()));
        parts.push(part);
        (poses, size) = (rest, 2 * size);
    }
    parts
}

/// Finished images that may wait for radio: as many as [`MOST_WAITING_BYTES`] hold.
fn keyframes_waiting(config: &DatasetConfig) -> usize {
    (MOST_WAITING_BYTES / (WAITING_BYTES_A_PIXEL * config.light.width * config.light.height).max(1)).min(MOST_WAITING)
}

/// Most keyframes whose images wait: what a GPU sees while the radio of a large room is made ready on few threads.
const MOST_WAITING: usize = 64;
/// Their memory at most, bytes.
const MOST_WAITING_BYTES: usize = 2 << 30;
/// Memory of a finished keyframe's images (colours, depth, surface, albedo and normals), bytes a pixel.
const WAITING_BYTES_A_PIXEL: usize = 24;

/// Keyframes traced together: what one of them leaves of many processors idle is used by the others, and few take little memory.
/// Beside a GPU, radio and files of one keeps few threads busy.
fn keyframes_at_once(device: &Backend) -> usize {
    let threads = if device.adapter().is_some() { THREADS_OF_RADIO } else { THREADS_A_KEYFRAME };
    (rayon::current_num_threads() / threads).clamp(1, MOST_AT_ONCE)
}

/// Threads that radio and files of a keyframe keep busy.
const THREADS_OF_RADIO: usize = 2;

/// Threads that a single keyframe keeps busy.
const THREADS_A_KEYFRAME: usize = 8;
/// Most keyframes traced together; at 1600×900 each takes some 0.4 GB until it is written.
const MOST_AT_ONCE: usize = 8;

/// Says what is to be said.
fn report(generated: Generated) -> Result<Generated> {
    messages::findings(&generated.findings);
    Ok(generated)
}

/// Memory of a keyframe's images while they are rendered, filtered and written, bytes a pixel.
const LIGHT_BYTES_A_PIXEL: f64 = 300.0;
const RADIO_BYTES_A_PIXEL: f64 = 120.0;

/// Refuses images that do not fit the memory.
fn check_memory(config: &DatasetConfig, at_once: usize, waiting: usize) -> Result<()> {
    let [sphere_columns, sphere_rows] = config.radio.sphere.unwrap_or([0, 0]);
    let at_once = at_once as f64;
    let light = at_once * LIGHT_BYTES_A_PIXEL + (waiting * WAITING_BYTES_A_PIXEL) as f64;
    for (key, columns, rows, bytes_a_pixel) in [
        ("optical", config.light.width, config.light.height, light),
        ("rf", config.radio.width, config.radio.height, at_once * RADIO_BYTES_A_PIXEL),
        ("rf.sphere", sphere_columns, sphere_rows, at_once * RADIO_BYTES_A_PIXEL),
    ] {
        let place = format!("{}: {key}", config.source.display());
        let bytes = bytes_a_pixel * columns as f64 * rows as f64;
        bounds::memory(&place, &format!("images of {columns}x{rows} pixels"), bytes, "give fewer pixels")?;
    }
    Ok(())
}

#[cfg(all(test, feature = "gpu"))]
mod tests {
    use super::*;
    use corf_gpu::adapter_names;
    use corf_scene::config::LightMethod;

    /// The first adapter, one in software will do; a failure without any under `CORF_REQUIRE_GPU=1`.
    fn adapter() -> Option<Backend> {
        let first = adapter_names().into_iter().next().map(|(adapter, _)| Backend::Gpu { adapter, number: 0, timed: false });
        let required = std::env::var_os("CORF_REQUIRE_GPU").is_some_and(|v| v == "1");
        assert!(first.is_some() || !required, "no adapter");
        first
    }

    #[test]
    fn a_data_set_whose_light_a_gpu_traces_is_the_processors_and_says_so() {
        let Some(gpu) = adapter() else { return };
        let scenes = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenes");
        let mut config = DatasetConfig::load(scenes.join("room-tiny.toml")).unwrap();
        (config.keyframes, config.light.width, config.light.height) = (3, 40, 24);
        (config.light.samples_per_pixel, config.radio.width, config.radio.height) = (Some(1), 12, 8);
        let folder = tempfile::tempdir().unwrap();
        let make = |name: &str, light: &Backend, resume: bool| {
            generate(
                &config,
                &folder.path().join(name),
                GenerateOptions { resume, light: light.clone(), ..GenerateOptions::default() },
            )
        };
        let [own, other] =
            [("cpu", Backend::Cpu), ("gpu", gpu.clone())].map(|(name, device)| make(name, &device, false).unwrap().dataset);
        assert_eq!(own.header().light_adapter, None);
        assert_eq!(other.header().light_adapter.as_deref(), gpu.adapter());
        assert_ne!(own.hash(), other.hash());
        assert!((own.header().exposure_ev.unwrap() - other.header().exposure_ev.unwrap()).abs() < 0.015, "hundredths of a stop");
        for k in 0..3 {
            let [a, b] = [&own, &other].map(|dataset| dataset.keyframe(k).unwrap());
            let spectrum = |k: &corf_scene::Keyframe| k.radio.as_ref().unwrap().spectrum.clone();
            assert_eq!(spectrum(&a), spectrum(&b), "radio is the processor's");
            let [a, b] = [a, b].map(|k| k.light.unwrap());
            let pairs = a.image.pixels().iter().flatten().zip(b.image.pixels().iter().flatten());
            let squares: f64 = pairs.map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
            let error = (squares / (3 * a.image.pixels().len()) as f64).sqrt();
            // Of 255 levels: a path or two that rounding sends elsewhere.
            assert!(error < 3.0, "keyframe {k}: {error} levels");
        }
        // The same bytes again, and nothing is begun over on another device.
        assert_eq!(make("again", &gpu, false).unwrap().dataset.hash(), other.hash());
        assert_eq!(make("gpu", &gpu, true).unwrap().dataset.hash(), other.hash());
        // Images that a binding cannot hold are refused before the first file.
        let largest = corf_gpu::adapter_reports().into_iter().next().map_or(0, |report| report.largest_buffer_bytes);
        if largest <= 256 << 20 {
            let mut config = config.clone();
            (config.light.method, config.light.exposure_ev) = (LightMethod::Path, Some(0.0));
            (config.light.width, config.light.height) = (2400, (largest / 80 / 2400 + 8) as usize);
            let out = folder.path().join("large");
            let options = GenerateOptions { light: gpu.clone(), ..GenerateOptions::default() };
            let refusal = generate(&config, &out, options).err().unwrap();
            assert!(format!("{refusal:#}").contains("choose --device cpu"), "{refusal:#}");
            let left = std::fs::read_dir(&out).map_or(0, Iterator::count);
            assert_eq!(left, 0, "files in {}", out.display());
        }
        for (name, device, help) in [("gpu", &Backend::Cpu, "--device gpu:N"), ("cpu", &gpu, "--device cpu")] {
            let refusal = make(name, device, true).err().unwrap();
            assert!(format!("{refusal:#}").contains(help), "{refusal:#}");
        }
    }
}
