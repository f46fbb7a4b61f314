@group(0) @binding(1) var<storage, read> core: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> radio: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> d_position: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> d_scale: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> d_rotation: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> d_signal: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> core_out: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> radio_out: array<vec4<f32>>;

// The Gaussians of a chunk as the receiver finds them.
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let row = 64u * group_number(id) + t;
    let i = params.first + row;
    if (row >= params.rows || i >= params.gaussians) { return; }
    let a = core[3u * i];
    let b = core[3u * i + 1u];
    let c = core[3u * i + 2u];
    let q = vec4(a.w, b.xyz);
    let rotation = q * inverse_norm(q) + d_rotation[row];
    let deviations = exp(vec3(b.w, c.xy)) + d_scale[row].xyz;
    let log_scale = log(max(abs(deviations), vec3(LEAST)));
    let position = a.xyz + select(vec3(0.0), d_position[row].xyz, params.move_positions != 0u);
    core_out[3u * i] = vec4(position, rotation.x);
    core_out[3u * i + 1u] = vec4(rotation.yzw, log_scale.x);
    core_out[3u * i + 2u] = vec4(log_scale.yz, c.zw);
    radio_out[i] = radio[i] + d_signal[row];
}
