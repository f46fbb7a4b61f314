// Σ w·bbᵀ of tables of waves or pixels, by rows, of the steering vectors b = cas φ: b_m b_n = cos(φ_m − φ_n) + sin(φ_m + φ_n), both of which are lags.
// One thread an entry.
@group(0) @binding(1) var<storage, read> tables: array<f32>;
@group(0) @binding(2) var<storage, read_write> matrices: array<f32>;

// Column and row of an element.
fn place(i: u32) -> vec2<i32> { return vec2(i32(i / ROWS), i32(i % ROWS)); }

fn product(first: u32, m: vec2<i32>, n: vec2<i32>) -> f32 {
    let difference = m - n;
    let sum = m + n - vec2(i32(COLUMNS) - 1, i32(ROWS) - 1);
    let of_difference = sign(difference);
    let of_sum = vec2<f32>(sign(sum));
    let d = first + 2u * u32(abs(difference.x)) * STRIDE + 2u * u32(abs(difference.y));
    let s = first + 2u * u32(abs(sum.x)) * STRIDE + 2u * u32(abs(sum.y));
    let cosine = tables[d] - f32(of_difference.x * of_difference.y) * tables[d + STRIDE + 1u];
    return cosine + (of_sum.x * tables[s + STRIDE] + of_sum.y * tables[s + 1u]);
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let i = 64u * group_number(id) + t;
    let list = i / (SIZE * SIZE);
    if (list >= LISTS) { return; }
    let first = list * 4u * ENTRIES;
    let m = i / SIZE % SIZE;
    let n = i % SIZE;
    let entry = product(first, place(m), place(n));
    STORE
}
