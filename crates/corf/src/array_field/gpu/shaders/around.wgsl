// BᵀA of lists of matrices B and one A, symmetric: twice in a row that is ABA of a symmetric B. One thread an entry.
@group(0) @binding(1) var<storage, read> inverse: array<f32>;
@group(0) @binding(2) var<storage, read> matrices: array<f32>;
@group(0) @binding(3) var<storage, read_write> products: array<f32>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let i = 64u * group_number(id) + t;
    let list = i / (SIZE * SIZE);
    if (list >= LISTS) { return; }
    let first = list * SIZE * SIZE;
    let m = i / SIZE % SIZE;
    let n = i % SIZE;
    var sum = 0.0;
    for (var j = 0u; j < SIZE; j++) { sum += matrices[first + j * SIZE + m] * inverse[j * SIZE + n]; }
    products[i] = sum;
}
