//! Light on a GPU: the processor's functions, kernel by kernel, in WGSL.
//!
//! A kernel's parts are named as what they are on the processor (`shaders/surface.wgsl` is `surface.rs`), and random numbers are the same bit for
//! bit: images of the two devices differ by rounding, and where rounding sends a path elsewhere. A pixel depends on its number, a tile of
//! cached light on its key; every sum has an order: one adapter and driver give the same bytes.
//!
//! A thread is a pixel, a dispatch at most [`PATHS_AT_ONCE`] paths, so that the watchdog of a desktop does not bark.

mod params;
#[cfg(test)]
mod probe;
mod scene;
mod shaders;
mod words;

use super::renderer::no_cache;
use super::sampler::frame_seed;
use super::{Developed, LightFrame, LightTracer, RayCounts, Renderer, Sampling, View};
use corf_gpu::{AdapterOptions, Bound, Context, Kernel};
use corf_scene::{Pinhole, Raster, Result, Rigid3};
use glam::{Vec2, Vec3};
use params::{PARAMS_BYTES, Params};
use scene::SceneBuffers;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Most paths of a dispatch: 6 ms on a large GPU, a second on one two hundred times slower.
const PATHS_AT_ONCE: u32 = 4 << 20;
/// Threads of a workgroup.
const GROUP: u32 = 64;
/// Words of a pixel's sums.
const SUMS_WORDS: usize = 20;
/// Words of `work` in front of everything else.
const WORK_HEAD: u32 = 16;

/// A GPU that renders views of one scene.
pub struct GpuLight<'a> {
    tracer: &'a LightTracer<'a>,
    context: Context,
    scene: SceneBuffers,
    uniform: wgpu::Buffer,
    /// What all passes have in common.
    params: Params,
    kernels: Kernels,
    /// The one frame that is being rendered.
    frame: Mutex<Option<Frame>>,
}

struct Kernels {
    render_paths: Kernel,
    centre: Kernel,
    develop: Kernel,
}

/// Memory of an image that is being rendered, and the kernels bound to it.
struct Frame {
    size: [usize; 2],
    sums: wgpu::Buffer,
    work: wgpu::Buffer,
    picture: wgpu::Buffer,
    render_paths: Bound,
    centre: Bound,
    develop: Bound,
}

impl<'a> GpuLight<'a> {
    /// Brings a scene to the adapter that the options choose.
    ///
    /// # Errors
    /// No such adapter; a scene that does not fit it.
    pub fn new(tracer: &'a LightTracer<'a>, options: &AdapterOptions) -> Result<Self> {
        let context = Context::open(options)?;
        let scene = SceneBuffers::new(&context, tracer, |_| 0)?;
        let c = &scene.constants;
        let [render_paths, centre, develop] = Kernel::all(
            &context,
            [
                ("light: paths", shaders::render_paths(c)),
                ("light: depth", shaders::centre(c)),
                ("light: develop", shaders::develop(c)),
            ],
        )?;
        let uniform = context.buffer("settings", PARAMS_BYTES, wgpu::BufferUsages::UNIFORM)?;
        let emitters = &tracer.emitters;
        let params = Params {
            grid_min: emitters.grid_min,
            cells_per_metre: emitters.cells_per_metre,
            cells: emitters.cells,
            emitters: emitters.list.len() as u32,
            first_punctual: emitters.first_punctual as u32,
            textures: tracer.scene.textures.len() as u32,
            seen_at: scene.seen_at,
            ..Params::default()
        };
        let kernels = Kernels { render_paths, centre, develop };
        Ok(Self { tracer, context, scene, uniform, params, kernels, frame: Mutex::new(None) })
    }

    /// Binds a kernel to the settings, the scene and some more buffers.
    fn bind(&self, kernel: &Kernel, more: &[&wgpu::Buffer]) -> Result<Bound> {
        let buffers: Vec<&wgpu::Buffer> =
            std::iter::once(&self.uniform).chain(&self.scene.buffers).chain(more.iter().copied()).collect();
        kernel.bind(&self.context, PARAMS_BYTES, &buffers)
    }

    /// The memory of images of a camera.
    fn frame(&self, camera: &Pinhole) -> Result<MutexGuard<'_, Option<Frame>>> {
        let mut held = self.frame.lock().unwrap_or_else(PoisonError::into_inner);
        let size = [camera.width, camera.height];
        if held.as_ref().is_none_or(|frame| frame.size != size) {
            // What is there goes before what is new comes.
            *held = None;
            let pixels = (camera.width * camera.height) as u64;
            let sums = self.context.storage("a view's pixels", 4 * SUMS_WORDS as u64 * pixels)?;
            let work = self.context.storage("a view's lists", 4 * (u64::from(WORK_HEAD) + 3 * pixels))?;
            let picture = self.context.storage("a view's image", 12 * pixels)?;
            *held = Some(Frame {
                size,
                render_paths: self.bind(&self.kernels.render_paths, &[&sums, &work])?,
                centre: self.bind(&self.kernels.centre, &[&sums, &work])?,
                develop: self.bind(&self.kernels.develop, &[&sums, &work, &picture])?,
                sums,
                work,
                picture,
            });
        }
        Ok(held)
    }

    /// Settings of a view.
    fn view_params(&self, camera: &Pinhole, view: &View, sampling: &Sampling) -> Params {
        let Rigid3 { translation, .. } = view.world_from_camera;
        let axis = |axis: glam::DVec3| view.world_from_camera.transform_vector(axis).as_vec3();
        let common = Params {
            axes: [axis(glam::DVec3::X), axis(glam::DVec3::Y), axis(glam::DVec3::Z)],
            origin: translation.as_vec3(),
            size: [camera.width as u32, camera.height as u32],
            focal: Vec2::new(camera.fx as f32, camera.fy as f32),
            centre: Vec2::new(camera.cx as f32, camera.cy as f32),
            lists_at: WORK_HEAD,
            list_size: (camera.width * camera.height) as u32,
            gain: 1.0,
            ..self.params
        };
        match sampling {
            Sampling::Path(s) => Params {
                frame: frame_seed(s.seed, view.key),
                seed: s.seed,
                background: s.background.into(),
                samples: s.samples_per_pixel.max(1),
                max_bounces: s.max_bounces,
                roulette_after: s.roulette_after,
                next_event: s.next_event_estimation && !self.tracer.emitters.is_empty(),
                ..common
            },
            Sampling::Cached(s) => Params {
                frame: frame_seed(s.seed, view.key),
                seed: s.seed,
                gain: s.exposure_ev.exp2(),
                base: s.samples_per_pixel.max(1),
                most: s.most_samples,
                variance: s.error * s.error,
                ..common
            },
        }
    }

    /// Runs a kernel over `count` places with a thread each, at most `at_once` a dispatch.
    fn pass(&self, bound: &Bound, params: &Params, count: u32, at_once: u32) {
        let at_once = (at_once / GROUP).max(1) * GROUP;
        for first in (0..count).step_by(at_once as usize) {
            let part = Params { first, count: at_once.min(count - first), ..*params };
            self.context.fill(&self.uniform, 0, &part.words());
            let mut encoder = self.context.encoder();
            bound.run(&mut encoder.begin_compute_pass(&Default::default()), 0, part.count.div_ceil(GROUP));
            self.context.submit(encoder);
        }
    }

    /// Renders a view into a frame.
    fn view(&self, frame: &Frame, params: &Params, sampling: &Sampling) -> Result<()> {
        let places = places(frame.size);
        let mut encoder = self.context.encoder();
        encoder.clear_buffer(&frame.sums, 0, None);
        encoder.clear_buffer(&frame.work, 0, Some(4 * u64::from(WORK_HEAD)));
        self.context.submit(encoder);
        match sampling {
            Sampling::Path(_) => {
                let step = (PATHS_AT_ONCE / places).max(1);
                let mut samples = 0;
                while samples < params.samples {
                    samples = params.samples.min(samples.saturating_add(step));
                    let part = Params { samples, ..*params };
                    self.pass(&frame.render_paths, &part, places, PATHS_AT_ONCE);
                }
            }
            Sampling::Cached(_) => return Err(no_cache()),
        }
        self.pass(&frame.centre, params, places, PATHS_AT_ONCE);
        self.context.check("rendering light")
    }
}

/// Pixels in whole blocks of 8×8.
fn places([width, height]: [usize; 2]) -> u32 {
    (width.div_ceil(8) * height.div_ceil(8)) as u32 * GROUP
}

impl Renderer for GpuLight<'_> {
    fn render(&self, camera: &Pinhole, views: &[View], sampling: &Sampling) -> Result<Vec<LightFrame>> {
        let held = self.frame(camera)?;
        let Some(frame) = &*held else { return Ok(Vec::new()) };
        let mut out = Vec::with_capacity(views.len());
        for view in views {
            self.view(frame, &self.view_params(camera, view, sampling), sampling)?;
            let words = self.context.read::<u32>("rendering light", &[(&frame.sums, SUMS_WORDS * camera.width * camera.height)])?;
            out.push(light_frame(camera, view, &words[0]));
        }
        Ok(out)
    }

    fn develop(&self, camera: &Pinhole, views: &[View], sampling: &Sampling, exposure_ev: f32) -> Result<Vec<Developed>> {
        let held = self.frame(camera)?;
        let Some(frame) = &*held else { return Ok(Vec::new()) };
        let pixels = camera.width * camera.height;
        let mut out = Vec::with_capacity(views.len());
        for view in views {
            let params = self.view_params(camera, view, sampling);
            self.view(frame, &params, sampling)?;
            self.pass(&frame.develop, &Params { gain: exposure_ev.exp2(), ..params }, pixels as u32, u32::MAX);
            let read = self.context.read::<u32>("developing", &[(&frame.picture, 3 * pixels), (&frame.work, WORK_HEAD as usize)])?;
            let plane = |k: usize| &read[0][k * pixels..(k + 1) * pixels];
            let raster = |k: usize| Raster::from_vec(camera.width, camera.height, plane(k).to_vec());
            out.push(Developed {
                image: raster(0).map(|word| [*word as u8, (*word >> 8) as u8, (*word >> 16) as u8]),
                depth_m: raster(1).map(|word| depth(f32::from_bits(*word))),
                surface: raster(2),
                finite: read[1][NOT_FINITE] == 0,
            });
        }
        Ok(out)
    }

    fn adapter(&self) -> Option<&str> {
        Some(&self.context.info.name)
    }
}

/// Word of `work` that says that a pixel's radiance is no number.
const NOT_FINITE: usize = 3;

/// Depth, infinite where the GPU's largest distance says that nothing was hit.
fn depth(t: f32) -> f32 {
    if t < 3e38 { t } else { f32::INFINITY }
}

/// A frame from its pixels' sums.
fn light_frame(camera: &Pinhole, view: &View, words: &[u32]) -> LightFrame {
    let sums = |k: usize| &words[k * SUMS_WORDS..(k + 1) * SUMS_WORDS];
    let float = |k: usize, at: usize| f32::from_bits(sums(k)[at]);
    let pixels = camera.width * camera.height;
    let share = |k: usize| 1.0 / sums(k)[3].max(1) as f32;
    let raster = |at: usize| {
        let mean = |k: usize| (Vec3::new(float(k, at), float(k, at + 1), float(k, at + 2)) * share(k)).to_array();
        Raster::from_vec(camera.width, camera.height, (0..pixels).map(mean).collect())
    };
    let lamp = |k: usize| {
        let [r, g, b] = [4, 5, 6].map(|at| float(k, at) * share(k));
        [r, g, b, sums(k)[7] as f32 * share(k)]
    };
    let total = |at: usize| (0..pixels).map(|k| u64::from(sums(k)[at])).sum::<u64>();
    LightFrame {
        camera: *camera,
        world_from_camera: view.world_from_camera,
        radiance: raster(0),
        lamp: Raster::from_vec(camera.width, camera.height, (0..pixels).map(lamp).collect()),
        albedo: raster(8),
        normal: raster(12),
        depth_m: Raster::from_vec(camera.width, camera.height, (0..pixels).map(|k| depth(float(k, 18))).collect()),
        surface: Raster::from_vec(camera.width, camera.height, (0..pixels).map(|k| sums(k)[19]).collect()),
        rays: RayCounts { camera: total(3) + pixels as u64, bounce: total(16), shadow: total(17) },
    }
}
