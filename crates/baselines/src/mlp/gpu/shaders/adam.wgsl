// A step of Adam with weight decay.
@group(0) @binding(0) var<uniform> adam: AdamConstants;
@group(0) @binding(1) var<storage, read> gradient: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> parameters: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> first: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> second: array<vec4<f32>>;
// Not 0: the step is not to be taken.
@group(0) @binding(5) var<storage, read> gate: array<u32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let i = 64u * (id.y * 32768u + id.x) + t;
    if (i >= adam.count || gate[0] != 0u) { return; }
    let p = parameters[i];
    let g = gradient[i] + adam.decay * p;
    let m = adam.beta1 * first[i] + adam.gain1 * g;
    let v = adam.beta2 * second[i] + adam.gain2 * g * g;
    first[i] = m;
    second[i] = v;
    parameters[i] = p - adam.rate * m / (sqrt(v) * adam.root + adam.epsilon);
}
