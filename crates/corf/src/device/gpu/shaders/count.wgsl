@group(0) @binding(0) var<storage, read> state: array<u32>;
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> tile_counts: array<vec2<u32>>;
@group(0) @binding(3) var<storage, read_write> offsets: array<u32>;
@group(0) @binding(4) var<storage, read_write> block_sums: array<u32>;

// In depth order: pairs of the Gaussians before this one within its block of SCAN, and each block's sum.
@compute @workgroup_size(SCAN)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let block = group_number(id);
    let v = block * SCAN + thread;
    var pairs = 0u;
    if (v < state[VISIBLE]) {
        let counts = tile_counts[order[v]];
        pairs = counts.x + counts.y;
    }
    let sum = inclusive_scan(thread, pairs);
    if (v < state[VISIBLE]) { offsets[v] = sum - pairs; }
    if (thread == SCAN - 1u && block * SCAN < max(state[VISIBLE], 1u)) { block_sums[block] = sum; }
}
