@group(0) @binding(0) var<uniform> sort: SortPass;
@group(0) @binding(1) var<storage, read> state: array<u32>;
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read> values: array<u32>;
@group(0) @binding(4) var<storage, read> histogram: array<u32>;
@group(0) @binding(5) var<storage, read> totals: array<u32>;
@group(0) @binding(6) var<storage, read_write> sorted_keys: array<u32>;
@group(0) @binding(7) var<storage, read_write> sorted_values: array<u32>;

// Per lane group and digit: how many, then how many in the lane groups before.
var<workgroup> counts: array<atomic<u32>, SORT_GROUPS * DIGITS>;
// Where this block's keys of a digit begin.
var<workgroup> starts: array<u32, DIGITS>;

// `lane` of `width` in lane group `group`; a lane group's keys are consecutive, and so are a row's.
fn scatter(block: u32, thread: u32, lane: u32, group: u32, width: u32) {
    let n = state[sort.count_slot];
    if (block * SORT_BLOCK >= n) { return; }
    for (var i = thread; i < SORT_GROUPS * DIGITS; i += SORT_THREADS) { atomicStore(&counts[i], 0u); }
    // Digits before this one: four totals a thread where there are 64 threads, one where there are 256.
    let each = DIGITS / SORT_THREADS;
    var mine = 0u;
    for (var k = 0u; k < each; k++) { mine += totals[thread * each + k]; }
    var before = inclusive_scan(thread, mine) - mine;
    for (var k = 0u; k < each; k++) {
        let d = thread * each + k;
        starts[d] = before + histogram[d * sort.stride + block];
        before += totals[d];
    }
    workgroupBarrier();

    let skip = (sort.flags & SKIP_SENTINELS) != 0u;
    let base = block * SORT_BLOCK + group * width * SORT_ITEMS + lane;
    var key: array<u32, SORT_ITEMS>;
    var rank: array<u32, SORT_ITEMS>;
    for (var k = 0u; k < SORT_ITEMS; k++) {
        let i = base + k * width;
        var one = SENTINEL;
        if (i < n) { one = keys[i]; }
        let valid = i < n && !(skip && one == SENTINEL);
        key[k] = one;
        rank[k] = rank_in_group((one >> sort.shift) & 255u, valid, thread, lane, group);
    }
    workgroupBarrier();
    for (var d = thread; d < DIGITS; d += SORT_THREADS) {
        var running = 0u;
        for (var g = 0u; g < SORT_GROUPS; g++) {
            let own = atomicLoad(&counts[g * DIGITS + d]);
            atomicStore(&counts[g * DIGITS + d], running);
            running += own;
        }
    }
    workgroupBarrier();
    let implicit = (sort.flags & IMPLICIT_VALUES) != 0u;
    for (var k = 0u; k < SORT_ITEMS; k++) {
        let i = base + k * width;
        if (i < n && !(skip && key[k] == SENTINEL)) {
            let d = (key[k] >> sort.shift) & 255u;
            let to = starts[d] + atomicLoad(&counts[group * DIGITS + d]) + rank[k];
            sorted_keys[to] = key[k];
            var value = i;
            if (!implicit) { value = values[i]; }
            sorted_values[to] = value;
        }
    }
}
