@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> image: array<f32>;
@group(0) @binding(2) var<storage, read> goal: array<f32>;
@group(0) @binding(3) var<storage, read> derivatives: array<f32>;
@group(0) @binding(4) var<storage, read_write> gradient: array<f32>;
@group(0) @binding(5) var<storage, read_write> block_losses: array<vec4<f32>>;

// The three derivatives of S, then blurred along rows.
var<workgroup> wide: array<f32, 3u * TALL * PITCH>;
var<workgroup> across: array<vec4<f32>, 3u * TALL * QUADS>;
var<workgroup> reduce: array<f32, THREADS>;

fn blurred(number: u32, row: u32, column: u32) -> f32 { return across[(number * TALL + row) * QUADS + column / 4u][column % 4u]; }

// dL/dimage of one channel of a block: the derivatives of S blurred once more, the sign of the difference. With the first channel the
// inverse depths' as well.
@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let index = group_number(id);
    let c = index % 3u;
    if (index >= 3u * params.blocks_total) { return; }
    let b = block_of(index / 3u);
    let grid = params.grids[b.modality];
    let pixels = grid.size.x * grid.size.y;
    let source = 3u * c * params.pixel_total + grid.first_pixel;
    let exists = c < grid.channels;
    for (var i = thread; i < WIDE * TALL; i += THREADS) {
        let p = b.corner + vec2(i32(i % WIDE), i32(i / WIDE)) - i32(RADIUS);
        var d = vec3(0.0);
        // Beyond the border there is no S.
        if (exists && all(p >= vec2(0)) && all(p < b.size)) {
            let at = source + u32(p.y) * grid.size.x + u32(p.x);
            d = vec3(derivatives[at], derivatives[at + params.pixel_total], derivatives[at + 2u * params.pixel_total]);
        }
        let to = i / WIDE * PITCH + i % WIDE;
        wide[to] = d.x;
        wide[to + TALL * PITCH] = d.y;
        wide[to + 2u * TALL * PITCH] = d.z;
    }
    workgroupBarrier();
    for (var i = thread; i < TALL * QUADS; i += THREADS) {
        let at = i / QUADS * PITCH + i % QUADS * 4u;
ACROSS
        across[i] = vec4(m0.x, m1.x, m2.x, m3.x);
        across[i + TALL * QUADS] = vec4(m0.y, m1.y, m2.y, m3.y);
        across[i + 2u * TALL * QUADS] = vec4(m0.z, m1.z, m2.z, m3.z);
    }
    workgroupBarrier();
    let column = thread % BLOCK_WIDTH;
    let row = thread / BLOCK_WIDTH * 4u;
DOWN
    var depth_loss = 0.0;
    for (var k = 0u; k < 4u; k++) {
        let pixel = b.corner + vec2(i32(column), i32(row + k));
        if (all(pixel < b.size)) {
            var d = m0;
            if (k == 1u) { d = m1; } else if (k == 2u) { d = m2; } else if (k == 3u) { d = m3; }
            let own = u32(pixel.y) * grid.size.x + u32(pixel.x);
            let at = grid.first_pixel + own;
            var value = 0.0;
            if (exists) {
                let x = image[c * params.pixel_total + at];
                let y = goal[grid.target_at + c * pixels + own];
                let s = d.x + 2.0 * x * d.y + y * d.z;
                value = grid.scale * ((1.0 - params.ssim_weight) * sign(x - y) - params.ssim_weight * s);
            }
            gradient[c * params.pixel_total + at] = value;
            if (c == 0u) {
                var of_depth = 0.0;
                if (grid.depth_scale > 0.0) {
                    let confidence = goal[grid.depth_at + pixels + own];
                    let difference = image[3u * params.pixel_total + at] - goal[grid.depth_at + own];
                    of_depth = grid.depth_scale * confidence * sign(difference);
                    depth_loss += confidence * abs(difference);
                }
                gradient[3u * params.pixel_total + at] = of_depth;
            }
        }
    }
    if (c == 0u && grid.depth_scale > 0.0) {
        reduce[thread] = depth_loss;
        workgroupBarrier();
        for (var step = THREADS / 2u; step > 0u; step >>= 1u) {
            if (thread < step) { reduce[thread] += reduce[thread + step]; }
            workgroupBarrier();
        }
        if (thread == 0u) { block_losses[index].z = reduce[0]; }
    }
}
