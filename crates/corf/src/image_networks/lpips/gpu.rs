//! [`Lpips`] on a GPU: the same steps, the maps of both images kept there; a sum for each 256 pixels of a comparison comes back.

use super::trunk::Step;
use super::{KNOWN_TOLERANCE, Lpips, LpipsInput, known_pair, pair_shown};
use crate::image_networks::{Layer, Map, MaxPool, Window};
use crate::{Error, Result};
use bytemuck::Zeroable;
use corf_gpu::{Bound, Context, GROUP_NUMBER, Kernel, Scratch, UNIFORM_STRIDE, record};
use corf_scene::Raster;
use std::fmt;
use std::sync::{Arc, Mutex, PoisonError};

/// Places, and channels, of a workgroup of convolve.wgsl.
const TILE: usize = 128;
/// Threads of a workgroup of pool.wgsl.
const POOL_THREADS: usize = 64;
/// Pixels of a workgroup of compare.wgsl.
const COMPARED_PIXELS: usize = 256;

record! {
    /// Constants of a convolution.
    struct Convolution {
        /// Columns and rows of the map, and of places of the window.
        size: [u32; 2],
        places: [u32; 2],
        channels: u32,
        /// (row, column, channel) of the window.
        inputs: u32,
        outputs: u32,
        side: u32,
        stride: u32,
        border: u32,
        /// Channels of the map that is written, and which of them is the first.
        out_channels: u32,
        out_first: u32,
    }
}

record! {
    /// Constants of pooling.
    struct Pooling {
        size: [u32; 2],
        places: [u32; 2],
        channels: u32,
        side: u32,
        stride: u32,
        padding: u32,
    }
}

record! {
    /// Constants of a comparison.
    struct Comparison {
        pixels: u32,
        channels: u32,
        padding: [u32; 2],
    }
}

/// A layer's weights, inputs × outputs, and its bias.
struct Weights {
    inputs: usize,
    outputs: usize,
    weights: wgpu::Buffer,
    bias: wgpu::Buffer,
}

/// A [`Step`] whose weights are on the GPU.
enum Resident {
    Convolution(Weights, Window),
    Fire(Box<[Weights; 3]>),
    Pool(MaxPool),
    Comparison(wgpu::Buffer),
}

/// Size of a map.
#[derive(Clone, Copy)]
struct Size {
    width: usize,
    height: usize,
    channels: usize,
}

impl Size {
    fn pixels(self) -> usize {
        self.width * self.height
    }

    fn values(self) -> usize {
        self.pixels() * self.channels
    }
}

/// Memory of the maps: those of the two images, and those that the next step writes.
struct Maps {
    now: [Scratch; 2],
    next: [Scratch; 2],
    sums: Scratch,
}

/// LPIPS with one backbone on a GPU. With VGG-16 it takes four maps of 64 values a pixel there, 1.5 GB for images of 1600×900.
pub struct LpipsOnGpu {
    convolve: Kernel,
    pool: Kernel,
    compare: Kernel,
    steps: Vec<Resident>,
    /// In use by one comparison at a time.
    maps: Mutex<Maps>,
    /// Last, for what is made of it to be dropped before.
    context: Arc<Context>,
}

impl fmt::Debug for LpipsOnGpu {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("LpipsOnGpu").field("adapter", &self.context.info.name).finish_non_exhaustive()
    }
}

impl LpipsOnGpu {
    /// Compiles the kernels, sends the weights and compares a pair of images whose distance is known.
    ///
    /// # Errors
    /// The driver's; no memory; an adapter on which the pair has another distance than on the processor.
    pub fn new(context: &Arc<Context>, lpips: &Lpips) -> Result<Self> {
        let on_gpu = Self::of(context, &lpips.steps)?;
        let [a, b] = known_pair();
        let (found, known) = (on_gpu.distance(&a, &b, LpipsInput::Signed)?, lpips.distance(&a, &b, LpipsInput::Signed));
        // Written so that what is no number is refused.
        if (found - known).abs() <= KNOWN_TOLERANCE {
            return Ok(on_gpu);
        }
        let what = format!("LPIPS of a pair of images is {found:.5} there and {known:.5} on the processor");
        Err(Error::invalid(
            format!("gpu ({})", context.info.name),
            what,
            "this is a defect of the driver; --device cpu avoids it",
        ))
    }

    /// The distance of two images.
    ///
    /// # Errors
    /// The driver's; no memory.
    ///
    /// # Panics
    /// If they differ in size, or are smaller than [`Lpips::least_px`].
    pub fn distance(&self, a: &Raster<[u8; 3]>, b: &Raster<[u8; 3]>, input: LpipsInput) -> Result<f64> {
        Ok(self.layers(a, b, input)?.iter().sum())
    }

    /// The shares of the layers in the distance of two images, from shallow to deep.
    ///
    /// # Errors
    /// The driver's; no memory.
    ///
    /// # Panics
    /// If they differ in size, or are smaller than [`Lpips::least_px`].
    pub fn layers(&self, a: &Raster<[u8; 3]>, b: &Raster<[u8; 3]>, input: LpipsInput) -> Result<Vec<f64>> {
        self.layers_of(&pair_shown(a, b, input))
    }

    fn of(context: &Arc<Context>, steps: &[Step]) -> Result<Self> {
        let convolve = Convolution::declaration() + GROUP_NUMBER + include_str!("shaders/convolve.wgsl");
        let pool = Pooling::declaration() + GROUP_NUMBER + include_str!("shaders/pool.wgsl");
        let compare = Comparison::declaration() + GROUP_NUMBER + include_str!("shaders/compare.wgsl");
        let [convolve, pool, compare] =
            Kernel::all(context, [("convolution", convolve), ("pooling", pool), ("comparison of features", compare)])?;
        let steps = steps.iter().map(|step| Resident::of(context, step)).collect::<Result<_>>()?;
        let scratch = |label| Scratch::new(context, label);
        let maps = Maps {
            now: [scratch("features of an image")?, scratch("features of an image")?],
            next: [scratch("features of an image")?, scratch("features of an image")?],
            sums: scratch("sums of features")?,
        };
        Ok(Self { convolve, pool, compare, steps, maps: Mutex::new(maps), context: context.clone() })
    }

    fn layers_of(&self, shown: &[Map; 2]) -> Result<Vec<f64>> {
        let maps = &mut *self.maps.lock().unwrap_or_else(PoisonError::into_inner);
        let context = &*self.context;
        let Map { width, height, channels, .. } = shown[0];
        let mut size = Size { width, height, channels };
        for (scratch, map) in maps.now.iter_mut().zip(shown) {
            scratch.reserve(context, size.values(), 4)?;
            context.fill(&scratch.buffer, 0, &map.values);
        }
        let mut shares = Vec::new();
        for step in &self.steps {
            match step {
                Resident::Comparison(weights) => {
                    shares.push(self.compared(maps, size, weights)?);
                    continue;
                }
                Resident::Convolution(layer, window) => {
                    let places = places(size, |length| window.places(length), layer.outputs);
                    for image in 0..2 {
                        maps.next[image].reserve(context, places.values(), 4)?;
                        let [from, to] = [&maps.now[image].buffer, &maps.next[image].buffer];
                        self.convolve([from, to], [size, places], layer, *window, 0)?;
                    }
                    size = places;
                }
                Resident::Fire(layers) => {
                    let [squeeze, one, three] = layers.as_ref();
                    let few = Size { channels: squeeze.outputs, ..size };
                    let many = Size { channels: one.outputs + three.outputs, ..size };
                    const PIXEL: Window = Window { side: 1, stride: 1, border: 0 };
                    for image in 0..2 {
                        // There and back again: what the module was given is no more needed when its result is written.
                        maps.next[image].reserve(context, few.values(), 4)?;
                        self.convolve([&maps.now[image].buffer, &maps.next[image].buffer], [size, few], squeeze, PIXEL, 0)?;
                        maps.now[image].reserve(context, many.values(), 4)?;
                        let buffers = [&maps.next[image].buffer, &maps.now[image].buffer];
                        self.convolve(buffers, [few, many], one, PIXEL, 0)?;
                        self.convolve(buffers, [few, many], three, Window::three(1), one.outputs)?;
                    }
                    size = many;
                    continue;
                }
                Resident::Pool(pool) => {
                    let places = places(size, |length| pool.places(length), size.channels);
                    for image in 0..2 {
                        maps.next[image].reserve(context, places.values(), 4)?;
                        self.pool([&maps.now[image].buffer, &maps.next[image].buffer], [size, places], *pool)?;
                    }
                    size = places;
                }
            }
            std::mem::swap(&mut maps.now, &mut maps.next);
        }
        Ok(shares)
    }

    fn convolve(
        &self,
        [from, to]: [&wgpu::Buffer; 2],
        [size, places]: [Size; 2],
        layer: &Weights,
        window: Window,
        out_first: usize,
    ) -> Result<()> {
        let job = Convolution {
            size: [size.width as u32, size.height as u32],
            places: [places.width as u32, places.height as u32],
            channels: size.channels as u32,
            inputs: layer.inputs as u32,
            outputs: layer.outputs as u32,
            side: window.side as u32,
            stride: window.stride as u32,
            border: window.border as u32,
            out_channels: places.channels as u32,
            out_first: out_first as u32,
        };
        let uniform = self.constants(job)?;
        let buffers = [&uniform, from, &layer.weights, &layer.bias, to];
        let bound = self.convolve.bind(&self.context, size_of::<Convolution>() as u64, &buffers)?;
        self.run(&bound, places.pixels().div_ceil(TILE) * layer.outputs.div_ceil(TILE));
        Ok(())
    }

    fn pool(&self, [from, to]: [&wgpu::Buffer; 2], [size, places]: [Size; 2], pool: MaxPool) -> Result<()> {
        let job = Pooling {
            size: [size.width as u32, size.height as u32],
            places: [places.width as u32, places.height as u32],
            channels: size.channels as u32,
            side: pool.side as u32,
            stride: pool.stride as u32,
            padding: 0,
        };
        let bound = self.pool.bind(&self.context, size_of::<Pooling>() as u64, &[&self.constants(job)?, from, to])?;
        self.run(&bound, (places.values() / 4).div_ceil(POOL_THREADS));
        Ok(())
    }

    fn compared(&self, maps: &mut Maps, size: Size, weights: &wgpu::Buffer) -> Result<f64> {
        let job = Comparison { pixels: size.pixels() as u32, channels: size.channels as u32, ..Comparison::zeroed() };
        let groups = size.pixels().div_ceil(COMPARED_PIXELS);
        maps.sums.reserve(&self.context, groups, 4)?;
        let [left, right] = maps.now.each_ref().map(|scratch| &scratch.buffer);
        let buffers = [&self.constants(job)?, left, right, weights, &maps.sums.buffer];
        let bound = self.compare.bind(&self.context, size_of::<Comparison>() as u64, &buffers)?;
        self.run(&bound, groups);
        let sums = self.context.read::<f32>("LPIPS", &[(&maps.sums.buffer, groups)])?;
        Ok(sums[0].iter().copied().map(f64::from).sum::<f64>() / size.pixels() as f64)
    }

    fn constants<T: bytemuck::Pod>(&self, job: T) -> Result<wgpu::Buffer> {
        let uniform = self.context.buffer("constants of LPIPS", UNIFORM_STRIDE, wgpu::BufferUsages::UNIFORM)?;
        self.context.fill(&uniform, 0, &[job]);
        Ok(uniform)
    }

    fn run(&self, bound: &Bound, groups: usize) {
        let mut encoder = self.context.encoder();
        bound.run(&mut encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default()), 0, groups as u32);
        self.context.submit(encoder);
    }
}

/// The size behind a window that has so many places along an axis.
///
/// # Panics
/// If the window does not fit into the map.
fn places(size: Size, of: impl Fn(usize) -> Option<usize>, channels: usize) -> Size {
    let [width, height] = [size.width, size.height].map(|length| of(length).expect("the window fits into the map"));
    Size { width, height, channels }
}

impl Resident {
    fn of(context: &Context, step: &Step) -> Result<Self> {
        Ok(match step {
            Step::Convolution(layer, window) => Self::Convolution(Weights::of(context, layer)?, *window),
            Step::Fire(layers) => {
                let [squeeze, one, three] = layers.as_ref();
                let sent = |layer| Weights::of(context, layer);
                Self::Fire(Box::new([sent(squeeze)?, sent(one)?, sent(three)?]))
            }
            Step::Pool(pool) => Self::Pool(*pool),
            Step::Comparison(weights) => Self::Comparison(sent(context, weights)?),
        })
    }
}

impl Weights {
    fn of(context: &Context, layer: &Layer) -> Result<Self> {
        let Layer { inputs, outputs, ref weights, ref bias } = *layer;
        let by_input: Vec<f32> = (0..inputs).flat_map(|k| (0..outputs).map(move |c| weights[c * inputs + k])).collect();
        Ok(Self { inputs, outputs, weights: sent(context, &by_input)?, bias: sent(context, bias)? })
    }
}

fn sent(context: &Context, values: &[f32]) -> Result<wgpu::Buffer> {
    let buffer = context.storage("weights of LPIPS", 4 * values.len() as u64)?;
    context.fill(&buffer, 0, values);
    Ok(buffer)
}
