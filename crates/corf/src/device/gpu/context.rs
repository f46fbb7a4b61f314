//! The adapter, and the smallest runtime over it: buffers, submissions, readback, and errors that say what happened.

use crate::{Error, RasterConfig, Result};
use std::{
    future::Future,
    marker::PhantomData,
    pin::pin,
    sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError},
    task::{Context as TaskContext, Poll, Waker},
};

/// Threads of the largest workgroup that multiplies by matrix units.
pub(crate) const MATRIX_THREADS: u32 = 512;

/// Bytes that sizes of buffers are multiples of.
const BUFFER_UNIT: u64 = 16;

/// Options of the GPU device: the adapter, and the features of it to use.
///
/// The tile and the batch decide how fast a step is, not what it computes: small tiles follow thin ellipses and fill a GPU with small
/// images, large ones make fewer pairs to sort.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuOptions {
    /// Index of the adapter, from 0, where a machine has several: the best kind first, those of one kind as the drivers list them.
    pub adapter: usize,
    /// Whether a software adapter will do. A reconstruction is faster on the CPU device than on one; tests run on it.
    pub software: bool,
    /// Whether subgroup operations are used where the adapter has them.
    pub subgroups: bool,
    /// Whether timestamps are taken between the kernels of a training step ([`GpuDevice::stage_times`](super::GpuDevice::stage_times)).
    pub timestamps: bool,
    /// Pixels across and down a tile. Without, steps choose by their images, and images that nobody trains on have the larger tiles.
    pub tile: Option<[u32; 2]>,
    /// Splats that the backward pass takes at once.
    pub batch: u32,
    /// Threads that share a pixel's list in the forward pass: where images are small there are more threads than pixels. Without a number,
    /// steps choose by the size of their images, and images that nobody trains on are drawn by one.
    pub segments: Option<u32>,
    /// Whether two images with one camera are blended in one pass.
    pub fused: bool,
    /// Pairs, and visible Gaussians, there is room for at first, at least; there is always more once a frame has more.
    pub least_room: usize,
    /// Most device memory that keyframes take, bytes; the others wait in main memory until a step names them. A step's own keyframe has room
    /// in any case. What is computed does not depend on it.
    pub keyframe_bytes: u64,
    /// Whether networks multiply in half precision where the adapter has matrix units that their kernels are written for; sums are f32 always.
    pub half: bool,
    /// Fills new working memory with this pattern, so that a test sees what reads before it writes.
    pub poison: Option<u32>,
}

impl Default for GpuOptions {
    fn default() -> Self {
        Self {
            adapter: 0,
            software: false,
            subgroups: true,
            timestamps: false,
            tile: None,
            batch: 32,
            segments: None,
            fused: true,
            least_room: 1 << 16,
            keyframe_bytes: RasterConfig::default().keyframe_bytes(),
            half: false,
            poison: None,
        }
    }
}

impl GpuOptions {
    /// The shapes of tiles, the usual one first.
    pub(crate) fn tiles(&self) -> Vec<[u32; 2]> {
        self.tile.map_or_else(|| TILES.to_vec(), |tile| vec![tile])
    }

    /// # Errors
    /// A tile or batch that the kernels are not written for.
    pub fn validate(&self) -> Result<()> {
        self.tiles().into_iter().try_for_each(|tile| self.validate_tile(tile))
    }

    fn validate_tile(&self, [width, height]: [u32; 2]) -> Result<()> {
        let batch = self.batch;
        let area = width * height;
        // A thread of the forward pass is a pixel; a batch fits into a tile and a tile's pixels into workgroup memory beside others'.
        if let Some(segments) = self.segments
            && (![1, 2, 4].contains(&segments) || segments * area > LARGEST_BLEND)
        {
            let what = format!("{segments} threads for each pixel of {width}x{height}");
            return Err(Error::invalid("gpu options", what, "1, 2 or 4 threads share a pixel, at most 256 a tile"));
        }
        let fits = [8, 16].contains(&width) && [4, 8, 16].contains(&height) && [8, 16, 32].contains(&batch);
        if fits && area % batch == 0 && area <= LARGEST_TILE_IN_BATCHES * batch {
            return Ok(());
        }
        let what = format!("tiles of {width}x{height} with batches of {batch}");
        Err(Error::invalid(
            "gpu options",
            what,
            "tiles are 8 or 16 wide and 4, 8 or 16 high; a batch is 8, 16 or 32 and at least an eighth of a tile",
        ))
    }
}

/// Tiles that steps choose from.
const TILES: [[u32; 2]; 2] = [[8, 8], [8, 4]];
/// Most threads of a workgroup.
pub(crate) const LARGEST_BLEND: u32 = 256;
/// Largest tile in batches.
const LARGEST_TILE_IN_BATCHES: u32 = 8;

/// First error on the device since the last check; later errors are mostly consequences.
#[derive(Default)]
struct Failure {
    first: Option<String>,
    out_of_memory: bool,
    lost: bool,
}

/// Devices come and go one at a time: NVIDIA's driver (580.159) never comes back where one is destroyed while others come or go.
static COMING_AND_GOING: Mutex<()> = Mutex::new(());

/// Held where everything else that belongs to a device is gone, so that it goes here.
struct LastReference(Option<wgpu::Device>);

impl Drop for LastReference {
    fn drop(&mut self) {
        let _turn = locked(&COMING_AND_GOING);
        self.0.take();
    }
}

/// An open adapter; outlives what is made of it.
pub(crate) struct Context {
    pub device: wgpu::Device,
    pub queue: wgpu::Queue,
    pub info: wgpu::AdapterInfo,
    pub limits: wgpu::Limits,
    /// Smallest and largest subgroup, where subgroup operations are used.
    pub subgroups: Option<(u32, u32)>,
    /// Whether timestamps may be written inside a pass.
    pub timestamps: bool,
    /// Whether networks multiply by matrix units.
    pub matrix_units: bool,
    pub poison: Option<u32>,
    /// Bytes beyond which an allocation fails, to try what is done then.
    #[cfg(test)]
    pub most_allocated: std::sync::atomic::AtomicU64,
    failure: Arc<Mutex<Failure>>,
    /// Reference that is dropped last.
    _last: LastReference,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Native adapters answer at once: their futures are ready when first asked.
fn ready<T>(future: impl Future<Output = T>) -> T {
    let mut future = pin!(future);
    let mut context = TaskContext::from_waker(Waker::noop());
    loop {
        if let Poll::Ready(value) = future.as_mut().poll(&mut context) {
            return value;
        }
        std::thread::yield_now();
    }
}

/// Adapters in software by name, where drivers and layers between them and us do not say what they are.
const SOFTWARE: [&str; 5] = ["llvmpipe", "lavapipe", "softpipe", "swiftshader", "microsoft basic render"];

pub(super) fn is_software(info: &wgpu::AdapterInfo) -> bool {
    let name = info.name.to_lowercase();
    info.device_type == wgpu::DeviceType::Cpu || SOFTWARE.iter().any(|known| name.contains(known))
}

/// Better adapters first.
fn rank(info: &wgpu::AdapterInfo) -> u32 {
    match info.device_type {
        _ if is_software(info) => 4,
        wgpu::DeviceType::DiscreteGpu => 0,
        wgpu::DeviceType::IntegratedGpu => 1,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 3,
        wgpu::DeviceType::Cpu => 4,
    }
}

/// Storage buffers the widest kernel binds.
const STORAGE_BUFFERS: u32 = 24;

/// Bytes written at once.
const PIECE: usize = 64 << 20;

/// Graphics APIs that adapters are looked for in.
const BACKENDS: wgpu::Backends = wgpu::Backends::VULKAN.union(wgpu::Backends::METAL).union(wgpu::Backends::DX12);

/// The one way to the drivers of this process: they are loaded once, however many devices come and go.
fn instance() -> &'static wgpu::Instance {
    static INSTANCE: OnceLock<wgpu::Instance> = OnceLock::new();
    INSTANCE.get_or_init(|| {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.backends = BACKENDS;
        // Indirect arguments are written by our own kernels within the limits; checking them costs a pass each.
        descriptor.flags = wgpu::InstanceFlags::empty();
        wgpu::Instance::new(descriptor)
    })
}

/// The adapters that will do, the best first.
pub(super) fn adapters(options: &GpuOptions) -> Vec<wgpu::Adapter> {
    let mut adapters = ready(instance().enumerate_adapters(BACKENDS));
    adapters.retain(|a| options.software || !is_software(&a.get_info()));
    adapters.sort_by_key(|a| rank(&a.get_info()));
    adapters
}

/// What kernels that multiply by matrix units need.
const MATRIX_FEATURES: wgpu::Features =
    wgpu::Features::EXPERIMENTAL_COOPERATIVE_MATRIX.union(wgpu::Features::SHADER_F16).union(wgpu::Features::SUBGROUP);

/// Whether an adapter multiplies matrices of 16 × 16 numbers in f16 with sums in f32, in subgroups of 32 threads always, in workgroups of the size that
/// the kernels have.
fn has_matrix_units(adapter: &wgpu::Adapter) -> bool {
    let info = adapter.get_info();
    let fits = |p: &wgpu::CooperativeMatrixProperties| {
        (p.m_size, p.n_size, p.k_size) == (16, 16, 16)
            && p.ab_type == wgpu::CooperativeScalarType::F16
            && p.cr_type == wgpu::CooperativeScalarType::F32
    };
    adapter.features().contains(MATRIX_FEATURES)
        && adapter.limits().max_compute_invocations_per_workgroup >= MATRIX_THREADS
        && (info.subgroup_min_size, info.subgroup_max_size) == (32, 32)
        && adapter.cooperative_matrix_properties().iter().any(fits)
}

/// Whether [`GpuOptions::half`] makes a difference on the adapter that these options choose.
pub fn multiplies_in_half(options: &GpuOptions) -> bool {
    options.half && adapters(options).get(options.adapter).is_some_and(has_matrix_units)
}

/// The adapter that these options choose, if there is one.
pub fn adapter_name(options: &GpuOptions) -> Option<String> {
    adapters(options).get(options.adapter).map(|a| a.get_info().name)
}

/// Cooperative matrices are an experiment of wgpu's.
fn experimental(wanted: bool) -> wgpu::ExperimentalFeatures {
    if !wanted {
        return wgpu::ExperimentalFeatures::disabled();
    }
    // SAFETY: the kernels that use them are tested against f64 on every adapter that has them.
    unsafe { wgpu::ExperimentalFeatures::enabled() }
}

impl Context {
    pub fn open(options: &GpuOptions) -> Result<Self> {
        let _turn = locked(&COMING_AND_GOING);
        let adapters = adapters(options);
        let Some(adapter) = adapters.get(options.adapter) else {
            let what = match adapters.len() {
                0 if options.software => "no adapter was found".to_owned(),
                0 => "no GPU was found".to_owned(),
                _ => {
                    let names: Vec<String> =
                        adapters.iter().enumerate().map(|(n, a)| format!("{n}: {}", a.get_info().name)).collect();
                    format!("number {} was asked for, and there are {}", options.adapter, names.join(", "))
                }
            };
            return Err(Error::invalid(
                "gpu",
                what,
                "install a Vulkan driver (or use Metal, DirectX 12), or choose --device cpu",
            ));
        };
        let info = adapter.get_info();
        let limits = adapter.limits();
        let (have, need) = (limits.max_storage_buffers_per_shader_stage, STORAGE_BUFFERS);
        if have < need {
            let what = format!("{} binds {have} storage buffers at once and {need} are needed", info.name);
            return Err(Error::invalid("gpu", what, "choose another adapter or --device cpu"));
        }
        let stamps = wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::TIMESTAMP_QUERY_INSIDE_PASSES;
        let mut wanted = wgpu::Features::empty();
        wanted.set(wgpu::Features::SUBGROUP, options.subgroups);
        wanted.set(stamps, options.timestamps);
        let matrix_units = options.half && has_matrix_units(adapter);
        wanted.set(MATRIX_FEATURES, matrix_units);
        let features = adapter.features() & wanted;
        let opened = ready(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("corf"),
            required_features: features,
            required_limits: limits.clone(),
            experimental_features: experimental(matrix_units),
            memory_hints: wgpu::MemoryHints::Performance,
            trace: wgpu::Trace::Off,
        }));
        let (device, queue) = opened.map_err(|e| {
            Error::invalid("gpu", format!("{} could not be opened: {e}", info.name), "close what uses it, or choose --device cpu")
        })?;
        let failure = Arc::new(Mutex::new(Failure::default()));
        let on_error = Arc::clone(&failure);
        device.on_uncaptured_error(Arc::new(move |error: wgpu::Error| {
            let mut failure = locked(&on_error);
            failure.out_of_memory |= matches!(error, wgpu::Error::OutOfMemory { .. });
            failure.first.get_or_insert_with(|| error.to_string());
        }));
        let on_loss = Arc::clone(&failure);
        device.set_device_lost_callback(move |_, text| {
            let mut failure = locked(&on_loss);
            failure.lost = true;
            failure.first.get_or_insert(text);
        });
        // Ballots are read as one word.
        let usable = features.contains(wgpu::Features::SUBGROUP) && info.subgroup_max_size <= 32;
        let subgroups = (usable && info.subgroup_min_size >= 4).then_some((info.subgroup_min_size, info.subgroup_max_size));
        Ok(Self {
            timestamps: features.contains(stamps),
            matrix_units,
            poison: options.poison,
            #[cfg(test)]
            most_allocated: u64::MAX.into(),
            _last: LastReference(Some(device.clone())),
            device,
            queue,
            info,
            limits,
            subgroups,
            failure,
        })
    }

    pub fn is_software(&self) -> bool {
        is_software(&self.info)
    }

    /// Simulates a failed allocation.
    #[cfg(test)]
    pub fn pretend_out_of_memory(&self) {
        let mut failure = locked(&self.failure);
        failure.out_of_memory = true;
        failure.first = Some("not enough memory left".to_owned());
    }

    /// Checks the device for errors since the last check, and returns the first as an error of this crate.
    pub fn check(&self, doing: &str) -> Result<()> {
        if locked(&self.failure).first.is_none() {
            return Ok(());
        }
        // A device that is gone shows first in what it no longer does; that it is gone is told when it is polled.
        let _ = self.device.poll(wgpu::PollType::Poll);
        let mut failure = locked(&self.failure);
        let Some(text) = failure.first.clone() else { return Ok(()) };
        let place = format!("gpu ({}), {doing}", self.info.name);
        if failure.lost {
            // Stays: nothing will work on this device again.
            return Err(Error::invalid(
                place,
                format!("the device was lost: {text}"),
                "start again; --resume keeps what is finished",
            ));
        }
        let out_of_memory = failure.out_of_memory;
        *failure = Failure::default();
        if out_of_memory {
            return Err(Error::invalid(place, "out of memory", "use fewer Gaussians or smaller images, or choose --device cpu"));
        }
        Err(Error::invalid(place, text, "this is a defect of the device or its driver; --device cpu avoids it"))
    }

    /// Most bytes that one buffer may have, in whole units of what buffers are made of.
    pub fn largest_buffer(&self) -> u64 {
        self.limits.max_storage_buffer_binding_size.min(self.limits.max_buffer_size) / BUFFER_UNIT * BUFFER_UNIT
    }

    /// Memory of at least `bytes`, its contents undefined.
    pub fn buffer(&self, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> Result<wgpu::Buffer> {
        let size = bytes.max(1).next_multiple_of(BUFFER_UNIT);
        let largest = self.largest_buffer();
        if size > largest {
            let what = format!("{label} needs {} MiB and the adapter binds at most {} MiB at once", size >> 20, largest >> 20);
            let place = format!("gpu ({})", self.info.name);
            return Err(Error::invalid(place, what, "use fewer Gaussians or smaller images, or choose --device cpu"));
        }
        let usage = usage | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
        let buffer =
            self.device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false });
        #[cfg(test)]
        if size > self.most_allocated.load(std::sync::atomic::Ordering::Relaxed) {
            self.pretend_out_of_memory();
        }
        self.check(label)?;
        if let Some(pattern) = self.poison {
            self.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&vec![pattern; size as usize / 4]));
        }
        Ok(buffer)
    }

    /// A storage buffer.
    pub fn storage(&self, label: &str, bytes: u64) -> Result<wgpu::Buffer> {
        self.buffer(label, bytes, wgpu::BufferUsages::STORAGE)
    }

    /// Writes numbers at a byte, in pieces, so that the memory in which they travel is soon free again.
    pub fn fill<T: bytemuck::Pod>(&self, buffer: &wgpu::Buffer, at: u64, values: &[T]) {
        let bytes: &[u8] = bytemuck::cast_slice(values);
        for (k, piece) in bytes.chunks(PIECE).enumerate() {
            self.queue.write_buffer(buffer, at + (k * PIECE) as u64, piece);
            if bytes.len() > PIECE {
                self.queue.submit([]);
            }
        }
    }

    pub fn encoder(&self) -> wgpu::CommandEncoder {
        self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: None })
    }

    pub fn submit(&self, encoder: wgpu::CommandEncoder) {
        self.queue.submit([encoder.finish()]);
    }

    /// Waits for everything submitted.
    pub fn wait(&self, doing: &str) -> Result<()> {
        let waited = self.device.poll(wgpu::PollType::wait_indefinitely());
        self.check(doing)?;
        waited.map(|_| ()).map_err(|e| {
            Error::invalid(format!("gpu ({}), {doing}", self.info.name), e.to_string(), "start again, or choose --device cpu")
        })
    }

    /// Reads the first `count` numbers of several buffers back in one go, after all that was submitted.
    pub fn read<T: bytemuck::Pod>(&self, doing: &'static str, sources: &[(&wgpu::Buffer, usize)]) -> Result<Vec<Vec<T>>> {
        self.begin_reading::<T>(doing, sources)?.finish(self)
    }

    /// Has the first `count` numbers of several buffers copied as they are after all that was submitted.
    pub fn begin_reading<T: bytemuck::Pod>(&self, doing: &'static str, sources: &[(&wgpu::Buffer, usize)]) -> Result<Reading<T>> {
        let mut encoder = self.encoder();
        let mut staging = vec![];
        for &(buffer, count) in sources {
            let bytes = (count * size_of::<T>()) as u64;
            let size = bytes.max(4).next_multiple_of(4);
            let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
            let target = self.device.create_buffer(&wgpu::BufferDescriptor {
                label: Some("readback"),
                size,
                usage,
                mapped_at_creation: false,
            });
            encoder.copy_buffer_to_buffer(buffer, 0, &target, 0, size);
            staging.push((target, bytes));
        }
        self.check(doing)?;
        self.submit(encoder);
        for (target, _) in &staging {
            // A mapping that fails is found again when the range is asked for.
            target.map_async(wgpu::MapMode::Read, .., |_| {});
        }
        Ok(Reading { doing, staging, numbers: PhantomData })
    }
}

/// Numbers on their way back.
pub(crate) struct Reading<T> {
    doing: &'static str,
    /// Each with its bytes.
    staging: Vec<(wgpu::Buffer, u64)>,
    numbers: PhantomData<T>,
}

impl<T: bytemuck::Pod> Reading<T> {
    /// Waits for them.
    pub fn finish(self, context: &Context) -> Result<Vec<Vec<T>>> {
        context.wait(self.doing)?;
        let mut out = vec![];
        for (target, bytes) in &self.staging {
            let range = target.get_mapped_range(..*bytes.max(&4)).map_err(|e| {
                let place = format!("gpu ({}), {}", context.info.name, self.doing);
                Error::invalid(place, e.to_string(), "start again, or choose --device cpu")
            })?;
            out.push(bytemuck::pod_collect_to_vec(&range[..*bytes as usize]));
        }
        Ok(out)
    }
}
