@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> state: array<u32>;
@group(0) @binding(2) var<storage, read_write> block_sums: array<vec4<u32>>;
@group(0) @binding(3) var<storage, read_write> args: array<vec4<u32>>;
@group(0) @binding(4) var<storage, read_write> shares: array<u32>;

// Blocks of more shares than this are listed by all threads together.
const FEW = 16u;
// Such blocks: number, first share, shares.
var<workgroup> wide: array<vec3<u32>, SCAN>;
var<workgroup> wide_count: atomic<u32>;
var<workgroup> fits: u32;

// Writes whose a block's shares are, or leaves it to all threads where these are many and there is a place for one more such block.
fn list(block: u32, first: u32, count: u32) {
    if (count > FEW) {
        let at = atomicAdd(&wide_count, 1u);
        if (at < SCAN) {
            wide[at] = vec3(block, first, count);
            return;
        }
    }
    for (var s = 0u; s < count; s++) { shares[first + s] = block; }
}

// The frame's counts and what is dispatched by them: visible Gaussians, pairs, shares.
fn settle(sums: vec3<u32>) {
    state[NEEDED] = max(state[NEEDED], sums.y);
    // A frame without room draws nothing and changes nothing; neither does any after it change anything.
    state[MOST_VISIBLE] = max(state[MOST_VISIBLE], sums.x);
    if (sums.y > params.pair_capacity || sums.x > params.visible_capacity) { state[FAILED] = 1u; }
    fits = u32(state[FAILED] == 0u);
    state[VISIBLE] = fits * sums.x;
    state[PAIRS] = fits * sums.y;
    state[SHARES] = fits * sums.z;
    state[LISTED] = 0u;
    state[CHECKPOINTS] = 0u;
    state[BUCKETS] = 0u;
    state[CHUNKS] = 0u;
    state[FINISHED] = 0u;
    state[DRAWABLE] = 0u;
    // Behind the last block, so that each finds its own counts.
    block_sums[(params.gaussians + 255u) / 256u] = vec4(sums.xy, 0u, sums.z);
    args[ARGS_APPEARANCE] = folded((state[VISIBLE] + EACH - 1u) / EACH);
    args[ARGS_GEOMETRY] = folded((state[VISIBLE] + 63u) / 64u);
    args[ARGS_PAIRS] = folded((state[PAIRS] + 255u) / 256u);
    args[ARGS_SHARES] = folded(state[SHARES]);
}

// One workgroup: how many Gaussians are visible, how many pairs they make and how many shares of SHARE pairs before each block of 256,
// whether there is room for them, whose each share is, and the workgroups that follow from it. A thread sums a run of blocks.
@compute @workgroup_size(SCAN)
fn main(@builtin(local_invocation_index) thread: u32) {
    let blocks = (params.gaussians + 255u) / 256u;
    let run = (blocks + SCAN - 1u) / SCAN;
    let first = min(thread * run, blocks);
    let end = min(first + run, blocks);
    if (thread == 0u) { atomicStore(&wide_count, 0u); }
    var mine = vec3(0u);
    for (var b = first; b < end; b++) {
        let own = block_sums[b].xy;
        mine += vec3(own, (own.y + SHARE - 1u) / SHARE);
    }
    let sums = inclusive_scan(thread, vec4(mine, 0u)).xyz;
    if (thread == SCAN - 1u) { settle(sums); }
    if (workgroupUniformLoad(&fits) == 0u) { return; }
    var before = sums - mine;
    for (var b = first; b < end; b++) {
        let own = block_sums[b];
        let count = (own.y + SHARE - 1u) / SHARE;
        block_sums[b] = vec4(before.xy, own.z, before.z);
        list(b, before.z, count);
        before += vec3(own.xy, count);
    }
    workgroupBarrier();
    for (var w = 0u; w < min(atomicLoad(&wide_count), SCAN); w++) {
        let one = wide[w];
        for (var s = thread; s < one.z; s += SCAN) { shares[one.y + s] = one.x; }
    }
}
