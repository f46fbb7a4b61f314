// From a Gaussian in the world to an ellipse in an image, and the way back for gradients.
const MIN_DETERMINANT_RATIO = 2.5e-5;

// p = R μ + t.
fn to_camera(mean: vec3<f32>) -> vec3<f32> {
    let m = vec4(mean, 1.0);
    return vec3(dot(params.camera_from_world[0], m), dot(params.camera_from_world[1], m), dot(params.camera_from_world[2], m));
}

// Symmetric matrices: xx, xy, xz and yy, yz, zz.
struct Symmetric { a: vec3<f32>, b: vec3<f32> }

fn times(s: Symmetric, v: vec3<f32>) -> vec3<f32> {
    return vec3(dot(s.a, v), dot(vec3(s.a.y, s.b.x, s.b.y), v), dot(vec3(s.a.z, s.b.y, s.b.z), v));
}

// Shape in camera axes: V = A diag(s²) Aᵀ with A = R_camera_from_world · R(q).
struct Shape {
    q: vec4<f32>,         // unit, w x y z
    inverse_norm: f32,
    axes: array<vec3<f32>, 3>,  // columns of A
    variance: vec3<f32>,
    covariance: Symmetric,
}

fn shape_of(stored: vec4<f32>, log_scale: vec3<f32>) -> Shape {
    var s: Shape;
    s.inverse_norm = 1.0 / sqrt(max(dot(stored, stored), 1e-30));
    s.q = stored * s.inverse_norm;
    let w = s.q.x; let x = s.q.y; let y = s.q.z; let z = s.q.w;
    let r0 = params.camera_from_world[0].xyz;
    let r1 = params.camera_from_world[1].xyz;
    let r2 = params.camera_from_world[2].xyz;
    let c0 = vec3(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y));
    let c1 = vec3(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x));
    let c2 = vec3(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
    s.axes[0] = vec3(dot(r0, c0), dot(r1, c0), dot(r2, c0));
    s.axes[1] = vec3(dot(r0, c1), dot(r1, c1), dot(r2, c1));
    s.axes[2] = vec3(dot(r0, c2), dot(r1, c2), dot(r2, c2));
    s.variance = exp(2.0 * log_scale);
    let a = vec3(s.axes[0].x, s.axes[1].x, s.axes[2].x);
    let b = vec3(s.axes[0].y, s.axes[1].y, s.axes[2].y);
    let c = vec3(s.axes[0].z, s.axes[1].z, s.axes[2].z);
    let av = a * s.variance;
    let bv = b * s.variance;
    s.covariance.a = vec3(dot(av, a), dot(av, b), dot(av, c));
    s.covariance.b = vec3(dot(bv, b), dot(bv, c), dot(c * s.variance, c));
    return s;
}

// A Gaussian's ellipse in one image.
struct Ellipse {
    mean: vec2<f32>,
    inverse_z: f32,
    slope: vec2<f32>,     // x/z, y/z
    held: vec2<f32>,      // the same inside their limits, as used in J
    free: vec2<f32>,      // 1 where they were free to move
    j: vec4<f32>,         // j00, j02, j11, j12
    v0: vec3<f32>,        // V j₀ᵀ
    v1: vec3<f32>,        // V j₁ᵀ
    bare: vec3<f32>,      // S₂: xx, xy, yy
    s: vec2<f32>,         // S: xx, yy
    determinant: f32,
    ratio: f32,           // det S₂ / det S, bounded below
    ratio_free: f32,
    rho: f32,
}

fn ellipse_of(grid: Grid, p: vec3<f32>, covariance: Symmetric) -> Ellipse {
    var e: Ellipse;
    e.inverse_z = 1.0 / p.z;
    e.slope = p.xy * e.inverse_z;
    let low = vec2(grid.x_limits.x, grid.y_limits.x);
    let high = vec2(grid.x_limits.y, grid.y_limits.y);
    e.held = clamp(e.slope, low, high);
    e.free = select(vec2(0.0), vec2(1.0), (e.slope >= low) & (e.slope <= high));
    e.mean = fma(grid.focal, e.slope, grid.centre);
    let j0 = grid.focal * e.inverse_z;
    let j2 = -j0 * e.held;
    e.j = vec4(j0.x, j2.x, j0.y, j2.y);
    let a = covariance.a;
    let b = covariance.b;
    e.v0 = vec3(a.x, a.y, a.z) * e.j.x + vec3(a.z, b.y, b.z) * e.j.y;
    e.v1 = vec3(a.y, b.x, b.y) * e.j.z + vec3(a.z, b.y, b.z) * e.j.w;
    e.bare = vec3(
        e.j.x * e.v0.x + e.j.y * e.v0.z,
        e.j.z * e.v0.y + e.j.w * e.v0.z,
        e.j.z * e.v1.y + e.j.w * e.v1.z,
    );
    e.s = e.bare.xz + DILATION;
    e.determinant = e.s.x * e.s.y - e.bare.y * e.bare.y;
    let raw = (e.bare.x * e.bare.z - e.bare.y * e.bare.y) / e.determinant;
    e.ratio = max(raw, MIN_DETERMINANT_RATIO);
    e.ratio_free = select(0.0, 1.0, raw > MIN_DETERMINANT_RATIO);
    e.rho = 1.0;
    if (ANTIALIAS != ANTIALIAS_OFF) { e.rho = sqrt(e.ratio); }
    return e;
}

// Q = S⁻¹: xx, xy, yy.
fn conic_of(e: Ellipse) -> vec3<f32> {
    let inverse = 1.0 / e.determinant;
    return vec3(e.s.y * inverse, -e.bare.y * inverse, e.s.x * inverse);
}

// What a modality's image says about a Gaussian: Σ dL/dσ (dx², dx dy, dy²), Σ dL/dσ (dx, dy), dL/d(1/z), dL/dρ.
struct EllipseGradient { moments: vec3<f32>, first: vec2<f32>, inverse_z: f32, rho: f32 }

// Adds to dL/dp (camera axes) and dL/dV (full-matrix convention).
fn ellipse_backward(grid: Grid, e: Ellipse, g: EllipseGradient, dp: ptr<function, vec3<f32>>, dv: ptr<function, Symmetric>) {
    let inverse = 1.0 / e.determinant;
    let b = e.bare.y;
    let q = vec3(e.s.y * inverse, -b * inverse, e.s.x * inverse);
    let d_mean = vec2(q.x * g.first.x + q.y * g.first.y, q.y * g.first.x + q.z * g.first.y);
    // dS = −Q dQ Q with dQ = ½ Σ dL/dσ d dᵀ.
    let m = g.moments;
    let r0 = vec2(q.x * m.x + q.y * m.y, q.x * m.y + q.y * m.z);
    let r1 = vec2(q.y * m.x + q.z * m.y, q.y * m.y + q.z * m.z);
    var s00 = -0.5 * (r0.x * q.x + r0.y * q.y);
    var s01 = -0.5 * (r0.x * q.y + r0.y * q.z);
    var s11 = -0.5 * (r1.x * q.y + r1.y * q.z);
    if (ANTIALIAS == ANTIALIAS_ON) {
        // ∂ρ/∂a = (c − (D₀/D₁) C)/(2ρ D₁); b and c likewise. Full-matrix: half of ∂ρ/∂b off the diagonal.
        let k = g.rho * e.ratio_free * inverse * 0.5 / e.rho;
        s00 += k * (e.bare.z - e.ratio * e.s.y);
        s11 += k * (e.bare.x - e.ratio * e.s.x);
        s01 -= k * b * (1.0 - e.ratio);
    }
    let j00 = e.j.x; let j02 = e.j.y; let j11 = e.j.z; let j12 = e.j.w;
    // dV += Jᵀ dS J.
    (*dv).a += vec3(s00 * j00 * j00, s01 * j00 * j11, j00 * (s00 * j02 + s01 * j12));
    (*dv).b += vec3(
        s11 * j11 * j11,
        j11 * (s01 * j02 + s11 * j12),
        s00 * j02 * j02 + 2.0 * s01 * j02 * j12 + s11 * j12 * j12,
    );
    // dJ = 2 dS J V, only the entries that exist.
    let dj00 = 2.0 * (s00 * e.v0.x + s01 * e.v1.x);
    let dj02 = 2.0 * (s00 * e.v0.z + s01 * e.v1.z);
    let dj11 = 2.0 * (s01 * e.v0.y + s11 * e.v1.y);
    let dj12 = 2.0 * (s01 * e.v0.z + s11 * e.v1.z);
    let f = grid.focal;
    let iz = e.inverse_z;
    let iz2 = iz * iz;
    *dp += vec3(
        d_mean.x * f.x * iz - dj02 * f.x * iz2 * e.free.x,
        d_mean.y * f.y * iz - dj12 * f.y * iz2 * e.free.y,
        -d_mean.x * f.x * e.slope.x * iz - d_mean.y * f.y * e.slope.y * iz - (dj00 * f.x + dj11 * f.y) * iz2
            + dj02 * f.x * e.held.x * iz2 * (1.0 + e.free.x) + dj12 * f.y * e.held.y * iz2 * (1.0 + e.free.y)
            - g.inverse_z * iz2,
    );
}

// dL/d(quaternion as stored) and dL/d(ln scale) from dL/dV.
struct ShapeGradient { rotation: vec4<f32>, log_scale: vec3<f32> }

fn shape_backward(s: Shape, dv: Symmetric) -> ShapeGradient {
    var out: ShapeGradient;
    // Columns of dR: d(column k of A) = 2 dV a_k s_k², d(column k of R) = Wᵀ of it.
    let r0 = params.camera_from_world[0].xyz;
    let r1 = params.camera_from_world[1].xyz;
    let r2 = params.camera_from_world[2].xyz;
    let g0 = times(dv, s.axes[0]);
    let g1 = times(dv, s.axes[1]);
    let g2 = times(dv, s.axes[2]);
    let doubled = 2.0 * s.variance;
    out.log_scale = doubled * vec3(dot(s.axes[0], g0), dot(s.axes[1], g1), dot(s.axes[2], g2));
    let c0 = doubled.x * (r0 * g0.x + r1 * g0.y + r2 * g0.z);
    let c1 = doubled.y * (r0 * g1.x + r1 * g1.y + r2 * g1.z);
    let c2 = doubled.z * (r0 * g2.x + r1 * g2.y + r2 * g2.z);
    let w = s.q.x; let x = s.q.y; let y = s.q.z; let z = s.q.w;
    let dq = 2.0 * vec4(
        x * (c1.z - c2.y) + y * (c2.x - c0.z) + z * (c0.y - c1.x),
        y * (c1.x + c0.y) + z * (c2.x + c0.z) + w * (c1.z - c2.y) - 2.0 * x * (c1.y + c2.z),
        x * (c1.x + c0.y) + z * (c2.y + c1.z) + w * (c2.x - c0.z) - 2.0 * y * (c0.x + c2.z),
        x * (c2.x + c0.z) + y * (c2.y + c1.z) + w * (c0.y - c1.x) - 2.0 * z * (c0.x + c1.y),
    );
    // q̂ = q/|q|: the part along q̂ does not count.
    out.rotation = (dq - s.q * dot(s.q, dq)) * s.inverse_norm;
    return out;
}

// The unit vector from the camera to a Gaussian, and 1 / distance.
fn direction_of(mean: vec3<f32>) -> vec4<f32> {
    let d = mean - params.eye.xyz;
    let inverse = 1.0 / max(sqrt(dot(d, d)), 1e-12);
    return vec4(d * inverse, inverse);
}
