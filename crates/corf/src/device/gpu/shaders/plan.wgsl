@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> state: array<u32>;
@group(0) @binding(2) var<storage, read_write> block_sums: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read_write> args: array<vec4<u32>>;

// One workgroup: how many Gaussians are visible and how many pairs they make before each block of 256, whether there is room for
// them, and the workgroups that follow from it. A thread sums a run of blocks.
@compute @workgroup_size(SCAN)
fn main(@builtin(local_invocation_index) thread: u32) {
    let blocks = (params.gaussians + 255u) / 256u;
    let run = (blocks + SCAN - 1u) / SCAN;
    let first = min(thread * run, blocks);
    let end = min(first + run, blocks);
    var mine = vec2(0u);
    for (var b = first; b < end; b++) { mine += block_sums[b].xy; }
    let sums = inclusive_scan(thread, vec4(mine, 0u, 0u));
    let visible = sums.x;
    let pairs = sums.y;
    var before = sums.xy - mine;
    for (var b = first; b < end; b++) {
        let own = block_sums[b];
        block_sums[b] = vec4(before, own.zw);
        before += own.xy;
    }
    if (thread == SCAN - 1u) {
        state[NEEDED] = max(state[NEEDED], pairs);
        // A frame without room draws nothing and changes nothing; neither does any after it change anything.
        state[MOST_VISIBLE] = max(state[MOST_VISIBLE], visible);
        if (pairs > params.pair_capacity || visible > params.visible_capacity) { state[FAILED] = 1u; }
        let fits = state[FAILED] == 0u;
        state[VISIBLE] = select(0u, visible, fits);
        state[PAIRS] = select(0u, pairs, fits);
        state[LISTED] = 0u;
        state[CHECKPOINTS] = 0u;
        state[BUCKETS] = 0u;
        state[FINISHED] = 0u;
        state[DRAWABLE] = 0u;
        args[ARGS_APPEARANCE] = folded((state[VISIBLE] + EACH - 1u) / EACH);
        args[ARGS_GEOMETRY] = folded((state[VISIBLE] + 63u) / 64u);
        args[ARGS_PAIRS] = folded((state[PAIRS] + 255u) / 256u);
    }
}
