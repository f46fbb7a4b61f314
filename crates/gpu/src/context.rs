//! A device on an adapter, and the smallest runtime over it: buffers, submissions, readback, and errors that say what happened.

use crate::adapter::{AdapterOptions, MATRIX_FEATURES, adapters, has_matrix_units, is_software, ready};
use crate::memory::Share;
use corf_scene::{Error, Result};
use std::{
    marker::PhantomData,
    sync::{
        Arc, Mutex, MutexGuard, PoisonError,
        atomic::{AtomicU64, Ordering},
    },
};

/// Bytes that sizes of buffers are multiples of.
const BUFFER_UNIT: u64 = 16;

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
pub struct Context {
    /// Its device.
    pub device: wgpu::Device,
    /// The device's queue.
    pub queue: wgpu::Queue,
    /// Name, kind and driver.
    pub info: wgpu::AdapterInfo,
    /// All that the adapter can do.
    pub limits: wgpu::Limits,
    /// Smallest and largest subgroup, where subgroup operations are used.
    pub subgroups: Option<(u32, u32)>,
    /// Whether timestamps may be written inside a pass.
    pub timestamps: bool,
    /// Whether matrices are multiplied by matrix units.
    pub matrix_units: bool,
    /// Pattern that new memory is filled with.
    poison: Option<u32>,
    /// Bytes beyond which a buffer finds no memory ([`Self::limit_allocations`]).
    most_allocated: AtomicU64,
    /// Memory that readings came through and that others may take.
    staging: Mutex<Vec<wgpu::Buffer>>,
    failure: Arc<Mutex<Failure>>,
    /// What its buffers take of this process's device memory.
    memory: Share,
    /// Reference that is dropped last.
    _last: LastReference,
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Storage buffers that a kernel can bind at once on every device that is opened.
pub const STORAGE_BUFFERS: u32 = 24;

/// Bytes written at once.
const PIECE: usize = 64 << 20;

/// Cooperative matrices are an experiment of wgpu's.
fn experimental(wanted: bool) -> wgpu::ExperimentalFeatures {
    if !wanted {
        return wgpu::ExperimentalFeatures::disabled();
    }
    // SAFETY: the kernels that use them are tested against f64 on every adapter that has them.
    unsafe { wgpu::ExperimentalFeatures::enabled() }
}

impl Context {
    /// Opens the adapter that the options choose.
    ///
    /// # Errors
    /// No such adapter; one that binds fewer than [`STORAGE_BUFFERS`]; the driver's.
    pub fn open(options: &AdapterOptions) -> Result<Self> {
        let _turn = locked(&COMING_AND_GOING);
        let adapters = adapters(options);
        let Some(adapter) = adapters.get(options.number) else {
            let what = match adapters.len() {
                0 if options.software => "no adapter was found".to_owned(),
                0 => "no GPU was found".to_owned(),
                _ => {
                    let names: Vec<String> =
                        adapters.iter().enumerate().map(|(n, a)| format!("{n}: {}", a.get_info().name)).collect();
                    format!("number {} was asked for, and there are {}", options.number, names.join(", "))
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
            most_allocated: u64::MAX.into(),
            staging: Mutex::default(),
            memory: Share::default(),
            _last: LastReference(Some(device.clone())),
            device,
            queue,
            info,
            limits,
            subgroups,
            failure,
        })
    }

    /// Whether it computes on the processor.
    pub fn is_software(&self) -> bool {
        is_software(&self.info)
    }

    /// Lets buffers of more bytes find no memory from here on, so that a test sees what is done then.
    pub fn limit_allocations(&self, most_bytes: u64) {
        self.most_allocated.store(most_bytes, Ordering::Relaxed);
    }

    /// Lets the next check find that memory ran out, so that a test sees what is done then.
    pub fn pretend_out_of_memory(&self) {
        let mut failure = locked(&self.failure);
        failure.out_of_memory = true;
        failure.first = Some("not enough memory left".to_owned());
    }

    /// Checks the device for errors since the last check; `doing` says in the error what was being done.
    ///
    /// # Errors
    /// The first since the last check; that of a device that was lost, every time.
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
            return Err(Error::invalid(
                place,
                "out of memory",
                "ask for less at once (a smaller field, smaller images), or choose --device cpu",
            ));
        }
        Err(Error::invalid(place, text, "this is a defect of the device or its driver; --device cpu avoids it"))
    }

    /// Most bytes that one buffer may have, in whole units of what buffers are made of.
    pub fn largest_buffer(&self) -> u64 {
        self.limits.max_storage_buffer_binding_size.min(self.limits.max_buffer_size) / BUFFER_UNIT * BUFFER_UNIT
    }

    /// Memory of at least `bytes`, its contents undefined, that can be copied to and from.
    ///
    /// # Errors
    /// More than [`Self::largest_buffer`]; no memory.
    pub fn buffer(&self, label: &str, bytes: u64, usage: wgpu::BufferUsages) -> Result<wgpu::Buffer> {
        let size = bytes.max(1).next_multiple_of(BUFFER_UNIT);
        let largest = self.largest_buffer();
        if size > largest {
            let what = format!("{label} needs {} MiB and the adapter binds at most {} MiB at once", size >> 20, largest >> 20);
            let place = format!("gpu ({})", self.info.name);
            return Err(Error::invalid(
                place,
                what,
                "ask for less at once (a smaller field, smaller images), or choose --device cpu",
            ));
        }
        let usage = usage | wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::COPY_SRC;
        let buffer =
            self.device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false });
        if size > self.most_allocated.load(Ordering::Relaxed) {
            self.pretend_out_of_memory();
        }
        self.check(label)?;
        self.memory.look(&self.device);
        if let Some(pattern) = self.poison {
            self.queue.write_buffer(&buffer, 0, bytemuck::cast_slice(&vec![pattern; size as usize / 4]));
        }
        Ok(buffer)
    }

    /// A storage buffer, as [`Self::buffer`] makes them.
    ///
    /// # Errors
    /// Those of [`Self::buffer`].
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

    /// An empty list of commands.
    pub fn encoder(&self) -> wgpu::CommandEncoder {
        self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor { label: None })
    }

    /// Hands commands to the queue.
    pub fn submit(&self, encoder: wgpu::CommandEncoder) {
        self.memory.look(&self.device);
        self.queue.submit([encoder.finish()]);
    }

    /// Waits for everything submitted.
    ///
    /// # Errors
    /// Those of [`Self::check`].
    pub fn wait(&self, doing: &str) -> Result<()> {
        self.wait_until(wgpu::PollType::wait_indefinitely(), doing)
    }

    /// Waits as `until` says.
    ///
    /// # Errors
    /// Those of [`Self::check`].
    fn wait_until(&self, until: wgpu::PollType, doing: &str) -> Result<()> {
        let waited = self.device.poll(until);
        if waited.is_err() {
            // Of a device that is gone, what was submitted is unknown before the loss is told: by another poll.
            let _ = self.device.poll(wgpu::PollType::Poll);
        }
        self.check(doing)?;
        waited.map(|_| ()).map_err(|e| self.failed(doing, e.to_string()))
    }

    /// What went wrong on this device, and nobody knows why.
    fn failed(&self, doing: &str, text: String) -> Error {
        Error::invalid(format!("gpu ({}), {doing}", self.info.name), text, "start again, or choose --device cpu")
    }

    /// Reads the first `count` numbers of several buffers back in one go, after all that was submitted.
    ///
    /// # Errors
    /// Those of [`Self::check`].
    pub fn read<T: bytemuck::Pod>(&self, doing: &'static str, sources: &[(&wgpu::Buffer, usize)]) -> Result<Vec<Vec<T>>> {
        self.begin_reading::<T>(doing, sources)?.finish(self)
    }

    /// Has the first `count` numbers of several buffers copied as they are after all that was submitted.
    ///
    /// # Errors
    /// Those of [`Self::check`].
    pub fn begin_reading<T: bytemuck::Pod>(&self, doing: &'static str, sources: &[(&wgpu::Buffer, usize)]) -> Result<Reading<T>> {
        let whole: Vec<_> = sources.iter().map(|&(buffer, count)| (buffer, 0, count)).collect();
        self.begin_reading_parts(doing, &whole)
    }

    /// [`Self::begin_reading`] of parts of buffers: of each the first number and how many there are, both of whole words of four bytes.
    ///
    /// # Errors
    /// Those of [`Self::check`].
    pub fn begin_reading_parts<T: bytemuck::Pod>(
        &self,
        doing: &'static str,
        sources: &[(&wgpu::Buffer, usize, usize)],
    ) -> Result<Reading<T>> {
        let mut encoder = self.encoder();
        let mut staging = vec![];
        for &(buffer, first, count) in sources {
            let bytes = (count * size_of::<T>()) as u64;
            let size = bytes.max(4).next_multiple_of(4);
            let target = self.staging(size);
            encoder.copy_buffer_to_buffer(buffer, (first * size_of::<T>()) as u64, &target, 0, size);
            staging.push((target, bytes));
        }
        self.check(doing)?;
        let submission = self.queue.submit([encoder.finish()]);
        for (target, _) in &staging {
            // A mapping that fails is found again when the range is asked for.
            target.map_async(wgpu::MapMode::Read, .., |_| {});
        }
        Ok(Reading { doing, staging, submission, numbers: PhantomData })
    }

    /// Memory that can be read here: new memory takes the driver milliseconds, so what has been used is used again.
    fn staging(&self, size: u64) -> wgpu::Buffer {
        let fits = |buffer: &wgpu::Buffer| (size..=STAGING_SLACK.max(2 * size)).contains(&buffer.size());
        let mut idle = locked(&self.staging);
        if let Some(at) = idle.iter().position(fits) {
            return idle.swap_remove(at);
        }
        drop(idle);
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        self.device.create_buffer(&wgpu::BufferDescriptor { label: Some("readback"), size, usage, mapped_at_creation: false })
    }
}

/// Idle memory of readings that is kept: so many buffers, of so many bytes each at most; and the size below which any will do.
const STAGING_KEPT: usize = 8;
const STAGING_BYTES: u64 = 32 << 20;
const STAGING_SLACK: u64 = 1 << 20;

/// Numbers on their way back.
pub struct Reading<T> {
    doing: &'static str,
    /// Each with its bytes.
    staging: Vec<(wgpu::Buffer, u64)>,
    /// What they are copied by.
    submission: wgpu::SubmissionIndex,
    numbers: PhantomData<T>,
}

impl<T: bytemuck::Pod> Reading<T> {
    /// Waits for them, and for nothing that was submitted later.
    ///
    /// # Errors
    /// Those of [`Context::check`].
    pub fn finish(self, context: &Context) -> Result<Vec<Vec<T>>> {
        let until = wgpu::PollType::Wait { submission_index: Some(self.submission), timeout: None };
        context.wait_until(until, self.doing)?;
        let mut out = vec![];
        for (target, bytes) in self.staging {
            {
                let range = target.get_mapped_range(..bytes.max(4)).map_err(|e| context.failed(self.doing, e.to_string()))?;
                out.push(bytemuck::pod_collect_to_vec(&range[..bytes as usize]));
            }
            target.unmap();
            let mut idle = locked(&context.staging);
            if target.size() <= STAGING_BYTES && idle.len() < STAGING_KEPT {
                idle.push(target);
            }
        }
        Ok(out)
    }
}
