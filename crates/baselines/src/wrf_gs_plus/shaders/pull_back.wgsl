@group(0) @binding(1) var<storage, read> state: array<u32>;
@group(0) @binding(2) var<storage, read_write> core: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> core_m: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> core_v: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> radio: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> radio_moments: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read> core_gradient: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read> radio_gradient: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read> d_scale: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> of_position: array<vec4<f32>>;
@group(0) @binding(11) var<storage, read_write> of_scale: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> of_rotation: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read_write> of_signal: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read_write> gate: array<u32>;

// A step of one vector of a Gaussian's geometry and opacities.
fn step_core(at: u32, gradient: vec4<f32>, rates: vec4<f32>) {
    var m = core_m[at];
    var v = core_v[at];
    core[at] -= rates * adam(gradient, &m, &v);
    core_m[at] = m;
    core_v[at] = v;
}

// From the gradient in the deformed Gaussians of a chunk to that in the network's heads, and the step of the Gaussians themselves.
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let row = 64u * group_number(id) + t;
    // A frame that had no room for its pairs changes nothing; neither does any after it.
    let failed = state[FAILED] != 0u;
    if (row == 0u) { gate[0] = u32(failed); }
    if (row >= params.rows) { return; }
    let i = params.first + row;
    if (failed || i >= params.gaussians) {
        of_position[row] = vec4(0.0);
        of_scale[row] = vec4(0.0);
        of_rotation[row] = vec4(0.0);
        of_signal[row] = vec4(0.0);
        return;
    }
    let a = core[3u * i];
    let b = core[3u * i + 1u];
    let c = core[3u * i + 2u];
    let ga = core_gradient[3u * i];
    let gb = core_gradient[3u * i + 1u];
    let gc = core_gradient[3u * i + 2u];
    let signal = radio_gradient[i];

    // d ln|s| / ds = 1/s; nothing where the deviation is held at its least.
    let plain = exp(vec3(b.w, c.xy));
    let deviations = plain + d_scale[row].xyz;
    let scale = select(vec3(0.0), vec3(gb.w, gc.xy) / deviations, abs(deviations) > vec3(LEAST));
    // The part along a unit quaternion does not count.
    let q = vec4(a.w, b.xyz);
    let n = inverse_norm(q);
    let g = vec4(ga.w, gb.xyz);
    let rotation = (g - q * n * dot(q * n, g)) * n;

    of_position[row] = vec4(select(vec3(0.0), ga.xyz, params.move_positions != 0u), 0.0);
    of_scale[row] = vec4(scale, 0.0);
    of_rotation[row] = g;
    of_signal[row] = signal;

    let r = params.rotation_rate;
    let l = params.log_scale_rate;
    let log_scale = scale * plain;
    step_core(3u * i, vec4(ga.xyz, rotation.x), vec4(vec3(params.position_rate), r));
    step_core(3u * i + 1u, vec4(rotation.yzw, log_scale.x), vec4(r, r, r, l));
    step_core(3u * i + 2u, vec4(log_scale.yz, 0.0, gc.w), vec4(l, l, 0.0, params.opacity_rate));
    // Behind a Gaussian's first moments are the second.
    var m = radio_moments[2u * i];
    var v = radio_moments[2u * i + 1u];
    radio[i] -= params.signal_rate * adam(signal, &m, &v);
    radio_moments[2u * i] = m;
    radio_moments[2u * i + 1u] = v;
}
