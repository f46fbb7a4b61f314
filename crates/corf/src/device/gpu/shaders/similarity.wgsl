@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read> goal: array<f32>;
@group(0) @binding(3) var<storage, read_write> derivatives: array<f32>;
@group(0) @binding(4) var<storage, read_write> block_losses: array<vec4<f32>>;

var<workgroup> xs: array<f32, TALL * PITCH>;
var<workgroup> ys: array<f32, TALL * PITCH>;
// Moments blurred along rows: x, x², xy, y, y².
var<workgroup> across: array<vec4<f32>, 5u * TALL * QUADS>;
var<workgroup> reduce: array<vec2<f32>, THREADS>;

fn moment(number: u32, row: u32, column: u32) -> f32 { return across[(number * TALL + row) * QUADS + column / 4u][column % 4u]; }

// S and its derivatives by the moments of one pixel (x, x², xy, y; y²): ∂S/∂μ_x, ∂S/∂E x², ∂S/∂E xy, S.
fn similarity(m: vec4<f32>, yy: f32) -> vec4<f32> {
    let mx = m.x;
    let my = m.w;
    let a1 = 2.0 * mx * my + C1;
    let a2 = 2.0 * (m.z - mx * my) + C2;
    let b1 = mx * mx + my * my + C1;
    let b2 = (m.y - mx * mx) + (yy - my * my) + C2;
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
    let target_at = grid.target_at + c * grid.size.x * grid.size.y;
    for (var i = thread; i < WIDE * TALL; i += THREADS) {
        let p = b.corner + vec2(i32(i % WIDE), i32(i / WIDE)) - i32(RADIUS);
        var x = 0.0;
        var y = 0.0;
        if (all(p >= vec2(0)) && all(p < b.size)) {
            let at = u32(p.y) * grid.size.x + u32(p.x);
            x = image[source + at];
            y = goal[target_at + at];
        }
        xs[i / WIDE * PITCH + i % WIDE] = x;
        ys[i / WIDE * PITCH + i % WIDE] = y;
    }
    workgroupBarrier();
    for (var i = thread; i < TALL * QUADS; i += THREADS) {
        let at = i / QUADS * PITCH + i % QUADS * 4u;
ACROSS
        across[i] = vec4(m0.x, m1.x, m2.x, m3.x);
        across[i + TALL * QUADS] = vec4(m0.y, m1.y, m2.y, m3.y);
        across[i + 2u * TALL * QUADS] = vec4(m0.z, m1.z, m2.z, m3.z);
        across[i + 3u * TALL * QUADS] = vec4(m0.w, m1.w, m2.w, m3.w);
        across[i + 4u * TALL * QUADS] = vec4(n0, n1, n2, n3);
    }
    workgroupBarrier();
    let column = thread % BLOCK_WIDTH;
    let row = thread / BLOCK_WIDTH * 4u;
DOWN
    let d0 = similarity(m0, n0);
    let d1 = similarity(m1, n1);
    let d2 = similarity(m2, n2);
    let d3 = similarity(m3, n3);
    var sums = vec2(0.0);
    for (var k = 0u; k < 4u; k++) {
        let pixel = b.corner + vec2(i32(column), i32(row + k));
        if (all(pixel < b.size)) {
            var d = d0;
            if (k == 1u) { d = d1; } else if (k == 2u) { d = d2; } else if (k == 3u) { d = d3; }
            let to = 3u * c * params.pixel_total + grid.first_pixel + u32(pixel.y) * grid.size.x + u32(pixel.x);
            derivatives[to] = d.x;
            derivatives[to + params.pixel_total] = d.y;
            derivatives[to + 2u * params.pixel_total] = d.z;
            let i = (row + k + RADIUS) * PITCH + column + RADIUS;
            sums += vec2(d.w, abs(xs[i] - ys[i]));
        }
    }
    reduce[thread] = sums;
    workgroupBarrier();
    for (var step = THREADS / 2u; step > 0u; step >>= 1u) {
        if (thread < step) { reduce[thread] += reduce[thread + step]; }
        workgroupBarrier();
    }
    if (thread == 0u) { block_losses[index] = vec4(reduce[0], 0.0, 0.0); }
}
