// images/laplacian_of_gaussian.rs: columns smoothed.
@group(0) @binding(2) var<storage, read> image: array<f32>;
@group(0) @binding(3) var<storage, read_write> smoothed: array<f32>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let at = group_number(id) * 256u + thread;
    let total = params.pixel_total;
    if (at >= 3u * total) { return; }
    let size = params.grids[0].size;
    let plane = at / total * total;
    let x = (at - plane) % size.x;
    let y = i32((at - plane) / size.x);
    let count = i32(question[WEIGHTS]);
    var sum = 0.0;
    for (var k = 0; k < count; k++) {
        sum = fma(question[FIRST_WEIGHT + u32(k)], image[plane + held(y + k - count / 2, size.y) * size.x + x], sum);
    }
    smoothed[at] = sum;
}
