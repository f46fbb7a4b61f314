// images/laplacian_of_gaussian.rs: where structure is.
@group(0) @binding(2) var<storage, read> smoothed: array<f32>;
@group(0) @binding(3) var<storage, read_write> norm: array<f32>;

// The norm of the Laplacian over the channels.
@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let at = group_number(id) * 256u + thread;
    let total = params.pixel_total;
    if (at >= total) { return; }
    let size = params.grids[0].size;
    let x = i32(at % size.x);
    let y = i32(at / size.x);
    let row = u32(y) * size.x;
    let left = row + held(x - 1, size.x);
    let right = row + held(x + 1, size.x);
    let up = held(y - 1, size.y) * size.x + u32(x);
    let down = held(y + 1, size.y) * size.x + u32(x);
    var squares = 0.0;
    for (var plane = 0u; plane < 3u * total; plane += total) {
        let around = smoothed[plane + left] + smoothed[plane + right] + smoothed[plane + up] + smoothed[plane + down];
        let laplacian = around - 4.0 * smoothed[plane + at];
        squares = fma(laplacian, laplacian, squares);
    }
    norm[at] = sqrt(squares);
}
