@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> state: array<u32>;
@group(0) @binding(2) var<storage, read> order: array<u32>;
@group(0) @binding(3) var<storage, read> offsets: array<u32>;
@group(0) @binding(4) var<storage, read> tile_counts: array<vec2<u32>>;
@group(0) @binding(5) var<storage, read> records: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read> splats: array<Splat>;
@group(0) @binding(7) var<storage, read_write> core: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> core_m: array<vec4<f32>>;
@group(0) @binding(9) var<storage, read_write> core_v: array<vec4<f32>>;
@group(0) @binding(10) var<storage, read_write> position_rates: array<f32>;
@group(0) @binding(11) var<storage, read_write> sh_0: array<vec4<f32>>;
@group(0) @binding(12) var<storage, read_write> sh_0_m: array<vec4<f32>>;
@group(0) @binding(13) var<storage, read_write> sh_0_v: array<vec4<f32>>;
@group(0) @binding(14) var<storage, read_write> sh_1: array<vec4<f32>>;
@group(0) @binding(15) var<storage, read_write> sh_1_m: array<vec4<f32>>;
@group(0) @binding(16) var<storage, read_write> sh_1_v: array<vec4<f32>>;

// Sum of a Gaussian's records in one image: dL/dcolour, dL/d(1/z); dL/d(oρ), Σ dL/dσ (dx², dx dy, dy²); Σ dL/dσ (dx, dy).
// Where both images share their pairs, a record of both (`backward_fused.wgsl`).
struct Found { a: vec4<f32>, b: vec4<f32>, c: vec4<f32>, d: vec4<f32> }

fn sum_of(first: u32, count: u32, stride: u32) -> Found {
    var f = Found(vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0));
    let words = 3u + params.fused;
    for (var k = 0u; k < count; k += stride) {
        let at = words * (first + k);
        f.a += records[at];
        f.b += records[at + 1u];
        f.c += records[at + 2u];
        if (words == 4u) { f.d += records[at + 3u]; }
    }
    return f;
}

// A Gaussian with more records than this is summed by the whole workgroup.
const LONG = 32u;
var<workgroup> long_count: atomic<u32>;
var<workgroup> long_total: u32;
var<workgroup> long_first: array<u32, 128>;
var<workgroup> long_length: array<u32, 128>;
var<workgroup> partial: array<Found, 64>;

// m and v after this gradient, and the step in units of the rate.
fn adam(g: vec4<f32>, m: ptr<function, vec4<f32>>, v: ptr<function, vec4<f32>>) -> vec4<f32> {
    *m = params.beta1 * *m + (1.0 - params.beta1) * g;
    *v = params.beta2 * *v + (1.0 - params.beta2) * g * g;
    return *m / (sqrt(*v) + params.epsilon);
}

// One word of four of the geometry and opacities; only lanes of `mask` are written.
fn step_core(at: u32, g: vec4<f32>, rates: vec4<f32>, mask: vec4<bool>, lowest: vec4<f32>) {
    if (WRITE_GRADIENTS) {
        core_m[at] = g;
        return;
    }
    let old = core[at];
    let old_m = core_m[at];
    let old_v = core_v[at];
    var m = old_m;
    var v = old_v;
    let step = adam(g, &m, &v);
    core[at] = select(old, max(old - rates * step, lowest), mask);
    core_m[at] = select(old_m, m, mask);
    core_v[at] = select(old_v, v, mask);
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let group = group_number(id);
    let visible = state[VISIBLE];
    // A frame that had no room for its pairs changes nothing; neither does any after it.
    if (state[FAILED] != 0u || group * 64u >= max(visible, 1u)) { return; }
    if (group == 0u && thread == 0u) { state[STEPS] += 1u; }
    let at = group * 64u + thread;
    let alive = at < visible;
    var i = 0u;
    var counts = vec2(0u);
    var first = vec2(0u);
    if (alive) {
        i = order[at];
        counts = tile_counts[i];
        first = vec2(offsets[at], offsets[at] + counts.x);
    }

    // Gather.
    if (thread == 0u) { atomicStore(&long_count, 0u); }
    workgroupBarrier();
    var found_0 = Found(vec4(0.0), vec4(0.0), vec4(0.0), vec4(0.0));
    var found_1 = found_0;
    var long_0 = 0xffffffffu;
    var long_1 = 0xffffffffu;
    if (counts.x > LONG) {
        long_0 = atomicAdd(&long_count, 1u);
        long_first[long_0] = first.x;
        long_length[long_0] = counts.x;
    } else {
        found_0 = sum_of(first.x, counts.x, 1u);
    }
    if (counts.y > LONG) {
        long_1 = atomicAdd(&long_count, 1u);
        long_first[long_1] = first.y;
        long_length[long_1] = counts.y;
    } else {
        found_1 = sum_of(first.y, counts.y, 1u);
    }
    workgroupBarrier();
    if (thread == 0u) { long_total = atomicLoad(&long_count); }
    let long_ones = workgroupUniformLoad(&long_total);
    for (var k = 0u; k < long_ones; k++) {
        let length = long_length[k];
        var rest = 0u;
        if (length > thread) { rest = length - thread; }
        partial[thread] = sum_of(long_first[k] + thread, rest, 64u);
        workgroupBarrier();
        for (var step = 32u; step > 0u; step >>= 1u) {
            if (thread < step) {
                partial[thread].a += partial[thread + step].a;
                partial[thread].b += partial[thread + step].b;
                partial[thread].c += partial[thread + step].c;
                partial[thread].d += partial[thread + step].d;
            }
            workgroupBarrier();
        }
        if (k == long_0) { found_0 = partial[0]; }
        if (k == long_1) { found_1 = partial[0]; }
        workgroupBarrier();
    }
    if (!alive) { return; }
    var seen = counts > vec2(0u);
    if (params.fused != 0u) {
        let both = found_0;
        // The pairs are those of the more opaque one; the other is seen if it can be drawn at all.
        let opacity = vec2(splats[i].place.z, splats[params.gaussians + i].place.z);
        seen = (opacity >= vec2(MIN_ALPHA)) & vec2(counts.x > 0u);
        // What the images say about the ellipse goes through one of them, once.
        let of_light = f32(seen.x);
        found_0 = Found(both.a, vec4(both.b.w, both.c.yzw), both.d, vec4(0.0));
        let shape = vec4(both.c.x, both.c.yzw * (1.0 - of_light));
        found_1 = Found(vec4(both.b.rgb, 0.0), shape, both.d * (1.0 - of_light), vec4(0.0));
    }

    // Through the projection.
    let c0 = core[3u * i];
    let c1 = core[3u * i + 1u];
    let c2 = core[3u * i + 2u];
    let mean = c0.xyz;
    let p = to_camera(mean);
    let s = shape_of(vec4(c0.w, c1.xyz), vec3(c1.w, c2.xy));
    let d = direction_of(mean);
    let y = basis_of(d.xyz);
    var dp = vec3(0.0);
    var dv = Symmetric(vec3(0.0), vec3(0.0));
    var d_direction = vec3(0.0);
    var d_logit = vec2(0.0);
    if (seen.x) {
        d_logit.x = through(0u, p, s, c2.z, found_0, &dp, &dv);
        // The clamp at 0 passes no gradient.
        let color = splats[i].color.rgb;
        d_direction += step_sh_0(i, y, d.xyz, select(vec3(0.0), found_0.a.rgb, color > vec3(0.0)));
    }
    if (seen.y) {
        d_logit.y = through(1u, p, s, c2.w, found_1, &dp, &dv);
        let color = splats[params.gaussians + i].color.rgb;
        d_direction += step_sh_1(i, y, d.xyz, select(vec3(0.0), found_1.a.rgb, color > vec3(0.0)));
    }
    let d_shape = shape_backward(s, dv);
    // dL/dμ = Wᵀ dL/dp, and the way through the viewing direction: dd/dμ = (I − d dᵀ) / distance.
    let r0 = params.camera_from_world[0].xyz;
    let r1 = params.camera_from_world[1].xyz;
    let r2 = params.camera_from_world[2].xyz;
    let d_mean = r0 * dp.x + r1 * dp.y + r2 * dp.z + (d_direction - d.xyz * dot(d.xyz, d_direction)) * d.w;

    let geometry = params.train_geometry != 0u;
    var rate = position_rates[i];
    if (geometry && !WRITE_GRADIENTS) { position_rates[i] = max(rate * (1.0 - params.position_decay), params.position_floor); }
    rate *= params.position_rate;
    let q = params.rotation_rate;
    let l = params.log_scale_rate;
    let free = vec4(-3e38);
    step_core(3u * i, vec4(d_mean, d_shape.rotation.x), vec4(vec3(rate), q), vec4(geometry), free);
    step_core(3u * i + 1u, vec4(d_shape.rotation.yzw, d_shape.log_scale.x), vec4(vec3(q), l), vec4(geometry), free);
    step_core(
        3u * i + 2u,
        vec4(d_shape.log_scale.yz, d_logit),
        vec4(l, l, params.rates[0].opacity, params.rates[1].opacity),
        vec4(geometry, geometry, seen),
        vec4(free.xy, params.rates[0].lowest_logit, params.rates[1].lowest_logit),
    );
}

// Adds what one image says to dL/dp and dL/dV; returns dL/d(opacity logit).
fn through(
    g: u32, p: vec3<f32>, s: Shape, logit: f32, f: Found, dp: ptr<function, vec3<f32>>, dv: ptr<function, Symmetric>,
) -> f32 {
    let grid = params.grids[g];
    let e = ellipse_of(grid, p, s.covariance);
    let opacity = 1.0 / (1.0 + exp(-logit));
    let gradient = EllipseGradient(f.b.yzw, f.c.xy, f.a.w, f.b.x * opacity);
    ellipse_backward(grid, e, gradient, dp, dv);
    return f.b.x * e.rho * opacity * (1.0 - opacity);
}
