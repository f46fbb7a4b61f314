//! What the GPU device is made with.

use crate::{Error, RasterConfig, Result};
use corf_gpu::AdapterOptions;

/// Options of the GPU device: the adapter, and the shapes of its kernels.
///
/// The tile and the batch decide how fast a step is, not what it computes: small tiles follow thin ellipses and fill a GPU with small
/// images, large ones make fewer pairs to sort.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GpuOptions {
    /// The adapter. With timestamps there are times of a training step's kernels ([`take_stage_times`](super::GpuDevice::take_stage_times)).
    pub adapter: AdapterOptions,
    /// Pixels across and down a tile. Without, steps choose by their images, and by the room that there is for their pairs; images that nobody
    /// trains on have the larger tiles.
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
}

impl Default for GpuOptions {
    fn default() -> Self {
        Self {
            adapter: AdapterOptions::default(),
            tile: None,
            batch: 32,
            segments: None,
            fused: true,
            least_room: 1 << 16,
            keyframe_bytes: RasterConfig::default().keyframe_bytes(),
        }
    }
}

impl GpuOptions {
    /// The usual kernels on this adapter.
    pub fn on(adapter: AdapterOptions) -> Self {
        Self { adapter, ..Self::default() }
    }

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
