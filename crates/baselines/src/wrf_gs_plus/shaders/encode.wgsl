@group(0) @binding(1) var<storage, read> core: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> positions: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> receivers: array<vec4<f32>>;

// Inputs of the network for a chunk's Gaussians, zero in rows that have none: one thread a vector.
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let i = 64u * group_number(id) + t;
    let stride = params.position_stride + params.receiver_stride;
    let row = i / stride;
    let at = i % stride;
    if (row >= params.rows) { return; }
    let gaussian = params.first + row;
    let of_position = at < params.position_stride;
    var x = params.receiver.xyz;
    var frequencies = params.receiver_frequencies;
    var column = 4u * (at - select(params.position_stride, 0u, of_position));
    var out = vec4(0.0);
    if (gaussian < params.gaussians) {
        if (of_position) {
            x = core[3u * gaussian].xyz;
            frequencies = params.position_frequencies;
        }
        for (var n = 0u; n < 4u; n++) {
            if (column + n < 3u + 6u * frequencies) { out[n] = encoded(x, column + n); }
        }
    }
    if (of_position) {
        positions[row * params.position_stride + at] = out;
    } else {
        receivers[row * params.receiver_stride + at - params.position_stride] = out;
    }
}
