//! What the adapters of this machine can do, for whoever looks for the reason why one is not used.

use crate::adapter::{AdapterOptions, adapters, is_software};
use crate::context::Context;

/// An adapter as its driver describes it, and whether it was opened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AdapterReport {
    /// Its name; [`AdapterOptions::number`] is its place in the list.
    pub name: String,
    /// Graphics API: `Vulkan`, `Metal`, `Dx12`.
    pub backend: String,
    /// Driver and its version.
    pub driver: String,
    /// Whether it computes on the processor.
    pub software: bool,
    /// Smallest and largest subgroup, where it has subgroup operations.
    pub subgroup: Option<[u32; 2]>,
    /// Whether it takes timestamps within passes.
    pub timestamps: bool,
    /// Largest storage buffer that a kernel can bind, bytes.
    pub largest_buffer_bytes: u64,
    /// Storage buffers that a kernel can bind at once.
    pub storage_buffers: u32,
    /// Whether a device could be opened on it, or why not.
    pub usable: Result<(), String>,
}

/// Every adapter, those in software included, the best first; each is opened for a moment.
pub fn adapter_reports() -> Vec<AdapterReport> {
    let options = AdapterOptions { software: true, ..AdapterOptions::default() };
    let describe = |(number, adapter): (usize, &wgpu::Adapter)| {
        let (info, limits, features) = (adapter.get_info(), adapter.limits(), adapter.features());
        let stamps = wgpu::Features::TIMESTAMP_QUERY | wgpu::Features::TIMESTAMP_QUERY_INSIDE_PASSES;
        let opened = Context::open(&AdapterOptions { number, ..options });
        AdapterReport {
            software: is_software(&info),
            backend: format!("{:?}", info.backend),
            driver: [info.driver.as_str(), info.driver_info.as_str()].join(" ").trim().to_owned(),
            subgroup: features.contains(wgpu::Features::SUBGROUP).then_some([info.subgroup_min_size, info.subgroup_max_size]),
            timestamps: features.contains(stamps),
            largest_buffer_bytes: limits.max_storage_buffer_binding_size,
            storage_buffers: limits.max_storage_buffers_per_shader_stage,
            usable: opened.map(|_| ()).map_err(|e| e.to_string()),
            name: info.name,
        }
    };
    adapters(&options).iter().enumerate().map(describe).collect()
}
