// images/laplacian_of_gaussian.rs: rows smoothed.
@group(0) @binding(2) var<storage, read> image: array<f32>;
@group(0) @binding(3) var<storage, read_write> smoothed: array<f32>;

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let at = group_number(id) * 256u + thread;
    if (at >= 3u * params.pixel_total) { return; }
    let width = params.grids[0].size.x;
    let x = i32(at % width);
    let row = at - u32(x);
    let count = i32(question[WEIGHTS]);
    var sum = 0.0;
    for (var k = 0; k < count; k++) {
        sum = fma(question[FIRST_WEIGHT + u32(k)], image[row + held(x + k - count / 2, width)], sum);
    }
    smoothed[at] = sum;
}
