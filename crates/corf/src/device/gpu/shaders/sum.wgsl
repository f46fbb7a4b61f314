@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> state: array<u32>;
@group(0) @binding(2) var<storage, read_write> block_sums: array<u32>;
@group(0) @binding(3) var<storage, read_write> args: array<vec4<u32>>;

var<workgroup> row_total: u32;

// One workgroup: exclusive sums over the blocks, the number of pairs, and whether there is room for them.
@compute @workgroup_size(SCAN)
fn main(@builtin(local_invocation_index) thread: u32) {
    let blocks = (state[VISIBLE] + 255u) / 256u;
    var before = 0u;
    for (var first = 0u; first < blocks; first += SCAN) {
        let i = first + thread;
        var value = 0u;
        if (i < blocks) { value = block_sums[i]; }
        let sum = inclusive_scan(thread, value);
        if (i < blocks) { block_sums[i] = before + sum - value; }
        if (thread == SCAN - 1u) { row_total = sum; }
        before += workgroupUniformLoad(&row_total);
    }
    if (thread == 0u) {
        state[NEEDED] = max(state[NEEDED], before);
        if (before > params.pair_capacity) { state[FAILED] = 1u; }
        let pairs = min(before, params.pair_capacity);
        state[PAIRS] = pairs;
        args[ARGS_PAIR_SORT] = folded((pairs + SORT_BLOCK - 1u) / SORT_BLOCK);
        args[ARGS_PAIRS_256] = folded((pairs + 255u) / 256u);
    }
}
