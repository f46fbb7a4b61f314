@group(0) @binding(0) var<uniform> sort: SortPass;
@group(0) @binding(1) var<storage, read> state: array<u32>;
@group(0) @binding(2) var<storage, read> keys: array<u32>;
@group(0) @binding(3) var<storage, read_write> histogram: array<u32>;

var<workgroup> counts: array<atomic<u32>, DIGITS>;

@compute @workgroup_size(SORT_THREADS)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let block = group_number(id);
    let n = state[sort.count_slot];
    if (block * SORT_BLOCK >= n) { return; }
    for (var d = thread; d < DIGITS; d += SORT_THREADS) { atomicStore(&counts[d], 0u); }
    workgroupBarrier();
    let skip = (sort.flags & SKIP_SENTINELS) != 0u;
    for (var k = 0u; k < SORT_ITEMS; k++) {
        let i = block * SORT_BLOCK + k * SORT_THREADS + thread;
        if (i < n) {
            let key = keys[i];
            if (!(skip && key == SENTINEL)) { atomicAdd(&counts[(key >> sort.shift) & 255u], 1u); }
        }
    }
    workgroupBarrier();
    for (var d = thread; d < DIGITS; d += SORT_THREADS) { histogram[d * sort.stride + block] = atomicLoad(&counts[d]); }
}
