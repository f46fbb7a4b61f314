@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> goal: array<u32>;
@group(0) @binding(2) var<storage, read_write> planes: array<f32>;

// Gives the pixels of the optical image that do not count another value, in all channels.
@compute @workgroup_size(PIXELS)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let grid = params.grids[0];
    let i = group_number(id) * PIXELS + thread;
    let pixels = grid.size.x * grid.size.y;
    if (i >= pixels) { return; }
    if (((goal[grid.mask_at + i / 32u] >> (i % 32u)) & 1u) == 1u) { return; }
    for (var c = 0u; c < grid.channels; c++) {
        planes[c * params.pixel_total + grid.first_pixel + i] = VALUE;
    }
}
