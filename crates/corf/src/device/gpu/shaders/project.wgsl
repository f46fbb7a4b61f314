@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read> core: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> sh_0: array<vec4<f32>>;
@group(0) @binding(3) var<storage, read> sh_1: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read_write> tile_counts: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read_write> block_sums: array<vec2<u32>>;
@group(0) @binding(6) var<storage, read_write> splats: array<Splat>;

var<workgroup> seen: atomic<u32>;
var<workgroup> pairs: atomic<u32>;

// τ = ln(255·o·ρ) bounds σ; the margin covers the rounding of the logarithm and of σ itself.
const TAU_MARGIN = 1e-3;
// Widest σ at which opacity 1 still gives 1/255: sqrt(2 ln 255) standard deviations.
const MAX_DEVIATIONS = 3.33;

// A cheap, generous test against the borders of an image; the exact one follows.
fn may_be_seen(grid: Grid, p: vec3<f32>, largest: f32) -> bool {
    let inverse_z = 1.0 / p.z;
    let r = fma(grid.reach, vec2(largest * inverse_z), vec2(MAX_DEVIATIONS * sqrt(DILATION)));
    let mean = fma(grid.focal, p.xy * inverse_z, grid.centre);
    return all(mean + r > vec2(0.0)) && all(mean - r < vec2<f32>(grid.size));
}

fn project_to(g: u32, i: u32, p: vec3<f32>, s: Symmetric, logit: f32, direction: vec3<f32>) -> u32 {
    let grid = params.grids[g];
    let e = ellipse_of(grid, p, s);
    if (!(e.determinant > 0.0)) { return 0u; }
    let opacity = e.rho / (1.0 + exp(-logit));
    // Bound of σ: o ρ exp(−σ) ≥ 1/255.
    let tau = log(max(opacity * 255.0, 1e-30)) + TAU_MARGIN;
    let q = conic_of(e);
    let r = reach_of(grid.tiles, e.mean, q, tau);
    var count = 0u;
    for (var row = r.rows.x; row <= r.rows.y; row++) {
        let columns = columns_of(r, grid.tiles, row);
        count += u32(max(columns.y - columns.x + 1, 0));
    }
    if (count > 0u) {
        var color: vec3<f32>;
        if (g == 0u) { color = color_0(i, direction); } else { color = color_1(i, direction); }
        splats[g * params.gaussians + i] =
            Splat(vec4(e.mean, opacity, e.inverse_z), vec4(q, tau), vec4(color, p.z));
    }
    return count;
}

// Both images share the ellipse, and the pairs are those of the more opaque one.
fn project_both(i: u32, p: vec3<f32>, s: Symmetric, logits: vec2<f32>, direction: vec3<f32>) -> u32 {
    let grid = params.grids[0];
    let e = ellipse_of(grid, p, s);
    if (!(e.determinant > 0.0)) { return 0u; }
    let opacity = vec2(e.rho) / (1.0 + exp(-logits));
    let tau = log(max(max(opacity.x, opacity.y) * 255.0, 1e-30)) + TAU_MARGIN;
    let q = conic_of(e);
    let r = reach_of(grid.tiles, e.mean, q, tau);
    var count = 0u;
    for (var row = r.rows.x; row <= r.rows.y; row++) {
        let columns = columns_of(r, grid.tiles, row);
        count += u32(max(columns.y - columns.x + 1, 0));
    }
    if (count > 0u) {
        splats[i] = Splat(vec4(e.mean, opacity.x, e.inverse_z), vec4(q, tau), vec4(color_0(i, direction), p.z));
        splats[params.gaussians + i] =
            Splat(vec4(e.mean, opacity.y, e.inverse_z), vec4(q, tau), vec4(color_1(i, direction), p.z));
    }
    return count;
}

// Tiles that Gaussian i reaches in either image.
fn reached(i: u32) -> vec2<u32> {
    let first = core[3u * i];
    let mean = first.xyz;
    let p = to_camera(mean);
    if (!(p.z > params.eye.w && is_finite(p.z))) { return vec2(0u); }
    let second = core[3u * i + 1u];
    let third = core[3u * i + 2u];
    let log_scale = vec3(second.w, third.xy);
    let largest = exp(max(log_scale.x, max(log_scale.y, log_scale.z)));
    let wanted = vec2(
        params.grids[0].size.x > 0u && may_be_seen(params.grids[0], p, largest),
        params.grids[1].size.x > 0u && may_be_seen(params.grids[1], p, largest),
    );
    var counts = vec2(0u);
    if (any(wanted)) {
        let s = shape_of(vec4(first.w, second.xyz), log_scale);
        let direction = direction_of(mean).xyz;
        if (params.fused != 0u) {
            counts.x = project_both(i, p, s.covariance, third.zw, direction);
        } else {
            if (wanted.x) { counts.x = project_to(0u, i, p, s.covariance, third.z, direction); }
            if (wanted.y) { counts.y = project_to(1u, i, p, s.covariance, third.w, direction); }
        }
    }
    return counts;
}

@compute @workgroup_size(256)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let block = group_number(id);
    let i = block * 256u + thread;
    if (thread == 0u) {
        atomicStore(&seen, 0u);
        atomicStore(&pairs, 0u);
    }
    workgroupBarrier();
    if (i < params.gaussians) {
        let counts = reached(i);
        tile_counts[i] = counts;
        if (any(counts > vec2(0u))) {
            atomicAdd(&seen, 1u);
            atomicAdd(&pairs, counts.x + counts.y);
        }
    }
    workgroupBarrier();
    if (thread == 0u && block * 256u < max(params.gaussians, 1u)) {
        block_sums[block] = vec2(atomicLoad(&seen), atomicLoad(&pairs));
    }
}
