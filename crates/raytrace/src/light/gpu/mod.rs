//! Light on a GPU: the processor's functions, kernel by kernel, in WGSL.
//!
//! A kernel's parts are named as what they are on the processor (`shaders/surface.wgsl` is `surface.rs`), and random numbers are
//! the same bit for bit: images of the two devices differ by rounding, and where rounding sends a path elsewhere. A pixel depends
//! on its number, a tile of cached light on its key; every sum has an order: one adapter and driver give the same bytes.
//!
//! A thread is a pixel, a dispatch at most [`PATHS_AT_ONCE`] paths, so that the watchdog of a desktop does not bark.

mod lattices;
mod params;
#[cfg(test)]
mod probe;
mod scene;
mod shaders;

use super::cache::Packed;
use super::renderer::no_cache;
use super::sampler::frame_seed;
use super::{CacheSettings, Developed, LightFrame, LightTracer, RayCounts, Renderer, Sampling, View};
use corf_gpu::{AdapterOptions, Bound, Context, Kernel};
use corf_scene::{Error, Pinhole, Raster, Result};
use glam::{Vec2, Vec3};
use lattices::{Lattices, TileKernels};
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
    state: Mutex<State<'a>>,
}

/// What rendering changes.
#[derive(Default)]
struct State<'a> {
    /// The one image that is being rendered.
    frame: Option<Frame>,
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
        let (plain, cached) = rayon::join(
            || {
                Kernel::all(
                    context,
                    [
                        ("light: paths", shaders::render_paths(constants)),
                        ("light: select", shaders::select(constants)),
                        ("light: depth", shaders::centre(constants)),
                        ("light: develop", shaders::develop(constants)),
                    ],
                )
            },
            || -> Result<Option<CachedKernels>> {
                if !is_cached {
                    return Ok(None);
                }
                let view = || Kernel::new(context, "light: view", &shaders::render_view(constants, page));
                let (render_view, tiles) = rayon::join(view, || TileKernels::new(context, constants, page));
                Ok(Some(CachedKernels { render_view: render_view?, tiles: tiles? }))
            },
        );
        let ([render_paths, select, centre, develop], cached) = (plain?, cached?);
        Ok(Self { render_paths, select, centre, develop, cached })
    }
}

/// Memory of an image that is being rendered, and the kernels bound to it.
struct Frame {
    size: [usize; 2],
    sums: wgpu::Buffer,
    work: wgpu::Buffer,
    picture: wgpu::Buffer,
    render_paths: Bound,
    select: Bound,
    /// With how often the pages had moved when it was bound.
    render_view: Option<(u32, Bound)>,
    centre: Bound,
    develop: Bound,
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
        tell: &dyn Fn(usize, usize) -> bool,
    ) -> Result<Option<Self>> {
        let context = Context::open(options)?;
        let tree = scene::tree(tracer);
        let constants = scene::constants(tracer, &tree);
        let (kernels, packed) = rayon::join(
            || Kernels::new(&context, &constants, cache.is_some()),
            || cache.map(|settings| Packed::new(tracer, settings)).transpose(),
        );
        let (kernels, packed) = (kernels?, packed?);
        let scene = SceneBuffers::new(&context, tracer, &tree, |triangle| packed.as_ref().map_or(0, |p| p.chart_of(triangle)))?;
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
        let params = packed.as_ref().map_or(Ok(params), |packed| Lattices::params(packed, &params))?;
        let gpu = Self { tracer, context, scene, uniform, params, kernels, state: Mutex::default() };
        if let Some(packed) = packed {
            let Some(lattices) = Lattices::new(&gpu, packed, tell)? else { return Ok(None) };
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

    /// Memory of images of a camera's size, with `tiles` of cached light.
    fn make_frame(&self, [width, height]: [usize; 2], tiles: u32) -> Result<Frame> {
        let pixels = (width * height) as u64;
        let sums = self.context.storage("a view's pixels", 4 * SUMS_WORDS as u64 * pixels)?;
        let work = self.context.storage("a view's lists", 4 * (u64::from(WORK_HEAD + tiles) + 3 * pixels))?;
        let picture = self.context.storage("a view's image", 12 * pixels)?;
        Ok(Frame {
            size: [width, height],
            render_paths: self.bind(&self.kernels.render_paths, &[&sums, &work])?,
            select: self.bind(&self.kernels.select, &[&sums, &work])?,
            render_view: None,
            centre: self.bind(&self.kernels.centre, &[&sums, &work])?,
            develop: self.bind(&self.kernels.develop, &[&sums, &work, &picture])?,
            sums,
            work,
            picture,
        })
    }

    /// Settings of a view.
    fn view_params(&self, camera: &Pinhole, view: &View, sampling: &Sampling, tiles: u32) -> Params {
        let axis = |axis: glam::DVec3| view.world_from_camera.transform_vector(axis).as_vec3();
        let common = Params {
            axes: [axis(glam::DVec3::X), axis(glam::DVec3::Y), axis(glam::DVec3::Z)],
            origin: view.world_from_camera.translation.as_vec3(),
            size: [camera.width as u32, camera.height as u32],
            focal: Vec2::new(camera.fx as f32, camera.fy as f32),
            centre: Vec2::new(camera.cx as f32, camera.cy as f32),
            lists_at: WORK_HEAD + tiles,
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

    /// Runs a kernel with so many workgroups.
    fn run(&self, bound: &Bound, params: &Params, groups: u32) {
        self.context.fill(&self.uniform, 0, &params.words());
        let mut encoder = self.context.encoder();
        bound.run(&mut encoder.begin_compute_pass(&Default::default()), 0, groups);
        self.context.submit(encoder);
    }

    /// Runs a kernel over `count` places with a thread each, at most `at_once` a dispatch.
    fn pass(&self, bound: &Bound, params: &Params, count: u32, at_once: u32) {
        let at_once = (at_once / GROUP).max(1) * GROUP;
        for first in (0..count).step_by(at_once as usize) {
            let part = Params { first, count: at_once.min(count - first), ..*params };
            self.run(bound, &part, part.count.div_ceil(GROUP));
        }
    }

    /// Renders a view into the frame; returns the settings it took.
    fn view(&self, state: &mut State<'a>, camera: &Pinhole, view: &View, sampling: &Sampling) -> Result<Params> {
        let size = [camera.width, camera.height];
        let tiles = state.lattices.as_ref().map_or(0, Lattices::slot_count);
        let params = self.view_params(camera, view, sampling, tiles);
        if state.frame.as_ref().is_none_or(|frame| frame.size != size) {
            // What is there goes before what is new comes.
            state.frame = None;
            state.frame = Some(self.make_frame(size, tiles)?);
        }
        let State { frame: Some(frame), lattices } = state else { unreachable!("made above") };
        let places = places(size);
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
                    let part = Params { samples, ..params };
                    self.pass(&frame.render_paths, &part, places, PATHS_AT_ONCE);
                }
            }
            Sampling::Cached(_) => {
                let Some(lattices) = lattices else { return Err(no_cache()) };
                self.cached_view(frame, lattices, &params, places)?;
            }
        }
        self.pass(&frame.centre, &params, places, PATHS_AT_ONCE);
        self.context.check("rendering light")?;
        Ok(params)
    }

    /// Paths of every pixel, then more of them where they disagree.
    fn cached_view(&self, frame: &mut Frame, lattices: &mut Lattices<'a>, params: &Params, places: u32) -> Result<()> {
        let base = Params { samples: params.base, ..*params };
        self.until_filled(frame, lattices, &base, 0, places)?;
        self.pass(&frame.select, &base, places, PATHS_AT_ONCE);
        let mut samples = params.base;
        while samples < params.most {
            samples = samples.saturating_mul(2);
            let more = Params { samples, ..*params };
            self.clear_length(frame, 0);
            self.pass(&frame.select, &more, places, PATHS_AT_ONCE);
            let count = self.head(frame)?[0];
            if count == 0 {
                break;
            }
            self.until_filled(frame, lattices, &more, 1, count)?;
        }
        Ok(())
    }

    /// Gives the pixels of a list `params.samples` paths each; those that lack tiles again once these are filled.
    fn until_filled(
        &self,
        frame: &mut Frame,
        lattices: &mut Lattices<'a>,
        params: &Params,
        mut list: u32,
        mut count: u32,
    ) -> Result<()> {
        let at_once = PATHS_AT_ONCE / params.samples.div_ceil(2).max(1);
        while count > 0 {
            let other = usize::from(list == 1);
            self.clear_length(frame, other);
            if frame.render_view.as_ref().is_none_or(|(moves, _)| *moves != lattices.moves) {
                let Some(CachedKernels { render_view: kernel, .. }) = &self.kernels.cached else { return Err(no_cache()) };
                let buffers = [vec![&frame.sums, &frame.work], lattices.for_renderer()].concat();
                frame.render_view = Some((lattices.moves, self.bind(kernel, &buffers)?));
            }
            let Some((_, render)) = &frame.render_view else { return Err(no_cache()) };
            self.pass(render, &Params { list, ..*params }, count, at_once);
            let head = self.head(frame)?;
            let wanted = head[WANTED] as usize;
            if wanted == 0 && head[other] > 0 {
                let what = format!("{} pixels wait for cached light that is not filled", head[other]);
                return Err(Error::invalid(format!("gpu ({})", self.context.info.name), what, "choose --device cpu"));
            }
            if wanted > 0 {
                let words =
                    self.context.read::<u32>("asking for tiles", &[(&frame.work, WORK_HEAD as usize + wanted)])?.remove(0);
                self.clear_length(frame, WANTED);
                lattices.fill(self, params, words[WORK_HEAD as usize..].to_vec())?;
            }
            (list, count) = (other as u32 + 1, head[other]);
        }
        Ok(())
    }

    /// Sets a word of the head of `work` to zero.
    fn clear_length(&self, frame: &Frame, word: usize) {
        let mut encoder = self.context.encoder();
        encoder.clear_buffer(&frame.work, 4 * word as u64, Some(4));
        self.context.submit(encoder);
    }

    /// The head of `work`.
    fn head(&self, frame: &Frame) -> Result<Vec<u32>> {
        Ok(self.context.read::<u32>("rendering light", &[(&frame.work, WORK_HEAD as usize)])?.remove(0))
    }
}

/// Pixels in whole blocks of 8×8.
fn places([width, height]: [usize; 2]) -> u32 {
    (width.div_ceil(8) * height.div_ceil(8)) as u32 * GROUP
}

impl Renderer for GpuLight<'_> {
    fn render(&self, camera: &Pinhole, views: &[View], sampling: &Sampling) -> Result<Vec<LightFrame>> {
        let one = |view: &View| {
            // While one view is read back and unpacked, the next is rendered.
            let reading = {
                let mut state = self.state();
                self.view(&mut state, camera, view, sampling)?;
                let Some(frame) = &state.frame else { unreachable!("a view makes its frame") };
                let words = SUMS_WORDS * camera.width * camera.height;
                self.context.begin_reading::<u32>("rendering light", &[(&frame.sums, words)])?
            };
            Ok(light_frame(camera, view, &reading.finish(&self.context)?[0]))
        };
        views.iter().map(one).collect()
    }

    fn develop(&self, camera: &Pinhole, views: &[View], sampling: &Sampling, exposure_ev: f32) -> Result<Vec<Developed>> {
        let pixels = camera.width * camera.height;
        let one = |view: &View| {
            let reading = {
                let mut state = self.state();
                let params = self.view(&mut state, camera, view, sampling)?;
                let Some(frame) = &state.frame else { unreachable!("a view makes its frame") };
                self.pass(&frame.develop, &Params { gain: exposure_ev.exp2(), ..params }, pixels as u32, PATHS_AT_ONCE);
                let sources = [(&frame.picture, 3 * pixels), (&frame.work, WORK_HEAD as usize)];
                self.context.begin_reading::<u32>("developing", &sources)?
            };
            let read = reading.finish(&self.context)?;
            let plane = |k: usize| &read[0][k * pixels..(k + 1) * pixels];
            let raster = |k: usize| Raster::from_vec(camera.width, camera.height, plane(k).to_vec());
            Ok(Developed {
                image: raster(0).map(|word| [*word as u8, (*word >> 8) as u8, (*word >> 16) as u8]),
                depth_m: raster(1).map(|word| depth(f32::from_bits(*word))),
                surface: raster(2),
                finite: read[1][NOT_FINITE] == 0,
            })
        };
        views.iter().map(one).collect()
    }

    fn adapter(&self) -> Option<&str> {
        Some(&self.context.info.name)
    }
}

/// Words of `work`: how many tiles are wanted; whether a pixel's radiance is no number.
const WANTED: usize = 2;
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
