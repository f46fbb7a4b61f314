// loss/fused.rs: the loss by its pixels.
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read> goal: array<u32>;
@group(0) @binding(3) var<storage, read> derivatives: array<f32>;
@group(0) @binding(4) var<storage, read_write> gradient: array<f32>;
@group(0) @binding(5) var<storage, read_write> block_losses: array<vec4<f32>>;

// The three derivatives of S, blurred down columns, then along rows.
var<workgroup> shared_rows: array<f32, 3u * BLOCK_HEIGHT * PITCH>;
var<workgroup> reduce: array<f32, THREADS>;

// dL/d(inverse depth) at a pixel, and what it adds to the loss.
fn of_depth(grid: GridParams, own: u32) -> vec2<f32> {
    // Inverse depth, confidence.
    let truth = unpack2x16float(goal[grid.depth_at + own]);
    let difference = image[3u * params.pixel_total + grid.first_pixel + own] - truth.x;
    return truth.y * vec2(grid.depth_scale * sign(difference), abs(difference));
}

// dL/dimage of one channel of a block: the derivatives of S blurred once more, the sign of the difference. With the first channel the
// inverse depths' as well.
@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let index = group_number(id);
    let c = index % 3u;
    if (index >= 3u * params.blocks_total) { return; }
    let b = block_of(index / 3u);
    let grid = params.grids[b.modality];
    let is_own = thread - RADIUS < BLOCK_WIDTH;
    let to = c * params.pixel_total + grid.first_pixel;
    if (c >= grid.channels) {
        if (is_own) {
            for (var k = 0u; k < BLOCK_HEIGHT; k++) {
                let row = row_of(b, thread, i32(k + RADIUS));
                if (row.inside) { gradient[to + row.at] = 0.0; }
            }
        }
        return;
    }
    let source = 3u * c * params.pixel_total + grid.first_pixel;
    {
DOWN
    }
    workgroupBarrier();
    let row = thread % BLOCK_HEIGHT;
    let eighth = thread / BLOCK_HEIGHT;
    let from_row = row * PITCH + min(eighth, EIGHTHS - 1u) * 8u;
ACROSS
    workgroupBarrier();
    if (eighth < EIGHTHS) {
KEEP
    }
    workgroupBarrier();
    if (is_own) {
        let plane = c * grid.size.x * grid.size.y;
        let from_column = thread - RADIUS;
STORE
    }
    if (c != 0u) { return; }
    var depth_loss = 0.0;
    let has_depth = grid.depth_scale > 0.0;
    if (is_own) {
        for (var k = 0u; k < BLOCK_HEIGHT; k++) {
            let row = row_of(b, thread, i32(k + RADIUS));
            if (!row.inside) { continue; }
            var d = vec2(0.0);
            if (has_depth) { d = of_depth(grid, row.at); }
            gradient[3u * params.pixel_total + grid.first_pixel + row.at] = d.x;
            depth_loss += d.y;
        }
    }
    if (has_depth) {
        reduce[thread] = depth_loss;
        workgroupBarrier();
        for (var step = THREADS / 2u; step > 0u; step >>= 1u) {
            if (thread < step) { reduce[thread] += reduce[thread + step]; }
            workgroupBarrier();
        }
        if (thread == 0u) { block_losses[index].z = reduce[0]; }
    }
}
