//! Helpers shared by the tests of this device.

use super::context::{Context, GpuOptions};

/// Any adapter, subgroups if it has them, working memory full of NaN.
pub(crate) const OPTIONS: GpuOptions = GpuOptions {
    adapter: 0,
    software: true,
    subgroups: true,
    timestamps: false,
    tile: Some([8, 8]),
    batch: 16,
    segments: Some(1),
    fused: true,
    least_room: 16,
    keyframe_bytes: u64::MAX,
    half: false,
    poison: Some(0xffc0_ffee),
};

/// An adapter, or `None` and a line that says so; a failure under `CORF_REQUIRE_GPU=1`.
pub(crate) fn context(options: &GpuOptions) -> Option<Context> {
    if super::adapter_name(options).is_some() {
        return Some(Context::open(options).expect("the adapter opens"));
    }
    let required = std::env::var_os("CORF_REQUIRE_GPU").is_some_and(|v| v == "1");
    assert!(!required, "no adapter");
    println!("skipped: no adapter");
    None
}
