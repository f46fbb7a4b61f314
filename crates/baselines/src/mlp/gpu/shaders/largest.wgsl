// The largest absolute number of a head's gradient, in GROUPS parts.
struct Head {
    vectors: u32,
    first_part: u32,
}

@group(0) @binding(0) var<uniform> head: Head;
@group(0) @binding(1) var<storage, read> gradient: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> parts: array<f32>;

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    var found = vec4(0.0);
    for (var i = THREADS * id.x + t; i < head.vectors; i += THREADS * GROUPS) { found = max(found, abs(gradient[i])); }
    let all = largest_of_group(t, max(max(found.x, found.y), max(found.z, found.w)));
    if (t == 0u) { parts[head.first_part + id.x] = all; }
}
