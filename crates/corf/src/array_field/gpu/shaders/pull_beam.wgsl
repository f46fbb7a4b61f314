// What pulls at each wave, and what it accounts for: its power times the derivatives of both losses by it.
@group(0) @binding(1) var<storage, read> waves: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> tables: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read_write> pulls: array<vec2<f32>>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    hold(0u, t);
    let i = 64u * group_number(id) + t;
    if (i >= job.emitters) { return; }
    let wave = waves[i];
    let phases = job.steps * wave.yz;
    pulls[i] = POWER * vec2(value(0u, phases), value(ENTRIES, phases));
}
