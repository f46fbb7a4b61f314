// loss/fused.rs: structural similarity and its derivatives.
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read> goal: array<u32>;
@group(0) @binding(3) var<storage, read_write> derivatives: array<f32>;
@group(0) @binding(4) var<storage, read_write> block_losses: array<vec4<f32>>;

// Moments blurred down columns: x, x², xy, y, y²; then the three derivatives of S.
var<workgroup> shared_rows: array<f32, 5u * BLOCK_HEIGHT * PITCH>;
var<workgroup> reduce: array<vec2<f32>, THREADS>;

// S and its derivatives by the moments of one pixel: ∂S/∂μ_x, ∂S/∂E x², ∂S/∂E xy, S.
fn similarity(mx: f32, xx: f32, xy: f32, my: f32, yy: f32) -> vec4<f32> {
    let a1 = 2.0 * mx * my + C1;
    let a2 = 2.0 * (xy - mx * my) + C2;
    let b1 = mx * mx + my * my + C1;
    let b2 = (xx - mx * mx) + (yy - my * my) + C2;
    let r1 = 1.0 / b1;
    let r2 = 1.0 / b2;
    let r = r1 * r2;
    let s = a1 * a2 * r;
    let d_xy = 2.0 * a1 * r;
    let d_xx = -(s * r2);
    // Through μ itself and through both (co)variances.
    let d_mean = 2.0 * (my * a2 * r - mx * s * r1) - my * d_xy - 2.0 * mx * d_xx;
    return vec4(d_mean, d_xx, d_xy, s);
}

// S and its derivatives of one channel of a block, and the block's sums of S and |x − y|.
@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let index = group_number(id);
    let c = index % 3u;
    if (index >= 3u * params.blocks_total) { return; }
    let b = block_of(index / 3u);
    let grid = params.grids[b.modality];
    if (c >= grid.channels) {
        if (thread == 0u) { block_losses[index] = vec4(0.0); }
        return;
    }
    let source = c * params.pixel_total + grid.first_pixel;
    let plane = c * grid.size.x * grid.size.y;
    var sums = vec2(0.0);
    let is_own = thread - RADIUS < BLOCK_WIDTH;
    {
DOWN
        if (is_own) { sums.y = DIFFERENCES; }
    }
    workgroupBarrier();
    let row = thread % BLOCK_HEIGHT;
    let eighth = thread / BLOCK_HEIGHT;
    let from_row = row * PITCH + min(eighth, EIGHTHS - 1u) * 8u;
    let free = b.size - b.corner - vec2(i32(eighth * 8u), i32(row));
ACROSS
    workgroupBarrier();
    if (eighth < EIGHTHS) {
KEEP
    }
    reduce[thread] = sums;
    workgroupBarrier();
    if (is_own) {
        let to = 3u * c * params.pixel_total + grid.first_pixel;
        let from_column = thread - RADIUS;
STORE
    }
    if (thread < 16u) {
        for (var k = thread + 16u; k < THREADS; k += 16u) { sums += reduce[k]; }
        reduce[thread] = sums;
    }
    workgroupBarrier();
    if (thread == 0u) {
        for (var k = 1u; k < 16u; k++) { sums += reduce[k]; }
        block_losses[index] = vec4(sums, 0.0, 0.0);
    }
}
