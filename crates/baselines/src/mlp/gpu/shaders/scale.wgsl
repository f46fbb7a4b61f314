// The power of two that brings the largest of all parts to 256 or a little less than twice that, and its inverse. 1 where there is no gradient.
struct Parts {
    count: u32,
}

@group(0) @binding(0) var<uniform> size: Parts;
@group(0) @binding(1) var<storage, read> parts: array<f32>;
@group(0) @binding(2) var<storage, read_write> scale: array<vec4<f32>>;

@compute @workgroup_size(THREADS)
fn main(@builtin(local_invocation_index) t: u32) {
    var found = 0.0;
    for (var i = t; i < size.count; i += THREADS) { found = max(found, parts[i]); }
    let all = largest_of_group(t, found);
    // The exponent as it is stored, 127 more than it means; 0 of zero, 255 of what is no number.
    let exponent = (bitcast<u32>(all) >> 23u) & 255u;
    var up = 127u;
    if (exponent > 0u && exponent < 255u) { up = min(2u * 127u + 8u - exponent, 253u); }
    if (t == 0u) { scale[0] = vec4(bitcast<f32>(up << 23u), bitcast<f32>((254u - up) << 23u), 0.0, 0.0); }
}
