//! Light on a GPU: the processor's functions, kernel by kernel, in WGSL.
//!
//! A kernel's parts are named as what they are on the processor (`shaders/surface.wgsl` is `surface.rs`), and random numbers are
//! the same bit for bit: images of the two devices differ by rounding, and where rounding sends a path elsewhere. A pixel depends
//! on its number, a tile of cached light on its key; every sum has an order: one adapter and driver give the same bytes.
//!
//! A thread is a pixel. Several views are rendered together, so that few passes and few waits serve all of them; a dispatch is as
//! long as [`Pace`] allows, so that the watchdog of a desktop does not bark.

mod clock;
mod commands;
mod lattices;
mod pace;
mod params;
#[cfg(test)]
mod probe;
mod scene;
mod shaders;
mod views;

use super::cache::Packed;
use super::renderer::no_cache;
use super::{CacheSettings, Developed, LightFrame, LightSampling, LightTracer, LightView, RayCounts, Renderer, Spent};
use clock::Clock;
use commands::Commands;
use corf_gpu::{AdapterOptions, Bound, Context, Kernel};
use corf_scene::{Error, Pinhole, Raster, Result};
use glam::Vec3;
use lattices::{Lattices, TileKernels};
use pace::Pace;
use params::{PARAMS_BYTES, Params};
use rayon::prelude::*;
use scene::SceneBuffers;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;
use views::Frame;

/// Threads of a workgroup.
const GROUP: u32 = 64;
/// Words of a pixel's sums.
const SUMS_WORDS: usize = 20;

/// A GPU that renders views of one scene.
pub struct GpuLight<'a> {
    tracer: &'a LightTracer<'a>,
    context: Context,
    scene: SceneBuffers,
    uniform: wgpu::Buffer,
    /// What all passes have in common.
    params: Params,
    kernels: Kernels,
    clock: Clock,
    /// Views that there was memory for together when it was last reserved.
    most_views: AtomicUsize,
    state: Mutex<State<'a>>,
}

/// What rendering changes.
#[derive(Default)]
struct State<'a> {
    /// The images that are being rendered together.
    frame: Option<Frame>,
    /// How long dispatches may be.
    pace: Pace,
    /// Cached light.
    lattices: Option<Lattices<'a>>,
}

struct Kernels {
    render_paths: Kernel,
    select: Kernel,
    centre: Kernel,
    develop: Kernel,
    /// Where there is cached light.
    cached: Option<CachedKernels>,
}

/// Kernels of cached light.
struct CachedKernels {
    render_view: Kernel,
    tiles: TileKernels,
}

impl Kernels {
    /// Compiles all kernels at once, for drivers take seconds for one.
    fn new(context: &Context, constants: &str, is_cached: bool) -> Result<Self> {
        let page = lattices::page_size(context);
        let plain = || {
            Kernel::all(
                context,
                [
                    ("light: paths", shaders::render_paths(constants)),
                    ("light: select", shaders::select(constants)),
                    ("light: depth", shaders::centre(constants)),
                    ("light: develop", shaders::develop(constants)),
                ],
            )
        };
        if !is_cached {
            let [render_paths, select, centre, develop] = plain()?;
            return Ok(Self { render_paths, select, centre, develop, cached: None });
        }
        let (plain, view, tiles) = std::thread::scope(|scope| {
            let view = scope.spawn(|| Kernel::new(context, "light: view", &shaders::render_view(constants, page)));
            let tiles = scope.spawn(|| TileKernels::new(context, constants, page));
            (plain(), view.join(), tiles.join())
        });
        let [render_paths, select, centre, develop] = plain?;
        let cached = CachedKernels { render_view: view.map_err(|_| lost())??, tiles: tiles.map_err(|_| lost())?? };
        Ok(Self { render_paths, select, centre, develop, cached: Some(cached) })
    }
}

impl<'a> GpuLight<'a> {
    /// Brings a scene to the adapter that the options choose. With settings for light that all views share, that is solved;
    /// `tell(done, all)` is called now
    /// and then, and when it answers `false`, the work is given up and the result is `None`.
    ///
    /// # Errors
    /// No such adapter; a scene that does not fit it.
    pub fn new(
        tracer: &'a LightTracer<'a>,
        cache: Option<&CacheSettings>,
        options: &AdapterOptions,
        report: &dyn Fn(usize, usize) -> bool,
    ) -> Result<Option<Self>> {
        let start = Instant::now();
        let context = Context::open(options)?;
        let clock = Clock::new(&context)?;
        clock.stages.add("adapter", start.elapsed().as_secs_f64());
        let tree = clock.stages.time("tree", || scene::tree(tracer));
        let constants = scene::constants(tracer, &tree);
        // Drivers take seconds to compile; meanwhile charts are cut and the scene is brought over. The pool may be busy with other work.
        let compile = || clock.stages.time("kernels", || Kernels::new(&context, &constants, cache.is_some()));
        let (kernels, rest) = std::thread::scope(|scope| {
            let kernels = scope.spawn(compile);
            let rest = || -> Result<_> {
                let packed = clock.stages.time("charts", || cache.map(|settings| Packed::new(tracer, settings)).transpose())?;
                let chart_of = |triangle| packed.as_ref().map_or(0, |p| p.chart_of(triangle));
                let scene = clock.stages.time("scene", || SceneBuffers::new(&context, tracer, &tree, chart_of))?;
                Ok((packed, scene))
            };
            let rest = rest();
            (kernels.join().map_err(|_| lost()), rest)
        });
        let (kernels, (packed, scene)) = (kernels??, rest?);
        let uniform = context.buffer("settings", commands::UNIFORM_BYTES, wgpu::BufferUsages::UNIFORM)?;
        let emitters = &tracer.emitters;
        let params = Params {
            grid_min: emitters.grid_min.to_array(),
            cells_per_metre: emitters.cells_per_metre.to_array(),
            cells: emitters.cells.to_array(),
            emitters: emitters.list.len() as u32,
            first_punctual: emitters.first_punctual as u32,
            textures: tracer.scene.textures.len() as u32,
            seen_at: scene.seen_at,
            ..Params::default()
        };
        let params = packed.as_ref().map_or(Ok(params), |packed| Lattices::params(packed, &params))?;
        let gpu = Self {
            tracer,
            context,
            scene,
            uniform,
            params,
            kernels,
            clock,
            most_views: AtomicUsize::new(usize::MAX),
            state: Mutex::default(),
        };
        if let Some(packed) = packed {
            let start = Instant::now();
            let Some(lattices) = Lattices::new(&gpu, packed, report)? else { return Ok(None) };
            gpu.clock.stages.add("coarse solution", start.elapsed().as_secs_f64());
            gpu.state().lattices = Some(lattices);
        }
        Ok(Some(gpu))
    }

    /// The kernels that fill tiles.
    fn tile_kernels(&self) -> Result<&TileKernels> {
        self.kernels.cached.as_ref().map(|cached| &cached.tiles).ok_or_else(no_cache)
    }

    fn state(&self) -> MutexGuard<'_, State<'a>> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Binds a kernel to the settings, the scene and some more buffers.
    fn bind(&self, kernel: &Kernel, more: &[&wgpu::Buffer]) -> Result<Bound> {
        let buffers: Vec<&wgpu::Buffer> =
            std::iter::once(&self.uniform).chain(&self.scene.buffers).chain(more.iter().copied()).collect();
        kernel.bind(&self.context, PARAMS_BYTES, &buffers)
    }

    /// Passes whose time on the device counts as `what`'s.
    fn commands(&self, what: &'static str) -> Commands<'_, 'a> {
        Commands::new(self, what)
    }
}

impl Renderer for GpuLight<'_> {
    fn render(&self, camera: &Pinhole, views: &[LightView], sampling: &LightSampling) -> Result<Vec<LightFrame>> {
        let mut frames = Vec::with_capacity(views.len());
        let words = SUMS_WORDS * camera.width * camera.height;
        for together in views.chunks(self.together(camera)) {
            // While some views are read back and unpacked, the next are rendered.
            let reading = {
                let mut state = self.state();
                let (frame, _) = self.views(&mut state, camera, together, sampling)?;
                let parts: Vec<_> = (0..together.len()).map(|k| (&frame.sums, k * words, words)).collect();
                self.context.begin_reading_parts::<u32>("rendering light", &parts)?
            };
            let read = self.clock.stages.time("reading back", || reading.finish(&self.context))?;
            let unpack = || together.iter().zip(&read).map(|(view, words)| light_frame(camera, view, words)).collect::<Vec<_>>();
            frames.extend(self.clock.stages.time("unpacking", unpack));
        }
        Ok(frames)
    }

    fn develop(
        &self,
        camera: &Pinhole,
        views: &[LightView],
        sampling: &LightSampling,
        exposure_ev: f32,
    ) -> Result<Vec<Developed>> {
        let pixels = camera.width * camera.height;
        let mut images = Vec::with_capacity(views.len());
        for together in views.chunks(self.together(camera)) {
            let reading = {
                let mut state = self.state();
                let (frame, params) = self.views(&mut state, camera, together, sampling)?;
                let params = Params { gain: exposure_ev.exp2(), ..params };
                let mut commands = self.commands("gpu: developing");
                commands.over(&frame.develop, &params, (pixels * together.len()) as u32);
                commands.submit();
                let planes = (0..together.len()).map(|k| (&frame.picture, 3 * k * pixels, 3 * pixels));
                let sources: Vec<_> = planes.chain([(&frame.work, 0, views::WORK_HEAD as usize)]).collect();
                self.context.begin_reading_parts::<u32>("developing", &sources)?
            };
            let mut read = self.clock.stages.time("reading back", || reading.finish(&self.context))?;
            let not_finite = read.pop().map_or(0, |head| head[views::NOT_FINITE]);
            let developed = |(view, words): (usize, &Vec<u32>)| {
                let raster =
                    |k: usize| Raster::from_vec(camera.width, camera.height, words[k * pixels..(k + 1) * pixels].to_vec());
                Developed {
                    image: raster(0).map(|word| [*word as u8, (*word >> 8) as u8, (*word >> 16) as u8]),
                    depth_m: raster(1).map(|word| depth(f32::from_bits(*word))),
                    surface: raster(2),
                    finite: not_finite >> view & 1 == 0,
                }
            };
            images.extend(self.clock.stages.time("unpacking", || read.iter().enumerate().map(developed).collect::<Vec<_>>()));
        }
        Ok(images)
    }

    fn together(&self, camera: &Pinhole) -> usize {
        views::together(&self.context, camera).min(self.most_views.load(Ordering::Relaxed))
    }

    fn reserve(&self, camera: &Pinhole) -> Result<()> {
        let views = self.reserve_frame(&mut self.state(), camera)?;
        self.most_views.store(views, Ordering::Relaxed);
        Ok(())
    }

    fn adapter(&self) -> Option<&str> {
        Some(&self.context.info.name)
    }

    fn spent(&self) -> Vec<Spent> {
        // Stamps that cannot be read are of a device that is lost, which whoever renders is told.
        let _held = self.state();
        let _ = self.clock.collect(&self.context);
        self.clock.stages.spent()
    }
}

/// That a thread that compiled kernels ended before its time.
fn lost() -> Error {
    Error::invalid("gpu", "a kernel was lost", "this is a defect of the device")
}

/// Depth, infinite where the GPU's largest distance says that nothing was hit.
fn depth(t: f32) -> f32 {
    if t < 3e38 { t } else { f32::INFINITY }
}

/// A frame from its pixels' sums.
fn light_frame(camera: &Pinhole, view: &LightView, words: &[u32]) -> LightFrame {
    let sums = |k: usize| &words[k * SUMS_WORDS..(k + 1) * SUMS_WORDS];
    let float = |k: usize, at: usize| f32::from_bits(sums(k)[at]);
    let pixels = camera.width * camera.height;
    let share = |k: usize| 1.0 / sums(k)[3].max(1) as f32;
    let raster = |at: usize| {
        let mean = |k: usize| (Vec3::new(float(k, at), float(k, at + 1), float(k, at + 2)) * share(k)).to_array();
        Raster::from_vec(camera.width, camera.height, (0..pixels).into_par_iter().map(mean).collect())
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
        lamp: Raster::from_vec(camera.width, camera.height, (0..pixels).into_par_iter().map(lamp).collect()),
        albedo: raster(8),
        normal: raster(12),
        depth_m: Raster::from_vec(camera.width, camera.height, (0..pixels).map(|k| depth(float(k, 18))).collect()),
        surface: Raster::from_vec(camera.width, camera.height, (0..pixels).map(|k| sums(k)[19]).collect()),
        rays: RayCounts { camera: total(3) + pixels as u64, bounce: total(16), shadow: total(17) },
    }
}
