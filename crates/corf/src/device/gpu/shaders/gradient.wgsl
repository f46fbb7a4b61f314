@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> image: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> goal: array<f32>;
@group(0) @binding(3) var<storage, read> derivatives: array<f32>;
@group(0) @binding(4) var<storage, read_write> gradient: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> block_losses: array<vec4<f32>>;

var<workgroup> wide: array<f32, 3u * WIDE * WIDE>;
var<workgroup> across: array<f32, 3u * WIDE * BLOCK>;
var<workgroup> reduce: array<f32, 256>;

// dL/dimage: the derivatives of S blurred once more, the sign of the difference, and the depth term.
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
    var g = vec4(0.0);
    for (var c = 0u; c < grid.channels; c++) {
        for (var i = thread; i < WIDE * WIDE; i += 256u) {
            let p = b.corner + vec2(i32(i % WIDE), i32(i / WIDE)) - i32(RADIUS);
            var d = vec3(0.0);
            // Beyond the border there is no S.
            if (all(p >= vec2(0)) && all(p < b.size)) {
                let source = grid.first_pixel + u32(p.y) * grid.size.x + u32(p.x);
                d = vec3(
                    derivatives[(3u * c) * params.pixel_total + source],
                    derivatives[(3u * c + 1u) * params.pixel_total + source],
                    derivatives[(3u * c + 2u) * params.pixel_total + source],
                );
            }
            wide[i] = d.x;
            wide[i + WIDE * WIDE] = d.y;
            wide[i + 2u * WIDE * WIDE] = d.z;
        }
        workgroupBarrier();
        for (var i = thread; i < WIDE * BLOCK; i += 256u) {
            let source = (i / BLOCK) * WIDE + i % BLOCK;
            var d = vec3(0.0);
            for (var k = 0u; k < 2u * RADIUS + 1u; k++) {
                let w = window(u32(abs(i32(k) - i32(RADIUS))));
                d += w * vec3(wide[source + k], wide[source + k + WIDE * WIDE], wide[source + k + 2u * WIDE * WIDE]);
            }
            across[i] = d.x;
            across[i + WIDE * BLOCK] = d.y;
            across[i + 2u * WIDE * BLOCK] = d.z;
        }
        workgroupBarrier();
        if (inside) {
            var d = vec3(0.0);
            for (var k = 0u; k < 2u * RADIUS + 1u; k++) {
                let w = window(u32(abs(i32(k) - i32(RADIUS))));
                let i = (u32(own.y) + k) * BLOCK + u32(own.x);
                d += w * vec3(across[i], across[i + WIDE * BLOCK], across[i + 2u * WIDE * BLOCK]);
            }
            let x = image[grid.first_pixel + at][c];
            let y = goal[grid.target_at + c * pixels + at];
            let s = d.x + 2.0 * x * d.y + y * d.z;
            let value = grid.scale * ((1.0 - params.ssim_weight) * sign(x - y) - params.ssim_weight * s);
            if (c == 0u) { g.x = value; } else if (c == 1u) { g.y = value; } else { g.z = value; }
        }
        workgroupBarrier();
    }
    var depth_loss = 0.0;
    if (inside) {
        if (grid.depth_scale > 0.0) {
            let confidence = goal[grid.depth_at + pixels + at];
            let d = image[grid.first_pixel + at].w - goal[grid.depth_at + at];
            g.w = grid.depth_scale * confidence * sign(d);
            depth_loss = confidence * abs(d);
        }
        gradient[grid.first_pixel + at] = g;
    }
    if (grid.depth_scale > 0.0) {
        reduce[thread] = depth_loss;
        workgroupBarrier();
        for (var step = 128u; step > 0u; step >>= 1u) {
            if (thread < step) { reduce[thread] += reduce[thread + step]; }
            workgroupBarrier();
        }
        if (thread == 0u) { block_losses[index].z = reduce[0]; }
    }
}
