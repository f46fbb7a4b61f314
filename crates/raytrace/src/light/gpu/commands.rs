//! Passes on their way to the device: several travel together, each with settings of its own.

use super::GpuLight;
use super::params::{PARAMS_BYTES, Params};
use corf_gpu::{Bound, UNIFORM_STRIDE};

/// Bytes from one pass's settings to the next's.
const STRIDE: u64 = PARAMS_BYTES.next_multiple_of(UNIFORM_STRIDE);
/// Passes that travel together at most.
const AT_ONCE: usize = 16;
/// Bytes of the uniform.
pub(super) const UNIFORM_BYTES: u64 = STRIDE * AT_ONCE as u64;

/// Passes that wait for each other to be handed to the device.
pub(super) struct Commands<'g, 'a> {
    gpu: &'g GpuLight<'a>,
    what: &'static str,
    passes: Vec<(Bound, u32)>,
    settings: Vec<u32>,
}

impl<'g, 'a> Commands<'g, 'a> {
    /// None yet; their time on the device counts as `what`'s.
    pub fn new(gpu: &'g GpuLight<'a>, what: &'static str) -> Self {
        Self { gpu, what, passes: Vec::new(), settings: Vec::new() }
    }

    /// A kernel in so many workgroups.
    pub fn run(&mut self, bound: &Bound, params: &Params, groups: u32) {
        if groups == 0 {
            return;
        }
        if self.passes.len() == AT_ONCE {
            self.submit();
        }
        self.passes.push((bound.clone(), groups));
        self.settings.extend_from_slice(bytemuck::cast_slice(std::slice::from_ref(params)));
        self.settings.resize(self.passes.len() * STRIDE as usize / 4, 0);
    }

    /// A kernel over `count` places with a thread each.
    pub fn over(&mut self, bound: &Bound, params: &Params, count: u32) {
        self.run(bound, &Params { first: 0, count, ..*params }, count.div_ceil(super::GROUP));
    }

    /// Hands over what there is.
    pub fn submit(&mut self) {
        let Self { gpu, what, passes, settings } = self;
        if passes.is_empty() {
            return;
        }
        gpu.context.fill(&gpu.uniform, 0, settings);
        let mut encoder = gpu.context.encoder();
        let timestamp_writes = gpu.clock.stamp(what);
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor { label: Some(what), timestamp_writes });
        for (k, (bound, groups)) in passes.iter().enumerate() {
            bound.run(&mut pass, k as u32 * STRIDE as u32, *groups);
        }
        drop(pass);
        gpu.context.submit(encoder);
        passes.clear();
        settings.clear();
    }
}
