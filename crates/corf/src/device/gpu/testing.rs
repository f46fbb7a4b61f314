//! Options shared by the tests of this device.

use super::GpuOptions;

/// [`corf_gpu::testing::OPTIONS`], one shape of tiles, hardly any memory at first.
pub(crate) const OPTIONS: GpuOptions = GpuOptions {
    adapter: corf_gpu::testing::OPTIONS,
    tile: Some([8, 8]),
    batch: 16,
    segments: Some(1),
    fused: true,
    least_room: 16,
    keyframe_bytes: u64::MAX,
};
