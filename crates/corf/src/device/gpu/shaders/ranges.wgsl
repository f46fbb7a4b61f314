@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> state: array<u32>;
@group(0) @binding(2) var<storage, read> pair_tiles: array<u32>;
@group(0) @binding(3) var<storage, read_write> starts: array<u32>;

// Tile t owns the sorted pairs starts[t] .. starts[t+1].
@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let s = group_number(id) * 256u + thread;
    let n = state[PAIRS];
    if (s >= max(n, 1u)) { return; }
    if (n == 0u) {
        for (var t = 0u; t <= params.tile_total; t++) { starts[t] = 0u; }
        return;
    }
    let tile = pair_tiles[s];
    var first = 0u;
    if (s > 0u) { first = pair_tiles[s - 1u] + 1u; }
    for (var t = first; t <= tile; t++) { starts[t] = s; }
    if (s == n - 1u) {
        for (var t = tile + 1u; t <= params.tile_total; t++) { starts[t] = n; }
    }
}
