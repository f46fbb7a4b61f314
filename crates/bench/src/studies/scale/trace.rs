//! Tracing: a keyframe's light and radio against triangles, radio against receivers.

use super::{Measured, memory};
use crate::device::Backend;
use crate::record::provenance::reset_peak_memory;
use crate::scenes::generate::camera;
use crate::scenes::in_use;
use crate::scenes::lobby;
use crate::terminal::interrupt;
use crate::terminal::progress::Progress;
use anyhow::{Context, Result, ensure};
use corf_raytrace::bvh::Bvh;
use corf_raytrace::light::LightTracer;
use corf_raytrace::radio::RadioTracer;
use corf_raytrace::sensor::{Extent, Outputs, RadioSensor, SensorPlan};
use corf_scene::config::{DatasetConfig, LightMethod, SceneConfig};
use corf_scene::io::ScratchFolder;
use corf_scene::model::Triangle;
use corf_scene::trajectory::{self, TrajectoryPose};
use corf_scene::{Scene, bounds};
use serde::Serialize;
use serde_json::Value;
use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Most memory of a triangle while it is traced, bytes: with its vertices, its boxes and its place in the patches.
const BYTES_A_TRIANGLE: f64 = 1500.0;

/// Scene and sampling of the traced axes.
#[derive(Clone, Debug)]
pub struct TraceSettings {
    /// A data set's file; the lobby at the published size without one.
    pub config: Option<PathBuf>,
    /// Keyframes traced for a point of the triangles.
    pub poses: usize,
    /// Small images, few samples.
    pub quick: bool,
}

/// A scene, read, with the settings of its keyframes.
pub struct Tracing {
    config: DatasetConfig,
    scene_config: SceneConfig,
    scene: Scene,
    poses: usize,
}

/// The fixed settings of a traced point.
#[derive(Serialize)]
struct Fixed<'a> {
    data_set: &'a str,
    #[serde(rename = "optical")]
    light: [usize; 2],
    #[serde(rename = "light")]
    method: LightMethod,
    samples_per_pixel: u32,
    #[serde(rename = "rf")]
    radio: [usize; 2],
    depth: usize,
    directions: usize,
    photons: usize,
    patch_size_m: f64,
    poses: usize,
    threads: usize,
}

/// Copies a scene with every triangle cut into four, `times` times over: the same surfaces, edges stay shared.
pub fn subdivided(scene: &Scene, times: u32) -> Scene {
    let mut out = scene.clone();
    for _ in 0..times {
        let mut middles: HashMap<(u32, u32), u32> = HashMap::new();
        let before = std::mem::take(&mut out.triangles);
        out.triangles.reserve(4 * before.len());
        for triangle in before {
            let [a, b, c] = triangle.vertices;
            let mut middle = |a: u32, b: u32| *middles.entry((a.min(b), a.max(b))).or_insert_with(|| add_middle(&mut out, a, b));
            let [ab, bc, ca] = [middle(a, b), middle(b, c), middle(c, a)];
            let parts = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]];
            out.triangles.extend(parts.map(|vertices| Triangle { vertices, ..triangle }));
        }
    }
    out
}

/// Adds the vertex between two, all of its attributes between theirs.
fn add_middle(scene: &mut Scene, a: u32, b: u32) -> u32 {
    // Ordered, so that vertices at one place keep middles at one place whichever way round an edge runs.
    let (a, b) = (a.min(b) as usize, a.max(b) as usize);
    let normal = (scene.normals[a] + scene.normals[b]).normalize_or(scene.normals[a]);
    scene.positions.push(0.5 * (scene.positions[a] + scene.positions[b]));
    scene.normals.push(normal);
    scene.uvs.push([0, 1].map(|k| 0.5 * (scene.uvs[a][k] + scene.uvs[b][k])));
    if !scene.colors.is_empty() {
        scene.colors.push([0, 1, 2, 3].map(|k| 0.5 * (scene.colors[a][k] + scene.colors[b][k])));
    }
    scene.positions.len() as u32 - 1
}

/// Seconds that something takes.
fn timed<T>(work: impl FnOnce() -> Result<T>) -> Result<(f64, T)> {
    let start = Instant::now();
    work().map(|result| (start.elapsed().as_secs_f64(), result))
}

impl Tracing {
    /// Reads the scene.
    ///
    /// # Errors
    /// A configuration or scene that cannot be read or traced.
    pub fn open(settings: &TraceSettings) -> Result<Self> {
        let unpacked = ScratchFolder::beside(&std::env::temp_dir()).context("cannot create a temporary folder")?;
        let own = |path: &Path| -> Result<PathBuf> {
            lobby::unpack(path)?;
            Ok(path.join(lobby::FULL))
        };
        let path = settings.config.clone().map_or_else(|| own(unpacked.path()), Ok)?;
        let mut config = DatasetConfig::load(path)?;
        if settings.quick {
            (config.light.width, config.light.height) = (96, 54);
            (config.light.method, config.light.samples_per_pixel) = (LightMethod::Path, Some(2));
            (config.radio.width, config.radio.height) = (48, 32);
            // As few directions as lobes of a degree allow, beyond which no diffuse power is gathered around the frame.
            (config.radio.max_interactions, config.radio.directions, config.radio.photons) = (1, 100_000, 10_000);
            (config.radio.patch_size_m, config.radio.lobe_width_deg) = (0.5, 1.0);
        }
        config.radio.sphere = None;
        config.validate()?;
        let scene_config = config.load_scene_config()?;
        ensure!(
            scene_config.trajectory.is_some(),
            "{}: no [trajectory]\n  help: positions are taken along it",
            scene_config.source.display()
        );
        let scene = in_use::load(&scene_config)?;
        scene_config.check_radio(&scene)?;
        scene_config.check_placement(&scene)?;
        Ok(Self { config, scene_config, scene, poses: settings.poses })
    }

    /// Triangles of the scene cut in four so many times.
    pub fn triangles(&self, times: u32) -> usize {
        self.scene.triangles.len() << (2 * times)
    }

    /// The fixed settings, for records.
    pub fn settings(&self) -> Value {
        let (light, radio) = (&self.config.light, &self.config.radio);
        serde_json::json!(Fixed {
            data_set: &self.config.name,
            light: [light.width, light.height],
            method: light.method,
            samples_per_pixel: light.samples(),
            radio: [radio.width, radio.height],
            depth: radio.max_interactions,
            directions: if radio.diffuse { radio.directions } else { 0 },
            photons: if radio.diffuse { radio.photons } else { 0 },
            patch_size_m: radio.patch_size_m,
            poses: self.poses,
            threads: rayon::current_num_threads(),
        })
    }

    fn positions(&self, count: usize) -> Result<Vec<TrajectoryPose>> {
        let way = self.scene_config.trajectory.as_ref().context("the scene has no [trajectory]")?;
        Ok(trajectory::generate_between(way, count, self.config.way)?)
    }

    fn outputs(&self, plan: &SensorPlan) -> Outputs {
        Outputs {
            extent: Extent::of_keyframe(&self.config.radio, &plan.receiver),
            camera: self.config.radio_camera(),
            sphere: None,
            paths: false,
        }
    }

    /// Light and radio of a few keyframes, with the scene cut in four so many times; what is done once for a scene is apart.
    ///
    /// # Errors
    /// More triangles than fit into memory; a scene that cannot be traced; an interrupt.
    pub fn measure_triangles(&self, times: u32) -> Result<Measured> {
        let count = self.triangles(times);
        let what = format!("{count} triangles");
        bounds::memory("--subdivisions", &what, BYTES_A_TRIANGLE * count as f64, "cut the triangles fewer times")?;
        reset_peak_memory();
        let scene = subdivided(&self.scene, times);
        let poses = self.positions(self.poses)?;
        let plan = SensorPlan::of(&self.config, &self.scene_config)?;
        let (hierarchy_s, bvh) = timed(|| Ok(Bvh::build(&scene)))?;
        let tracer = LightTracer::new(&scene, &bvh);
        let (prepare_light_s, eye) = timed(|| camera(&self.config, &tracer, &Backend::Cpu, None))?;
        let mut sum = [0.0; 2];
        for pose in &poses {
            interrupt::check()?;
            sum[0] += timed(|| Ok(eye.look(&pose.world_from_camera, pose.index as u64)?))?.0;
        }
        drop(eye);
        interrupt::check()?;
        let radio = RadioTracer::new(&scene, &bvh, plan.tracing)?;
        let (prepare_radio_s, array) = timed(|| Ok(RadioSensor::new(&plan, &scene, &radio)?))?;
        let outputs = self.outputs(&plan);
        for pose in &poses {
            interrupt::check()?;
            sum[1] += timed(|| Ok(array.keyframe(&pose.world_from_camera, &outputs)?))?.0;
        }
        let [light_s, radio_s] = sum.map(|s| s / poses.len() as f64);
        let found = [
            ("hierarchy_s", hierarchy_s),
            ("light_once_s", prepare_light_s),
            ("light_s", light_s),
            ("radio_once_s", prepare_radio_s),
            ("radio_s", radio_s),
        ];
        Ok(found.map(|(key, v)| (key.to_owned(), v)).into_iter().chain(memory(None)).collect())
    }

    /// Spectra at as many positions as the largest count says, one after the other; `tell` is given the findings at every count.
    ///
    /// # Errors
    /// A scene that cannot be traced; an interrupt; an error of `tell`.
    pub fn measure_receivers(&self, counts: &[usize], report: &mut dyn FnMut(usize, Measured) -> Result<()>) -> Result<()> {
        let Some(&last) = counts.last() else { return Ok(()) };
        reset_peak_memory();
        let poses = self.positions(last)?;
        let plan = SensorPlan::of(&self.config, &self.scene_config)?;
        let bvh = Bvh::build(&self.scene);
        let (tracer_s, tracer) = timed(|| Ok(RadioTracer::new(&self.scene, &bvh, plan.tracing)?))?;
        let (sensor_s, array) = timed(|| Ok(RadioSensor::new(&plan, &self.scene, &tracer)?))?;
        let (once_s, outputs) = (tracer_s + sensor_s, self.outputs(&plan));
        let mut receivers_s = 0.0;
        let mut progress = Progress::start("receivers", last, "receivers");
        for (k, pose) in poses.iter().enumerate() {
            interrupt::check()?;
            receivers_s += timed(|| Ok(array.keyframe(&pose.world_from_camera, &outputs)?))?.0;
            let n = k + 1;
            progress.set(n, last);
            if counts.contains(&n) {
                let found = [
                    ("radio_once_s", once_s),
                    ("receivers_s", receivers_s),
                    ("total_s", once_s + receivers_s),
                    ("per_receiver_ms", 1e3 * (once_s + receivers_s) / n as f64),
                ];
                report(n, found.map(|(key, v)| (key.to_owned(), v)).into_iter().chain(memory(None)).collect())?;
            }
        }
        progress.finish();
        Ok(())
    }
}
