//! The forward pass as device work: projection, depth order, tile lists, blending; both modalities in one list of pairs and one blend.

use super::{
    context::Context,
    kernel::{Bound, Kernel},
    params::{self, Params},
    shaders::Fixed,
    sort::{BoundPass, DIGITS, Groups, IMPLICIT_VALUES, PassBuffers, RadixSort, SKIP_SENTINELS, SortPass},
    store::Store,
};
use crate::Result;

/// Words of the state (`shaders/groups.wgsl`), and the places of what is read back.
pub(crate) const STATE_WORDS: usize = 8;
pub(crate) const VISIBLE: usize = 1;
pub(crate) const FAILED: usize = 3;
pub(crate) const NEEDED: usize = 4;
pub(crate) const STEPS: usize = 5;
const PAIRS: u32 = 2;

/// Slots of the indirect arguments (`shaders/args.wgsl`).
const ARGS_DEPTH_SORT: u64 = 0;
const ARGS_VISIBLE_256: u64 = 1;
pub(crate) const ARGS_VISIBLE_64: u64 = 2;
const ARGS_PAIR_SORT: u64 = 3;
const ARGS_PAIRS_256: u64 = 4;
const ARGS: u64 = 5;

/// Radix passes over the depths.
const DEPTH_PASSES: u32 = 4;
/// Most radix passes over the tiles.
const TILE_PASSES: u32 = 3;
/// Bytes from one pass's constants to the next.
const SORT_STRIDE: u32 = 256;
/// Pairs there is room for at first, at least.
const LEAST_PAIRS: usize = 1 << 16;

/// A buffer that is replaced by a larger one when it is too small; its contents are then lost.
pub(crate) struct Scratch {
    label: &'static str,
    pub buffer: wgpu::Buffer,
}

impl Scratch {
    fn new(context: &Context, label: &'static str) -> Result<Self> {
        Ok(Self { label, buffer: context.storage(label, 16)? })
    }

    /// Room for `count` items of `bytes` bytes each.
    fn reserve(&mut self, context: &Context, count: usize, bytes: usize) -> Result<()> {
        let size = (count * bytes) as u64;
        if self.buffer.size() < size {
            // The old memory is given back before the new is asked for.
            self.buffer.destroy();
            self.buffer = context.storage(self.label, size + size / 4)?;
        }
        Ok(())
    }
}

/// Working memory of a frame.
pub(crate) struct Memory {
    pub state: wgpu::Buffer,
    pub args: wgpu::Buffer,
    sort_passes: wgpu::Buffer,
    /// Depth keys and Gaussians' numbers, there and back.
    depth: [Scratch; 2],
    pub order: [Scratch; 2],
    pub tile_counts: Scratch,
    pub offsets: Scratch,
    block_sums: Scratch,
    pub splats: Scratch,
    /// Tiles of the pairs and the pairs' numbers, there and back.
    tiles: [Scratch; 2],
    pairs: [Scratch; 2],
    pub owners: Scratch,
    pub records: Scratch,
    histogram: Scratch,
    totals: wgpu::Buffer,
    pub starts: Scratch,
    pub image: Scratch,
    pub transmittance: Scratch,
    pub main_contributor: Scratch,
    pub derivatives: Scratch,
    pub gradient: Scratch,
    pub block_losses: Scratch,
    pub pair_capacity: usize,
}

/// What a batch of frames needs room for.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Extent {
    pub gaussians: usize,
    pub tiles: usize,
    pub pixels: usize,
    pub blocks: usize,
    pub training: bool,
}

impl Extent {
    pub fn include(&mut self, p: &Params) {
        self.tiles = self.tiles.max(p.tile_total as usize);
        self.pixels = self.pixels.max(p.pixel_total as usize);
        self.blocks = self.blocks.max(p.blocks_total as usize);
    }
}

impl Memory {
    pub fn new(context: &Context) -> Result<Self> {
        let scratch = |label| Scratch::new(context, label);
        let two = |a, b| -> Result<[Scratch; 2]> { Ok([scratch(a)?, scratch(b)?]) };
        let storage = wgpu::BufferUsages::STORAGE;
        let passes = u64::from(SORT_STRIDE * (DEPTH_PASSES + TILE_PASSES));
        Ok(Self {
            state: context.storage("state", 4 * STATE_WORDS as u64)?,
            args: context.buffer("indirect arguments", ARGS * 16, storage | wgpu::BufferUsages::INDIRECT)?,
            sort_passes: context.buffer("sort passes", passes, wgpu::BufferUsages::UNIFORM)?,
            depth: two("depths", "depths, sorted")?,
            order: two("depth order", "depth order, half-way")?,
            tile_counts: scratch("tile counts")?,
            offsets: scratch("pair offsets")?,
            block_sums: scratch("pair sums")?,
            splats: scratch("splats")?,
            tiles: two("tiles of pairs", "tiles of pairs, sorted")?,
            pairs: two("pairs", "pairs, sorted")?,
            owners: scratch("owners of pairs")?,
            records: scratch("records of pairs")?,
            histogram: scratch("digit counts")?,
            totals: context.storage("digit totals", u64::from(4 * DIGITS))?,
            starts: scratch("tile lists")?,
            image: scratch("image")?,
            transmittance: scratch("transmittance")?,
            main_contributor: scratch("main contributors")?,
            derivatives: scratch("similarity derivatives")?,
            gradient: scratch("image gradient")?,
            block_losses: scratch("losses")?,
            pair_capacity: 0,
        })
    }

    /// Room for frames of this extent with at least `pairs` pairs.
    pub fn reserve(&mut self, context: &Context, sort: &RadixSort, extent: &Extent, pairs: usize) -> Result<()> {
        let n = extent.gaussians;
        let pairs = pairs.max(LEAST_PAIRS).max(self.pair_capacity);
        let (in_training, blocks) = if extent.training { (extent.pixels, extent.blocks) } else { (0, 0) };
        for scratch in self.depth.iter_mut().chain(&mut self.order) {
            scratch.reserve(context, n, 4)?;
        }
        for scratch in self.tiles.iter_mut().chain(&mut self.pairs) {
            scratch.reserve(context, pairs, 4)?;
        }
        for (items, bytes, scratch) in [
            (n, 8, &mut self.tile_counts),
            (n, 4, &mut self.offsets),
            (n.div_ceil(256).max(1), 4, &mut self.block_sums),
            (2 * n, 48, &mut self.splats),
            (pairs, 4, &mut self.owners),
            (pairs, 64, &mut self.records),
            (extent.tiles + 1, 4, &mut self.starts),
            (extent.pixels, 16, &mut self.image),
            (extent.pixels, 4, &mut self.transmittance),
            (extent.pixels, 4, &mut self.main_contributor),
            (in_training, 36, &mut self.derivatives),
            (in_training, 16, &mut self.gradient),
            (blocks, 16, &mut self.block_losses),
        ] {
            scratch.reserve(context, items, bytes)?;
        }
        self.pair_capacity = pairs;
        let stride = (n.max(pairs) as u32).div_ceil(sort.block).max(1);
        self.histogram.reserve(context, (DIGITS * stride) as usize, 4)?;
        for p in 0..DEPTH_PASSES + TILE_PASSES {
            let (depth, shift) = (p < DEPTH_PASSES, 8 * if p < DEPTH_PASSES { p } else { p - DEPTH_PASSES });
            let constants = SortPass {
                shift,
                count_slot: match (depth, shift) {
                    (true, 0) => 0,
                    (true, _) => VISIBLE as u32,
                    (false, _) => PAIRS,
                },
                stride,
                flags: match (depth, shift) {
                    (true, 0) => IMPLICIT_VALUES | SKIP_SENTINELS,
                    (false, 0) => IMPLICIT_VALUES,
                    _ => 0,
                },
            };
            context.queue.write_buffer(&self.sort_passes, u64::from(p * SORT_STRIDE), bytemuck::bytes_of(&constants));
        }
        Ok(())
    }

    /// The pairs in tile order after so many passes.
    pub fn sorted_pairs(&self, passes: u32) -> &wgpu::Buffer {
        &self.pairs[(passes % 2) as usize].buffer
    }

    /// A fresh start: `gaussians` held, no failure, no steps.
    pub fn reset(&self, context: &Context, gaussians: usize) {
        let mut state = [0_u32; STATE_WORDS];
        state[0] = gaussians as u32;
        context.queue.write_buffer(&self.state, 0, bytemuck::cast_slice(&state));
    }
}

/// The kernels of a forward pass.
pub(crate) struct Forward {
    pub sort: RadixSort,
    project: Kernel,
    plan: Kernel,
    count: Kernel,
    sum: Kernel,
    emit: Kernel,
    ranges: Kernel,
    blend: Kernel,
    blend_and_name: Kernel,
    blend_fused: Kernel,
}

/// The same with their memory: good until the memory grows.
pub(crate) struct BoundForward {
    project: Bound,
    depth: Vec<BoundPass>,
    plan: Bound,
    count: Bound,
    sum: Bound,
    emit: Bound,
    tiles: Vec<BoundPass>,
    /// By the parity of the tile passes.
    ranges: [Bound; 2],
    blend: [Bound; 2],
    blend_fused: [Bound; 2],
    sort_block: u32,
}

impl Forward {
    pub fn new(context: &Context, sort: RadixSort, fixed: &Fixed) -> Result<Self> {
        let kernel = |label, source: String| Kernel::new(context, label, &source);
        Ok(Self {
            sort,
            project: kernel("project", fixed.project())?,
            plan: kernel("plan", fixed.plan())?,
            count: kernel("count pairs", fixed.count())?,
            sum: kernel("sum pairs", fixed.sum())?,
            emit: kernel("emit pairs", fixed.emit())?,
            ranges: kernel("tile lists", fixed.ranges())?,
            blend: kernel("blend", fixed.forward(false))?,
            blend_and_name: kernel("blend with main contributor", fixed.forward(true))?,
            blend_fused: kernel("blend both", fixed.forward_fused())?,
        })
    }

    pub fn bind(
        &self,
        context: &Context,
        params: &wgpu::Buffer,
        store: &Store,
        m: &Memory,
        main_contributor: bool,
    ) -> Result<BoundForward> {
        let passes = |keys: &[Scratch; 2], values: &[Scratch; 2], count: u32| -> Result<Vec<BoundPass>> {
            (0..count)
                .map(|p| {
                    let (from, to) = ((p % 2) as usize, ((p + 1) % 2) as usize);
                    let buffers = PassBuffers {
                        uniform: &m.sort_passes,
                        state: &m.state,
                        keys: &keys[from].buffer,
                        values: &values[from].buffer,
                        sorted_keys: &keys[to].buffer,
                        sorted_values: &values[to].buffer,
                        histogram: &m.histogram.buffer,
                        totals: &m.totals,
                    };
                    self.sort.bind(context, &buffers)
                })
                .collect()
        };
        let (order, counts, splats) = (&m.order[0].buffer, &m.tile_counts.buffer, &m.splats.buffer);
        let sh = [&store.sh[0].value.buffer, &store.sh[1].value.buffer];
        let bind = |kernel: &Kernel, buffers: &[&wgpu::Buffer]| kernel.bind(context, params::SIZE, buffers);
        let blend = if main_contributor { &self.blend_and_name } else { &self.blend };
        let ranges = |last: usize| bind(&self.ranges, &[params, &m.state, &m.tiles[last].buffer, &m.starts.buffer]);
        let blended = |blend: &Kernel, last: usize| {
            bind(
                blend,
                &[
                    params,
                    &m.starts.buffer,
                    &m.pairs[last].buffer,
                    &m.owners.buffer,
                    splats,
                    &m.image.buffer,
                    &m.transmittance.buffer,
                    &m.main_contributor.buffer,
                ],
            )
        };
        Ok(BoundForward {
            project: bind(&self.project, &[params, &store.core.value.buffer, sh[0], sh[1], &m.depth[0].buffer, counts, splats])?,
            depth: passes(&m.depth, &m.order, DEPTH_PASSES)?,
            plan: bind(&self.plan, &[&m.totals, &m.state, &m.args])?,
            count: bind(&self.count, &[&m.state, order, counts, &m.offsets.buffer, &m.block_sums.buffer])?,
            sum: bind(&self.sum, &[params, &m.state, &m.block_sums.buffer, &m.args])?,
            emit: bind(
                &self.emit,
                &[
                    params,
                    &m.state,
                    order,
                    counts,
                    splats,
                    &m.block_sums.buffer,
                    &m.offsets.buffer,
                    &m.tiles[0].buffer,
                    &m.owners.buffer,
                    &m.records.buffer,
                ],
            )?,
            tiles: passes(&m.tiles, &m.pairs, TILE_PASSES)?,
            ranges: [ranges(0)?, ranges(1)?],
            blend: [blended(blend, 0)?, blended(blend, 1)?],
            blend_fused: [blended(&self.blend_fused, 0)?, blended(&self.blend_fused, 1)?],
            sort_block: self.sort.block,
        })
    }
}

/// A mark between the stages of a frame.
pub(crate) type Mark<'a> = &'a mut dyn FnMut(&mut wgpu::ComputePass<'_>);

impl BoundForward {
    /// Records a forward pass; `mark` is called after projection, after sorting and after blending.
    pub fn record(&self, pass: &mut wgpu::ComputePass<'_>, p: &Params, offset: u32, n: usize, m: &Memory, mark: Mark<'_>) {
        self.project.run(pass, offset, n.div_ceil(256) as u32);
        mark(pass);
        for (k, sort) in self.depth.iter().enumerate() {
            let at = k as u32 * SORT_STRIDE;
            let groups = match k {
                0 => Groups::Direct((n as u32).div_ceil(self.sort_block)),
                _ => Groups::Indirect(&m.args, ARGS_DEPTH_SORT),
            };
            sort.count(pass, at, groups);
            if k == 0 {
                self.plan.run(pass, 0, 1);
            }
            sort.scatter(pass, at, groups);
        }
        self.count.run_indirect(pass, 0, &m.args, ARGS_VISIBLE_256);
        self.sum.run(pass, offset, 1);
        self.emit.run_indirect(pass, offset, &m.args, ARGS_VISIBLE_256);
        let passes = p.tile_passes();
        for (k, sort) in self.tiles.iter().enumerate().take(passes as usize) {
            let at = (DEPTH_PASSES + k as u32) * SORT_STRIDE;
            sort.count(pass, at, Groups::Indirect(&m.args, ARGS_PAIR_SORT));
            sort.scatter(pass, at, Groups::Indirect(&m.args, ARGS_PAIR_SORT));
        }
        let last = (passes % 2) as usize;
        self.ranges[last].run_indirect(pass, offset, &m.args, ARGS_PAIRS_256);
        mark(pass);
        let blend = if p.fused == 1 { &self.blend_fused } else { &self.blend };
        blend[last].run(pass, offset, p.tile_total);
        mark(pass);
    }
}
