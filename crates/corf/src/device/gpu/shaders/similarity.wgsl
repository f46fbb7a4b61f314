@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> image: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> goal: array<f32>;
@group(0) @binding(3) var<storage, read_write> derivatives: array<f32>;
@group(0) @binding(4) var<storage, read_write> block_losses: array<vec4<f32>>;

var<workgroup> xs: array<f32, WIDE * WIDE>;
var<workgroup> ys: array<f32, WIDE * WIDE>;
// Moments blurred along rows: x, x², xy, y, y².
var<workgroup> across: array<f32, 5u * WIDE * BLOCK>;
var<workgroup> reduce: array<f32, 256>;

fn total(thread: u32, value: f32) -> f32 {
    reduce[thread] = value;
    workgroupBarrier();
    for (var step = 128u; step > 0u; step >>= 1u) {
        if (thread < step) { reduce[thread] += reduce[thread + step]; }
        workgroupBarrier();
    }
    let sum = reduce[0];
    workgroupBarrier();
    return sum;
}

// S and its derivatives by the moments, channel by channel; sums of S and |x − y| of the block.
@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let index = group_number(id);
    if (index >= params.blocks_total) { return; }
    let b = block_of(index);
    let grid = params.grids[b.modality];
    let pixels = grid.size.x * grid.size.y;
    let own = vec2<i32>(vec2(thread % BLOCK, thread / BLOCK));
    let pixel = b.corner + own;
    let inside = all(pixel < b.size);
    let at = u32(pixel.y) * grid.size.x + u32(pixel.x);
    var similarity = 0.0;
    var difference = 0.0;
    for (var c = 0u; c < grid.channels; c++) {
        for (var i = thread; i < WIDE * WIDE; i += 256u) {
            let p = b.corner + vec2(i32(i % WIDE), i32(i / WIDE)) - i32(RADIUS);
            var x = 0.0;
            var y = 0.0;
            if (all(p >= vec2(0)) && all(p < b.size)) {
                let source = u32(p.y) * grid.size.x + u32(p.x);
                x = image[grid.first_pixel + source][c];
                y = goal[grid.target_at + c * pixels + source];
            }
            xs[i] = x;
            ys[i] = y;
        }
        workgroupBarrier();
        for (var i = thread; i < WIDE * BLOCK; i += 256u) {
            let source = (i / BLOCK) * WIDE + i % BLOCK;
            var m = vec4(0.0);
            var m5 = 0.0;
            for (var k = 0u; k < 2u * RADIUS + 1u; k++) {
                let w = window(u32(abs(i32(k) - i32(RADIUS))));
                let x = xs[source + k];
                let y = ys[source + k];
                m += w * vec4(x, x * x, x * y, y);
                m5 += w * (y * y);
            }
            across[i] = m.x;
            across[i + WIDE * BLOCK] = m.y;
            across[i + 2u * WIDE * BLOCK] = m.z;
            across[i + 3u * WIDE * BLOCK] = m.w;
            across[i + 4u * WIDE * BLOCK] = m5;
        }
        workgroupBarrier();
        var m = vec4(0.0);
        var yy = 0.0;
        for (var k = 0u; k < 2u * RADIUS + 1u; k++) {
            let w = window(u32(abs(i32(k) - i32(RADIUS))));
            let i = (u32(own.y) + k) * BLOCK + u32(own.x);
            m += w * vec4(across[i], across[i + WIDE * BLOCK], across[i + 2u * WIDE * BLOCK], across[i + 3u * WIDE * BLOCK]);
            yy += w * across[i + 4u * WIDE * BLOCK];
        }
        if (inside) {
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
            // ∂S/∂E xy, ∂S/∂E x², ∂S/∂μ_x (the last through μ itself and through both (co)variances).
            let d_xy = 2.0 * a1 * r;
            let d_xx = -(s * r2);
            let d_mean = 2.0 * (my * a2 * r - mx * s * r1) - my * d_xy - 2.0 * mx * d_xx;
            let to = grid.first_pixel + at;
            derivatives[(3u * c) * params.pixel_total + to] = d_mean;
            derivatives[(3u * c + 1u) * params.pixel_total + to] = d_xx;
            derivatives[(3u * c + 2u) * params.pixel_total + to] = d_xy;
            similarity += s;
            let i = (u32(own.y) + RADIUS) * WIDE + u32(own.x) + RADIUS;
            difference += abs(xs[i] - ys[i]);
        }
        workgroupBarrier();
    }
    let s = total(thread, similarity);
    let d = total(thread, difference);
    if (thread == 0u) { block_losses[index] = vec4(s, d, 0.0, 0.0); }
}
