// Inverses of symmetric positive definite matrices, in place: Gauss and Jordan's elimination, a workgroup a matrix. A row and column at a time are swept,
// after which there is −A⁻¹; no pivots are looked for, as all are at least the least eigenvalue.
@group(0) @binding(1) var<storage, read_write> matrices: array<f32>;

const SWEEPERS = 256u;

// The row and column that are swept.
var<workgroup> row: array<f32, SIZE>;

fn sweep(first: u32, k: u32, inverse: f32, e: u32) {
    if (e >= SIZE * SIZE) { return; }
    let i = e / SIZE;
    let j = e % SIZE;
    var swept = AT[e] - row[i] * row[j] * inverse;
    if (i == k) { swept = row[j] * inverse; }
    if (j == k) { swept = row[i] * inverse; }
    if (i == k && j == k) { swept = -inverse; }
    AT[e] = swept;
}

@compute @workgroup_size(SWEEPERS)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let list = group_number(id);
    if (list >= job.receivers) { return; }
    let first = list * SIZE * SIZE;
    TAKE
    for (var k = 0u; k < SIZE; k++) {
        if (t < SIZE) { row[t] = AT[k * SIZE + t]; }
        workgroupBarrier();
        let inverse = 1.0 / row[k];
        // Four at once: none waits for the memory that another waits for. And Mesa's software adapter leaves loops after 65535 turns in all.
        for (var e = t; e < SIZE * SIZE; e += 4u * SWEEPERS) {
            sweep(first, k, inverse, e);
            sweep(first, k, inverse, e + SWEEPERS);
            sweep(first, k, inverse, e + 2u * SWEEPERS);
            sweep(first, k, inverse, e + 3u * SWEEPERS);
        }
        storageBarrier();
        workgroupBarrier();
    }
    for (var e = t; e < SIZE * SIZE; e += SWEEPERS) { matrices[first + e] = -AT[e]; }
}
