@group(0) @binding(0) var<uniform> sort: SortPass;
@group(0) @binding(1) var<storage, read> state: array<u32>;
@group(0) @binding(2) var<storage, read_write> histogram: array<u32>;
@group(0) @binding(3) var<storage, read_write> totals: array<u32>;

var<workgroup> row_total: u32;

// One workgroup a digit: exclusive sums along its row.
@compute @workgroup_size(SCAN)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let n = state[sort.count_slot];
    let blocks = (n + SORT_BLOCK - 1u) / SORT_BLOCK;
    let row = id.x * sort.stride;
    var before = 0u;
    for (var first = 0u; first < blocks; first += SCAN) {
        let i = first + thread;
        var value = 0u;
        if (i < blocks) { value = histogram[row + i]; }
        let sum = inclusive_scan(thread, value);
        if (i < blocks) { histogram[row + i] = before + sum - value; }
        if (thread == SCAN - 1u) { row_total = sum; }
        before += workgroupUniformLoad(&row_total);
    }
    if (thread == 0u) { totals[id.x] = before; }
}
