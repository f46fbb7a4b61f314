@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> state: array<u32>;
@group(0) @binding(2) var<storage, read> pairs: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read> lists: array<List>;
@group(0) @binding(4) var<storage, read_write> entries: array<vec2<u32>>;

// Pairs to their tiles' lists: depth, number of the pair.
@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let at = group_number(id) * 256u + thread;
    if (at >= state[PAIRS]) { return; }
    let pair = pairs[at];
    if (pair.x < params.tile_total) { entries[lists[pair.x].first + pair.y] = vec2(pair.w, at); }
}
