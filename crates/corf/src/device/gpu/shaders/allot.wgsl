@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> state: array<atomic<u32>>;
@group(0) @binding(2) var<storage, read_write> tile_sizes: array<u32>;
@group(0) @binding(3) var<storage, read_write> lists: array<List>;
@group(0) @binding(4) var<storage, read_write> bucket_tiles: array<u32>;
@group(0) @binding(5) var<storage, read_write> args: array<vec4<u32>>;
@group(0) @binding(6) var<storage, read_write> chunks: array<vec2<u32>>;

var<workgroup> bases: vec4<u32>;

// Room for each tile's entries, checkpoints, buckets and, where its list is ordered by several workgroups, chunks. In which order
// workgroups come to their turn decides where a list lies and nothing else. Sizes are left at zero for the next frame.
@compute @workgroup_size(SCAN)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let group = group_number(id);
    let groups = (params.tile_total + SCAN - 1u) / SCAN;
    if (group >= groups) { return; }
    let tile = group * SCAN + thread;
    var count = 0u;
    if (tile < params.tile_total) {
        count = tile_sizes[COUNTER * tile];
        tile_sizes[COUNTER * tile] = 0u;
    }
    let buckets = (count + BUCKET - 1u) / BUCKET;
    let saved = max(buckets, 1u) - 1u;
    let sums = inclusive_scan(thread, vec4(count, saved, buckets, chunks_of(count)));
    if (thread == SCAN - 1u) {
        bases = vec4(
            atomicAdd(&state[LISTED], sums.x),
            atomicAdd(&state[CHECKPOINTS], sums.y),
            atomicAdd(&state[BUCKETS], sums.z),
            atomicAdd(&state[CHUNKS], sums.w),
        );
    }
    let base = workgroupUniformLoad(&bases);
    if (tile < params.tile_total) {
        let bucket = base.z + sums.z - buckets;
        lists[tile] = List(base.x + sums.x - count, count, base.y + sums.y - saved, bucket);
        for (var b = 0u; b < buckets; b++) { bucket_tiles[bucket + b] = tile; }
        let parts = chunks_of(count);
        for (var c = 0u; c < parts; c++) { chunks[base.w + sums.w - parts + c] = vec2(tile, c); }
    }
    if (thread == 0u && atomicAdd(&state[FINISHED], 1u) == groups - 1u) {
        args[ARGS_BUCKETS] = folded((atomicLoad(&state[BUCKETS]) + BUCKETS_A_GROUP - 1u) / BUCKETS_A_GROUP);
        let all = atomicLoad(&state[CHUNKS]);
        args[ARGS_ORDER] = folded(params.tile_total + all);
        args[ARGS_MERGE] = folded(all);
        atomicStore(&state[FINISHED], 0u);
    }
}
