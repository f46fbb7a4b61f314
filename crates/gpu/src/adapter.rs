//! The adapters of this machine, and which of them is meant.

use std::{
    future::Future,
    pin::pin,
    sync::OnceLock,
    task::{Context as TaskContext, Poll, Waker},
};

/// Options of a device: the adapter, and the features of it to use.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AdapterOptions {
    /// Index of the adapter, from 0, where a machine has several: the best kind first, those of one kind as the drivers list them.
    pub number: usize,
    /// Whether a software adapter will do. Most work is faster on the processor itself than on one; tests run on it.
    pub software: bool,
    /// Whether subgroup operations are used where the adapter has them.
    pub subgroups: bool,
    /// Whether timestamps can be taken between kernels where the adapter takes them.
    pub timestamps: bool,
    /// Whether matrices are multiplied in half precision where the adapter has matrix units of the kind that kernels are written for; sums are
    /// f32 always.
    pub half: bool,
    /// Fills new working memory with this pattern, so that a test sees what reads before it writes.
    pub poison: Option<u32>,
}

impl Default for AdapterOptions {
    fn default() -> Self {
        Self { number: 0, software: false, subgroups: true, timestamps: false, half: false, poison: None }
    }
}

/// Threads of the largest workgroup that multiplies by matrix units; an adapter that runs fewer has none for us.
pub const MATRIX_THREADS: u32 = 512;

/// Native adapters answer at once: their futures are ready when first asked.
pub(crate) fn ready<T>(future: impl Future<Output = T>) -> T {
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

pub(crate) fn is_software(info: &wgpu::AdapterInfo) -> bool {
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
pub(crate) fn adapters(options: &AdapterOptions) -> Vec<wgpu::Adapter> {
    let mut adapters = ready(instance().enumerate_adapters(BACKENDS));
    adapters.retain(|a| options.software || !is_software(&a.get_info()));
    adapters.sort_by_key(|a| rank(&a.get_info()));
    adapters
}

/// Features that kernels need which multiply by matrix units.
pub(crate) const MATRIX_FEATURES: wgpu::Features =
    wgpu::Features::EXPERIMENTAL_COOPERATIVE_MATRIX.union(wgpu::Features::SHADER_F16).union(wgpu::Features::SUBGROUP);

/// Whether an adapter multiplies matrices of 16 × 16 numbers in f16 with sums in f32, in subgroups of 32 threads always, in workgroups of the size that
/// the kernels have.
pub(crate) fn has_matrix_units(adapter: &wgpu::Adapter) -> bool {
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

/// Whether [`AdapterOptions::half`] makes a difference on the adapter that these options choose.
pub fn multiplies_in_half(options: &AdapterOptions) -> bool {
    options.half && adapters(options).get(options.number).is_some_and(has_matrix_units)
}

/// The adapter that these options choose, if there is one.
pub fn adapter_name(options: &AdapterOptions) -> Option<String> {
    adapters(options).get(options.number).map(|a| a.get_info().name)
}

/// Names of every adapter, those in software included, as [`AdapterOptions::number`] counts them, and whether each computes on the processor. None is
/// opened.
pub fn adapter_names() -> Vec<(String, bool)> {
    let options = AdapterOptions { software: true, ..AdapterOptions::default() };
    let named = |adapter: &wgpu::Adapter| (adapter.get_info().name, is_software(&adapter.get_info()));
    adapters(&options).iter().map(named).collect()
}
