//! The forward pass as device work: projection, tile lists in order of depth, blending; both modalities in one list of pairs and one
//! blend.
//!
//! Nothing is sorted as a whole. Projection counts each Gaussian's tiles, takes room for the pairs of each block of Gaussians and cuts them
//! into shares of much the same work; `emit` writes every (Gaussian, tile) pair, a share to a workgroup, and takes its place within the tile
//! by an integer counter; `allot` gives tiles room, `place` fills it in and `order` sorts each tile's list by depth in workgroup memory, long
//! ones in chunks that `merge` joins. Only where visible Gaussians, pairs and lists lie depends on who came first.

mod tiled;

use super::{
    capacity::BufferCapacity,
    params::{self, Params},
    shaders::{Blend, CHUNK, COUNTER, Fixed, SHARE},
};
use crate::Result;
use corf_gpu::{Bound, Context, Kernel, Scratch};
use rayon::prelude::*;
use tiled::{BoundTiled, Tiled};

/// Words of the state (`shaders/groups.wgsl`), and the places of what is read back.
pub(crate) const STATE_WORDS: usize = 17;
pub(crate) const VISIBLE: usize = 1;
pub(crate) const FAILED: usize = 3;
pub(crate) const NEEDED: usize = 4;
pub(crate) const STEPS: usize = 5;
const MOST_VISIBLE: usize = 10;

/// Slots of the indirect arguments (`shaders/args.wgsl`).
pub(crate) const ARGS_APPEARANCE: u64 = 0;
pub(crate) const ARGS_GEOMETRY: u64 = 1;
const ARGS_PAIRS: u64 = 2;
pub(crate) const ARGS_BUCKETS: u64 = 3;
const ARGS_SHARES: u64 = 4;
const ARGS_ORDER: u64 = 5;
const ARGS_MERGE: u64 = 6;
const ARGS: u64 = 7;

/// Bytes of the head of a pair's record.
const RECORD_HEAD: usize = 32;

/// Bytes of a splat, of which a visible Gaussian has one in each image.
const SPLAT: usize = 48;

/// Gaussians of a block, threads of a workgroup of the kernels around lists.
const BLOCK: usize = 256;

/// Working memory of a frame.
pub(crate) struct Memory {
    pub state: wgpu::Buffer,
    pub args: wgpu::Buffer,
    /// Per block of Gaussians: its counts of visible Gaussians and of (Gaussian, tile) pairs, and their offsets.
    blocks: Scratch,
    /// Per share of a block's pairs: the block, and the share's index within it.
    shares: Scratch,
    /// Per visible Gaussian: its index here; its pairs and rows of tiles in `drawn`; its projected ellipse in `splats`.
    pub gaussian_of: Scratch,
    pub drawn: Scratch,
    pub splats: Scratch,
    pairs: Scratch,
    tile_sizes: Scratch,
    pub lists: Scratch,
    pub entries: Scratch,
    /// Per part of a tile list that several workgroups sort: the tile, and the part's index within the list.
    chunks: Scratch,
    pub bucket_tiles: Scratch,
    /// The blending state from which the backward pass restarts (`shaders/tile.wgsl`), a part of its numbers in each.
    pub checkpoint_heads: Scratch,
    pub checkpoint_tails: Scratch,
    /// Per tile, the number of entries of its list that its pixels have processed.
    pub visited: Scratch,
    /// Gradients of a pair (`shaders/backward.wgsl`), a part of their words in each.
    pub record_heads: Scratch,
    pub record_tails: Scratch,
    pub image: Scratch,
    pub transmittance: Scratch,
    pub main_contributor: Scratch,
    pub derivatives: Scratch,
    pub gradient: Scratch,
    pub block_losses: Scratch,
    /// Sums of the visible Gaussians' records, and gradients of their directions.
    pub ellipse_sums: Scratch,
    pub directions: Scratch,
    pub room: BufferCapacity,
}

impl BufferCapacity {
    /// Capacity that the frames of a state needed, and an eighth more, as far as that does not take it beyond `most`: the size to grow to after one
    /// of them overflowed its buffers.
    pub fn asked(state: &[u32], most: Self) -> Self {
        let more = |slot: usize, most: usize| {
            let needed = state[slot] as usize;
            (needed + needed / 8).min(most).max(needed)
        };
        Self { pairs: more(NEEDED, most.pairs), visible: more(MOST_VISIBLE, most.visible) }
    }
}

/// Buffer sizes that a batch of frames needs.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Extent {
    pub gaussians: usize,
    pub tiles: usize,
    pub pixels: usize,
    pub blocks: usize,
    /// Pixels of the largest tile.
    pub area: usize,
    pub training: bool,
    /// Whether any frame blends both images at once.
    pub both: bool,
}

impl Extent {
    /// Takes in a frame for tiles of one of these shapes.
    pub fn include(&mut self, p: &Params, shapes: &[Fixed]) {
        let [width, height] = shapes[p.shape as usize].tile;
        self.area = self.area.max((width * height) as usize);
        self.tiles = self.tiles.max(p.tile_total as usize);
        self.pixels = self.pixels.max(p.pixel_total as usize);
        self.blocks = self.blocks.max(p.blocks_total as usize);
        self.both |= p.fused == 1;
    }

    /// Bytes of a bucket's checkpoint: its head, its tail.
    fn checkpoint_bytes(&self) -> [usize; 2] {
        Fixed::checkpoint_numbers(self.both).map(|numbers| 4 * numbers as usize * self.area)
    }

    /// The most pairs, and visible Gaussians, for which an adapter binds every buffer that grows with them.
    pub fn most(&self, context: &Context, fixed: &Fixed) -> BufferCapacity {
        let checkpoints = if self.training { self.checkpoint_bytes()[0].div_ceil(fixed.batch as usize) } else { 0 };
        let largest = usize::try_from(context.largest_buffer()).unwrap_or(usize::MAX);
        BufferCapacity { pairs: largest / RECORD_HEAD.max(checkpoints), visible: largest / (2 * SPLAT) }
    }
}

impl Memory {
    pub fn new(context: &Context) -> Result<Self> {
        let scratch = |label| Scratch::new(context, label);
        let storage = wgpu::BufferUsages::STORAGE;
        Ok(Self {
            state: context.storage("state", 4 * STATE_WORDS as u64)?,
            args: context.buffer("indirect arguments", ARGS * 16, storage | wgpu::BufferUsages::INDIRECT)?,
            blocks: scratch("blocks of Gaussians")?,
            shares: scratch("shares of blocks")?,
            gaussian_of: scratch("visible Gaussians")?,
            drawn: scratch("extents of splats")?,
            splats: scratch("splats")?,
            pairs: scratch("pairs")?,
            tile_sizes: scratch("tile sizes")?,
            lists: scratch("tile lists")?,
            entries: scratch("entries of lists")?,
            chunks: scratch("chunks of lists")?,
            bucket_tiles: scratch("tiles of buckets")?,
            checkpoint_heads: scratch("heads of checkpoints")?,
            checkpoint_tails: scratch("tails of checkpoints")?,
            visited: scratch("visited")?,
            record_heads: scratch("heads of records")?,
            record_tails: scratch("tails of records")?,
            image: scratch("image")?,
            transmittance: scratch("transmittance")?,
            main_contributor: scratch("main contributors")?,
            derivatives: scratch("similarity derivatives")?,
            gradient: scratch("image gradient")?,
            block_losses: scratch("losses")?,
            ellipse_sums: scratch("gradients of splats")?,
            directions: scratch("gradients of directions")?,
            room: BufferCapacity::default(),
        })
    }

    /// Room for frames of this extent, at least so much.
    pub fn reserve(&mut self, context: &Context, fixed: &Fixed, extent: &Extent, room: BufferCapacity) -> Result<()> {
        let (n, tiles) = (extent.gaussians, extent.tiles);
        // What frames of another kind had room for may be more than this kind can have.
        let most = extent.most(context, fixed);
        let kept = BufferCapacity { pairs: self.room.pairs.min(most.pairs), visible: self.room.visible.min(most.visible) };
        let room = kept.with(room);
        let (pairs, visible) = (room.pairs, room.visible.min(n));
        let bucket = fixed.batch as usize;
        let trained = |count: usize| if extent.training { count } else { 0 };
        let record_tail = if extent.both { 32 } else { 16 };
        let [head, tail] = extent.checkpoint_bytes();
        for (items, bytes, scratch) in [
            (n.div_ceil(BLOCK), 16, &mut self.blocks),
            // The last share of a block may be small.
            (n.div_ceil(BLOCK) + pairs / SHARE as usize, 8, &mut self.shares),
            (visible, 4, &mut self.gaussian_of),
            (visible, 28, &mut self.drawn),
            (2 * visible, SPLAT, &mut self.splats),
            (pairs, 16, &mut self.pairs),
            (tiles, 16, &mut self.lists),
            (pairs, 8, &mut self.entries),
            // Each is of a list of more than one, so half full on the average at least.
            (2 * pairs / CHUNK as usize, 8, &mut self.chunks),
            (pairs / bucket + tiles, 4, &mut self.bucket_tiles),
            (trained(pairs / bucket), head, &mut self.checkpoint_heads),
            (trained(pairs / bucket), tail, &mut self.checkpoint_tails),
            (trained(tiles), 4, &mut self.visited),
            // Emission clears the records of pairs without a tile, also where nothing is trained.
            (pairs, RECORD_HEAD, &mut self.record_heads),
            (pairs, record_tail, &mut self.record_tails),
            (extent.pixels, 16, &mut self.image),
            (extent.pixels, 4, &mut self.transmittance),
            (extent.pixels, 4, &mut self.main_contributor),
            (trained(extent.pixels), 36, &mut self.derivatives),
            (trained(extent.pixels), 16, &mut self.gradient),
            (trained(3 * extent.blocks), 16, &mut self.block_losses),
            (trained(visible), 64, &mut self.ellipse_sums),
            (trained(visible), 16, &mut self.directions),
        ] {
            // A binding holds one item at least, also where there is nothing.
            scratch.reserve(context, items.max(1), bytes)?;
        }
        // Each frame leaves the sizes at zero, as it must find them.
        if self.tile_sizes.reserve(context, tiles, 4 * COUNTER as usize)? {
            let mut encoder = context.encoder();
            encoder.clear_buffer(&self.tile_sizes.buffer, 0, None);
            context.submit(encoder);
        }
        self.room = room;
        Ok(())
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
    allot: Kernel,
    place: Kernel,
    order: Kernel,
    merge: Kernel,
    /// One for each shape of tiles; pictures that nobody trains on have those of the first.
    tiled: Vec<Tiled>,
    /// Apart, both at once.
    blend: [Kernel; 2],
    blend_and_name: Kernel,
}

/// Outputs of a forward pass beside the images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Leaves {
    /// Nothing.
    Images,
    /// The main contributor of each pixel.
    MainContributors,
    /// The blending state from which the backward pass restarts.
    Checkpoints,
}

/// The forward kernels bound to their buffers; valid until the buffers grow.
pub(crate) struct BoundForward {
    allot: Bound,
    place: Bound,
    order: Bound,
    merge: Bound,
    tiled: Vec<BoundTiled>,
}

impl Forward {
    /// A frame for tiles of these shapes, with so many threads for a pixel's list, or as many as the image's size suggests.
    pub fn new(context: &Context, shapes: &[Fixed], segments: Option<u32>) -> Result<Self> {
        let fixed = &shapes[0];
        let single = Blend { both: false, main_contributor: false, checkpoints: false, segments: 1 };
        let one = Blend { segments: segments.unwrap_or(1), ..single };
        let tiled = || shapes.par_iter().map(|shape| Tiled::new(context, shape, segments)).collect::<Result<_>>();
        let kernels = || {
            Kernel::all(
                context,
                [
                    ("allot lists", fixed.allot()),
                    ("place pairs", fixed.place()),
                    ("order lists", fixed.order()),
                    ("merge chunks", fixed.merge()),
                    ("blend", fixed.forward(one)),
                    ("blend both", fixed.forward(Blend { both: true, ..one })),
                    ("blend, name", fixed.forward(Blend { main_contributor: true, ..single })),
                ],
            )
        };
        let (tiled, kernels) = rayon::join(tiled, kernels);
        let [allot, place, order, merge, blend, blend_both, blend_and_name] = kernels?;
        Ok(Self { allot, place, order, merge, tiled: tiled?, blend: [blend, blend_both], blend_and_name })
    }

    /// Binds the kernels; `values` are those of [`Store::values`](super::store::Store::values).
    pub fn bind(
        &self,
        context: &Context,
        params: &wgpu::Buffer,
        values: [&wgpu::Buffer; 3],
        m: &Memory,
        leaves: Leaves,
    ) -> Result<BoundForward> {
        let [core, light, radio] = values;
        let (blocks, shares, splats) = (&m.blocks.buffer, &m.shares.buffer, &m.splats.buffer);
        let (pairs, sizes, lists, entries) = (&m.pairs.buffer, &m.tile_sizes.buffer, &m.lists.buffer, &m.entries.buffer);
        let bind =
            |kernel: &Kernel, buffers: &[&wgpu::Buffer]| -> Result<Bound> { Ok(kernel.bind(context, params::SIZE, buffers)?) };
        let blended = |kernel: &Kernel| {
            let (image, transmittance) = (&m.image.buffer, &m.transmittance.buffer);
            let (names, visited) = (&m.main_contributor.buffer, &m.visited.buffer);
            let (heads, tails) = (&m.checkpoint_heads.buffer, &m.checkpoint_tails.buffer);
            bind(
                kernel,
                &[params, lists, entries, splats, image, transmittance, names, heads, tails, visited, &m.gaussian_of.buffer],
            )
        };
        let blend = match leaves {
            Leaves::Images => Some(self.blend.each_ref()),
            Leaves::MainContributors => Some([&self.blend_and_name; 2]),
            Leaves::Checkpoints => None,
        };
        // Steps alone have tiles of more than one shape.
        let shapes = if blend.is_none() { self.tiled.len() } else { 1 };
        let (drawn, numbers) = (&m.drawn.buffer, &m.gaussian_of.buffer);
        let (heads, tails) = (&m.record_heads.buffer, &m.record_tails.buffer);
        let emitted = [params, &m.state, drawn, splats, blocks, shares, sizes, pairs, heads, tails];
        let chunks = &m.chunks.buffer;
        let projected = [params, core, light, radio, blocks, splats, numbers, &m.state, drawn, shares, &m.args];
        let tiled = |t: &Tiled| t.bind(|k| bind(k, &projected), |k| bind(k, &emitted), blended, blend);
        Ok(BoundForward {
            allot: bind(&self.allot, &[params, &m.state, sizes, lists, &m.bucket_tiles.buffer, &m.args, chunks])?,
            place: bind(&self.place, &[params, &m.state, pairs, lists, entries])?,
            order: bind(&self.order, &[params, lists, pairs, entries, &m.state, chunks, numbers])?,
            merge: bind(&self.merge, &[&m.state, lists, chunks, pairs, entries])?,
            tiled: self.tiled[..shapes].iter().map(tiled).collect::<Result<_>>()?,
        })
    }
}

/// A mark between the kernels of a frame.
pub(crate) type Mark<'a> = &'a mut dyn FnMut(&mut wgpu::ComputePass<'_>);

impl BoundForward {
    /// Records a forward pass; `mark` is called after each kernel.
    pub fn record(&self, pass: &mut wgpu::ComputePass<'_>, p: &Params, offset: u32, n: usize, m: &Memory, mark: Mark<'_>) {
        // Once also of no Gaussian: what is counted is settled there.
        let blocks = n.div_ceil(BLOCK).max(1) as u32;
        let tiled = &self.tiled[p.shape as usize];
        tiled.project.run(pass, offset, blocks);
        mark(pass);
        tiled.emit.run_indirect(pass, offset, &m.args, ARGS_SHARES);
        mark(pass);
        self.allot.run(pass, offset, p.tile_total.div_ceil(BLOCK as u32));
        mark(pass);
        self.place.run_indirect(pass, offset, &m.args, ARGS_PAIRS);
        mark(pass);
        self.order.run_indirect(pass, offset, &m.args, ARGS_ORDER);
        self.merge.run_indirect(pass, offset, &m.args, ARGS_MERGE);
        mark(pass);
        tiled.blend(p).run(pass, offset, p.tile_total);
        mark(pass);
    }
}

#[cfg(test)]
mod tests;
