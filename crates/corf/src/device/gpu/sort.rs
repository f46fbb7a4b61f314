//! Stable radix sort of (key, value) words, 8 bits a pass, with the number of keys in device memory.
//!
//! A pass is three kernels (counts, sums, scatter) and no assumption about which workgroups run at once, so that it works on any
//! adapter; the scatter ranks equal digits by subgroup ballots where there are subgroups, and in workgroup memory where not.

use super::{
    context::Context,
    kernel::{Bound, Kernel},
};
use crate::Result;

/// Keys per thread.
const ITEMS: u32 = 8;
/// Threads of the kernels that scan.
const SCAN: u32 = 256;
/// Digits of a pass.
pub(crate) const DIGITS: u32 = 256;

/// A pass's constants: uniform, 16 bytes.
#[derive(Clone, Copy, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(C)]
pub(crate) struct SortPass {
    pub shift: u32,
    pub count_slot: u32,
    pub stride: u32,
    pub flags: u32,
}

/// Values are the keys' places; `values` is not read.
pub(crate) const IMPLICIT_VALUES: u32 = 1;
/// Keys of all ones are left out; the sorted run is shorter.
pub(crate) const SKIP_SENTINELS: u32 = 2;

/// How many workgroups a pass runs.
#[derive(Clone, Copy)]
pub(crate) enum Groups<'a> {
    Direct(u32),
    Indirect(&'a wgpu::Buffer, u64),
}

pub(crate) struct RadixSort {
    histogram: Kernel,
    rows: Kernel,
    scatter: Kernel,
    /// Keys per workgroup.
    pub block: u32,
}

/// The memory of one pass.
pub(crate) struct PassBuffers<'a> {
    /// [`SortPass`]es at dynamic offsets.
    pub uniform: &'a wgpu::Buffer,
    pub state: &'a wgpu::Buffer,
    pub keys: &'a wgpu::Buffer,
    pub values: &'a wgpu::Buffer,
    pub sorted_keys: &'a wgpu::Buffer,
    pub sorted_values: &'a wgpu::Buffer,
    /// [`DIGITS`] × stride words.
    pub histogram: &'a wgpu::Buffer,
    /// [`DIGITS`] words: keys of each digit.
    pub totals: &'a wgpu::Buffer,
}

pub(crate) struct BoundPass {
    histogram: Bound,
    rows: Bound,
    scatter: Bound,
}

impl RadixSort {
    pub fn new(context: &Context) -> Result<Self> {
        // Eight lane groups a workgroup, as many threads as that makes: 8 KiB of counters.
        let (threads, lanes) = match context.subgroups {
            Some((min, _)) => ((8 * min).clamp(32, SCAN), include_str!("shaders/lanes_subgroup.wgsl")),
            None => (SCAN, include_str!("shaders/lanes_portable.wgsl")),
        };
        let groups = context.subgroups.map_or(8, |(min, _)| threads / min);
        let block = threads * ITEMS;
        let head = |scan: u32| {
            format!(
                "const SORT_THREADS = {threads}u;\nconst SORT_ITEMS = {ITEMS}u;\nconst SORT_BLOCK = {block}u;\n\
                 const SORT_GROUPS = {groups}u;\nconst SCAN = {scan}u;\n{}{}{}",
                include_str!("shaders/groups.wgsl"),
                include_str!("shaders/radix.wgsl"),
                include_str!("shaders/scan.wgsl"),
            )
        };
        let histogram = head(SCAN) + include_str!("shaders/radix_histogram.wgsl");
        let rows = head(SCAN) + include_str!("shaders/radix_rows.wgsl");
        let scatter = head(threads) + include_str!("shaders/radix_scatter.wgsl") + lanes;
        Ok(Self {
            histogram: Kernel::new(context, "radix histogram", &histogram)?,
            rows: Kernel::new(context, "radix rows", &rows)?,
            scatter: Kernel::new(context, "radix scatter", &scatter)?,
            block,
        })
    }

    pub fn bind(&self, context: &Context, b: &PassBuffers<'_>) -> Result<BoundPass> {
        const UNIFORM: u64 = size_of::<SortPass>() as u64;
        Ok(BoundPass {
            histogram: self.histogram.bind(context, UNIFORM, &[b.uniform, b.state, b.keys, b.histogram])?,
            rows: self.rows.bind(context, UNIFORM, &[b.uniform, b.state, b.histogram, b.totals])?,
            scatter: self.scatter.bind(
                context,
                UNIFORM,
                &[b.uniform, b.state, b.keys, b.values, b.histogram, b.totals, b.sorted_keys, b.sorted_values],
            )?,
        })
    }
}

impl BoundPass {
    /// Counts and sums.
    pub fn count(&self, pass: &mut wgpu::ComputePass<'_>, offset: u32, groups: Groups<'_>) {
        run(&self.histogram, pass, offset, groups);
        self.rows.run(pass, offset, DIGITS);
    }

    /// Scatter.
    pub fn scatter(&self, pass: &mut wgpu::ComputePass<'_>, offset: u32, groups: Groups<'_>) {
        run(&self.scatter, pass, offset, groups);
    }
}

fn run(bound: &Bound, pass: &mut wgpu::ComputePass<'_>, offset: u32, groups: Groups<'_>) {
    match groups {
        Groups::Direct(n) => bound.run(pass, offset, n),
        Groups::Indirect(args, slot) => bound.run_indirect(pass, offset, args, slot),
    }
}

#[cfg(test)]
mod tests;
