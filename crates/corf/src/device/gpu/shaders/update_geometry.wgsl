// cpu/update.rs: Adam's step of geometry and opacities.
@group(0) @binding(0) var<uniform> params: Params;
@group(0) @binding(1) var<storage, read_write> state: array<u32>;
@group(0) @binding(2) var<storage, read> gaussian_of: array<u32>;
@group(0) @binding(3) var<storage, read> ellipse_sums: array<EllipseSum>;
@group(0) @binding(4) var<storage, read> directions: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read_write> core: array<vec4<f32>>;
@group(0) @binding(6) var<storage, read_write> core_m: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> core_v: array<vec4<f32>>;
@group(0) @binding(8) var<storage, read_write> position_rates: array<f32>;
MARKS

// One word of four of the geometry and opacities, with Adam's moments.
struct Held { value: vec4<f32>, m: vec4<f32>, v: vec4<f32> }

fn load(at: u32) -> Held { return Held(core[at], core_m[at], core_v[at]); }

// Its step; only lanes of `mask` are written.
fn step_core(at: u32, old: Held, g: vec4<f32>, rates: vec4<f32>, mask: vec4<bool>) {
    if (WRITE_GRADIENTS) {
        core_m[at] = g;
        return;
    }
    var m = old.m;
    var v = old.v;
    let step = adam(g, &m, &v);
    core[at] = select(old.value, old.value - rates * step, mask);
    core_m[at] = select(old.m, m, mask);
    core_v[at] = select(old.v, v, mask);
}

// The step of a visible Gaussian's geometry and opacities.
@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    // A frame that had no room for its pairs changes nothing; neither does any after it.
    if (state[FAILED] != 0u) { return; }
    let at = group_number(id) * 64u + thread;
    if (at == 0u) { state[STEPS] += 1u; }
    if (at >= state[VISIBLE]) { return; }
    let i = gaussian_of[at];

    // All that is read is on its way before any of it is used.
    let held_0 = load(3u * i);
    let held_1 = load(3u * i + 1u);
    let held_2 = load(3u * i + 2u);
    let d_direction = directions[at].xyz;
    let sum_0 = ellipse_sums[2u * at];
    let sum_1 = ellipse_sums[2u * at + 1u];
    var rate = position_rates[i];

    // Through the projection.
    let c0 = held_0.value;
    let c1 = held_1.value;
    let c2 = held_2.value;
    let mean = c0.xyz;
    let p = to_camera(mean);
    let s = shape_of(vec4(c0.w, c1.xyz), vec3(c1.w, c2.xy));
    let d = direction_of(mean);
    var of_shape: ShapeGradient;
    let seen = vec2(sum_0.seen, sum_1.seen) > vec2(0.0);
    var d_logit = vec2(0.0);
    if (seen.x) {
        d_logit.x = through(0u, p, s, c2.z, sum_0, &of_shape);
    }
    if (seen.y) {
        d_logit.y = through(1u, p, s, c2.w, sum_1, &of_shape);
    }
    NOTE
    let d_shape = shape_backward(s, of_shape);
    let dp = of_shape.p;
    // dL/dμ = Wᵀ dL/dp, and the way through the viewing direction: dd/dμ = (I − d dᵀ) / distance.
    let r0 = params.camera_from_world[0].xyz;
    let r1 = params.camera_from_world[1].xyz;
    let r2 = params.camera_from_world[2].xyz;
    let d_mean = r0 * dp.x + r1 * dp.y + r2 * dp.z + (d_direction - d.xyz * dot(d.xyz, d_direction)) * d.w;

    let geometry = params.train_geometry != 0u;
    if (geometry && !WRITE_GRADIENTS) { position_rates[i] = rate * (1.0 - params.position_decay); }
    rate *= params.position_rate;
    let q = params.rotation_rate;
    let l = params.log_scale_rate;
    step_core(3u * i, held_0, vec4(d_mean, d_shape.rotation.x), vec4(vec3(rate), q), vec4(geometry));
    step_core(3u * i + 1u, held_1, vec4(d_shape.rotation.yzw, d_shape.log_scale.x), vec4(vec3(q), l), vec4(geometry));
    step_core(
        3u * i + 2u,
        held_2,
        vec4(d_shape.log_scale.yz, d_logit),
        vec4(l, l, params.rates[0].opacity, params.rates[1].opacity),
        vec4(geometry, geometry, seen),
    );
}

// Adds what one image says; returns dL/d(opacity logit).
fn through(g: u32, p: vec3<f32>, s: Shape, logit: f32, sum: EllipseSum, d: ptr<function, ShapeGradient>) -> f32 {
    let grid = params.grids[g];
    let e = ellipse_of(grid, p, s);
    let opacity = 1.0 / (1.0 + exp(-logit));
    let gradient = EllipseGradient(sum.moments, sum.first, sum.inverse_z, sum.opacity * opacity);
    ellipse_backward(grid, s, e, gradient, d);
    return sum.opacity * e.rho * opacity * (1.0 - opacity);
}
