// A question: how many weights smooth an image (none: structure is not wanted), the logit of a faint opacity, whether both opacities have
// to be faint, σ/z of an oversized Gaussian, how many pixels are asked about, and the weights.
const WEIGHTS = 0u;
const FAINT = 1u;
const BOTH = 2u;
const OVERSIZED = 3u;
const ASKED = 4u;
const FIRST_WEIGHT = 5u;
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> question: array<f32>;

fn held(at: i32, end: u32) -> u32 { return u32(clamp(at, 0, i32(end) - 1)); }
