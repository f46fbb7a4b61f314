// bᵀQb of matrices Q as tables of cosines and sines of lags: one thread an entry of a table, which adds up the pairs of elements at its lag.
@group(0) @binding(1) var<storage, read> matrices: array<f32>;
@group(0) @binding(2) var<storage, read_write> tables: array<f32>;

// The sum of the entries whose columns and rows differ by a lag; or, of those of φ_m + φ_n, add up to it from the centre.
fn sum_at(first: u32, lag: vec2<i32>, differ: bool) -> f32 {
    let elements = vec2(i32(COLUMNS), i32(ROWS));
    var total = 0.0;
    for (var column = 0; column < elements.x; column++) {
        let c = select(elements.x - 1 - column, column, differ) + lag.x;
        if (c < 0 || c >= elements.x) { continue; }
        for (var row = 0; row < elements.y; row++) {
            let r = select(elements.y - 1 - row, row, differ) + lag.y;
            if (r < 0 || r >= elements.y) { continue; }
            total += matrices[first + u32(c * elements.y + r) * SIZE + u32(column * elements.y + row)];
        }
    }
    return total;
}

// The sum of the diagonal.
fn trace(first: u32) -> f32 {
    var total = 0.0;
    for (var m = 0u; m < SIZE; m++) { total += matrices[first + m * (SIZE + 1u)]; }
    return total;
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let i = 64u * group_number(id) + t;
    let list = i / (4u * ENTRIES);
    if (list >= LISTS) { return; }
    let first = list * SIZE * SIZE;
    let y = i / STRIDE % (2u * COLUMNS);
    let z = i % STRIDE;
    // Whether the entry is of a sine, and the lag.
    let sine = vec2(y % 2u == 1u, z % 2u == 1u);
    let lag = vec2<i32>(vec2(y, z) / 2u);
    var total = 0.0;
    for (var turn = 0; turn < 4; turn++) {
        let signs = vec2(1 - 2 * (turn % 2), 1 - 2 * (turn / 2));
        // No lag has one sign, and no sine.
        if (any((lag == vec2(0)) & ((signs < vec2(0)) | sine))) { continue; }
        let both = select(1i, signs.x, sine.x) * select(1i, signs.y, sine.y);
        let factor = f32(select(both, -both, all(sine)));
        total += factor * sum_at(first, signs * lag, sine.x == sine.y);
    }
    ADD
    tables[i] = total;
}
