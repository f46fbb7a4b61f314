// From a Gaussian in the world to an ellipse in an image, and the way back for gradients.
const MIN_DETERMINANT_RATIO = 2.5e-5;

// p = R μ + t.
fn to_camera(mean: vec3<f32>) -> vec3<f32> {
    let m = vec4(mean, 1.0);
    return vec3(dot(params.camera_from_world[0], m), dot(params.camera_from_world[1], m), dot(params.camera_from_world[2], m));
}

// Symmetric matrices: xx, xy, xz and yy, yz, zz.
struct Symmetric { a: vec3<f32>, b: vec3<f32> }

fn symmetric_times(s: Symmetric, v: vec3<f32>) -> vec3<f32> {
    return vec3(dot(s.a, v), dot(vec3(s.a.y, s.b.x, s.b.y), v), dot(vec3(s.a.z, s.b.y, s.b.z), v));
}

// Shape in camera axes: V = A diag(s²) Aᵀ with A = R_camera_from_world · R(q). It is never multiplied out: of a needle the small variances would be
// lost in the rounding of the large one.
struct Shape {
    q: vec4<f32>,         // unit, w x y z
    inverse_norm: f32,
    axes: array<vec3<f32>, 3>,  // columns of A
    variance: vec3<f32>,
    of_pairs: vec3<f32>,  // products of the two other variances: V's adjugate is A diag(of_pairs) Aᵀ
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
    s.of_pairs = s.variance.yzx * s.variance.zxy;
    return s;
}

// A v and Aᵀ v.
fn from_axes(s: Shape, v: vec3<f32>) -> vec3<f32> { return s.axes[0] * v.x + s.axes[1] * v.y + s.axes[2] * v.z; }

fn along_axes(s: Shape, v: vec3<f32>) -> vec3<f32> { return vec3(dot(s.axes[0], v), dot(s.axes[1], v), dot(s.axes[2], v)); }

// A Gaussian's ellipse in one image.
struct Ellipse {
    mean: vec2<f32>,
    inverse_z: f32,
    slope: vec2<f32>,     // x/z, y/z
    held: vec2<f32>,      // the same inside their limits, as used in J
    free: vec2<f32>,      // 1 where they were free to move
    j: vec4<f32>,         // j00, j02, j11, j12
    along0: vec3<f32>,    // Aᵀ j₀ᵀ
    along1: vec3<f32>,    // Aᵀ j₁ᵀ
    cross: vec3<f32>,     // j₀ × j₁
    cross_along: vec3<f32>,
    bare: vec3<f32>,      // S₂: xx, xy, yy
    s: vec2<f32>,         // S: xx, yy
    bare_determinant: f32,
    determinant: f32,
    ratio_free: f32,      // 1 where det S₂ / det S is not at its lower bound
    rho: f32,
}

fn ellipse_of(grid: GridParams, p: vec3<f32>, shape: Shape) -> Ellipse {
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
    e.along0 = along_axes(shape, vec3(e.j.x, 0.0, e.j.y));
    e.along1 = along_axes(shape, vec3(0.0, e.j.z, e.j.w));
    let v0 = shape.variance * e.along0;
    e.bare = vec3(dot(v0, e.along0), dot(v0, e.along1), dot(shape.variance * e.along1, e.along1));
    // det S₂ = S₂_xx S₂_yy − S₂_xy² cancels where an ellipse is thin. It is the sum of the squares of the minors of J A diag(s) (Cauchy and Binet),
    // which is (j₀ × j₁)ᵀ adj(V) (j₀ × j₁).
    e.cross = vec3(-(e.j.y * e.j.z), -(e.j.x * e.j.w), e.j.x * e.j.z);
    e.cross_along = along_axes(shape, e.cross);
    e.bare_determinant = dot(shape.of_pairs * e.cross_along, e.cross_along);
    e.s = e.bare.xz + DILATION;
    e.determinant = fma(DILATION, e.bare.x + e.s.y, e.bare_determinant);
    let raw = e.bare_determinant / e.determinant;
    let ratio = max(raw, MIN_DETERMINANT_RATIO);
    e.ratio_free = select(0.0, 1.0, raw > MIN_DETERMINANT_RATIO);
    e.rho = 1.0;
    if (ANTIALIAS != ANTIALIAS_OFF) { e.rho = sqrt(ratio); }
    return e;
}

// Q = S⁻¹: xx, xy, yy.
fn conic_of(e: Ellipse) -> vec3<f32> {
    let inverse = 1.0 / e.determinant;
    return vec3(e.s.y * inverse, -e.bare.y * inverse, e.s.x * inverse);
}

// What a modality's image says about a Gaussian: Σ dL/dσ (dx², dx dy, dy²), Σ dL/dσ (dx, dy), dL/d(1/z), dL/dρ.
struct EllipseGradient { moments: vec3<f32>, first: vec2<f32>, inverse_z: f32, rho: f32 }

// dL/dp (camera axes), dL/dV and dL/d(adj V) (full-matrix convention).
struct ShapeGradient { p: vec3<f32>, covariance: Symmetric, adjugate: Symmetric }

// dL/d(projected mean), pixels: what blending says about where a Gaussian lies in the image.
fn mean_backward(e: Ellipse, g: EllipseGradient) -> vec2<f32> {
    let q = vec3(e.s.y, -e.bare.y, e.s.x) * (1.0 / e.determinant);
    return vec2(q.x * g.first.x + q.y * g.first.y, q.y * g.first.x + q.z * g.first.y);
}

// Adds what one image says.
fn ellipse_backward(grid: GridParams, s: Shape, e: Ellipse, g: EllipseGradient, d: ptr<function, ShapeGradient>) {
    let inverse = 1.0 / e.determinant;
    let b = e.bare.y;
    let q = vec3(e.s.y * inverse, -b * inverse, e.s.x * inverse);
    let d_mean = mean_backward(e, g);
    // dS = −Q dQ Q with dQ = ½ Σ dL/dσ d dᵀ.
    let m = g.moments;
    let r0 = vec2(q.x * m.x + q.y * m.y, q.x * m.y + q.y * m.z);
    let r1 = vec2(q.y * m.x + q.z * m.y, q.y * m.y + q.z * m.z);
    var s00 = -0.5 * (r0.x * q.x + r0.y * q.y);
    let s01 = -0.5 * (r0.x * q.y + r0.y * q.z);
    var s11 = -0.5 * (r1.x * q.y + r1.y * q.z);
    var d_cross = vec3(0.0);
    if (ANTIALIAS == ANTIALIAS_ON) {
        // ρ² = D₀/D₁ with D₁ = D₀ + h (tr S₂ + h): ∂ρ/∂D₀ = h (tr S₂ + h)/(2ρ D₁²), ∂ρ/∂tr = −h D₀/(2ρ D₁²).
        let k = g.rho * e.ratio_free * 0.5 * DILATION * inverse / e.rho;
        let by_trace = k * e.bare_determinant * inverse;
        s00 -= by_trace;
        s11 -= by_trace;
        // D₀ = nᵀ adj(V) n, n = j₀ × j₁.
        let by_bare = k * (e.bare.x + e.s.y) * inverse;
        (*d).adjugate.a += by_bare * (e.cross.x * e.cross);
        (*d).adjugate.b += by_bare * (e.cross.yyz * e.cross.yzz);
        d_cross = 2.0 * by_bare * from_axes(s, s.of_pairs * e.cross_along);
    }
    let j00 = e.j.x; let j02 = e.j.y; let j11 = e.j.z; let j12 = e.j.w;
    // dV = Jᵀ dS J.
    (*d).covariance.a += vec3(s00 * j00 * j00, s01 * j00 * j11, j00 * (s00 * j02 + s01 * j12));
    (*d).covariance.b += vec3(
        s11 * j11 * j11,
        j11 * (s01 * j02 + s11 * j12),
        s00 * j02 * j02 + 2.0 * s01 * j02 * j12 + s11 * j12 * j12,
    );
    // dJ = 2 dS J V, only the entries that exist; and through n = (−j02 j11, −j00 j12, j00 j11).
    let v0 = from_axes(s, s.variance * e.along0);
    let v1 = from_axes(s, s.variance * e.along1);
    let dj00 = 2.0 * (s00 * v0.x + s01 * v1.x) + (d_cross.z * j11 - d_cross.y * j12);
    let dj02 = 2.0 * (s00 * v0.z + s01 * v1.z) - d_cross.x * j11;
    let dj11 = 2.0 * (s01 * v0.y + s11 * v1.y) + (d_cross.z * j00 - d_cross.x * j02);
    let dj12 = 2.0 * (s01 * v0.z + s11 * v1.z) - d_cross.y * j00;
    let f = grid.focal;
    let iz = e.inverse_z;
    let iz2 = iz * iz;
    (*d).p += vec3(
        d_mean.x * f.x * iz - dj02 * f.x * iz2 * e.free.x,
        d_mean.y * f.y * iz - dj12 * f.y * iz2 * e.free.y,
        -d_mean.x * f.x * e.slope.x * iz - d_mean.y * f.y * e.slope.y * iz - (dj00 * f.x + dj11 * f.y) * iz2
            + dj02 * f.x * e.held.x * iz2 * (1.0 + e.free.x) + dj12 * f.y * e.held.y * iz2 * (1.0 + e.free.y)
            - g.inverse_z * iz2,
    );
}

// dL/d(quaternion as stored) and dL/d(ln scale).
struct StoredShapeGradient { rotation: vec4<f32>, log_scale: vec3<f32> }

fn shape_backward(s: Shape, d: ShapeGradient) -> StoredShapeGradient {
    var out: StoredShapeGradient;
    // Columns of dR: d(column k of A) = 2 (dV s_k² + d(adj V) s_l² s_m²) a_k, d(column k of R) = Wᵀ of it.
    let r0 = params.camera_from_world[0].xyz;
    let r1 = params.camera_from_world[1].xyz;
    let r2 = params.camera_from_world[2].xyz;
    let v0 = 2.0 * s.variance.x * symmetric_times(d.covariance, s.axes[0]);
    let v1 = 2.0 * s.variance.y * symmetric_times(d.covariance, s.axes[1]);
    let v2 = 2.0 * s.variance.z * symmetric_times(d.covariance, s.axes[2]);
    let u0 = 2.0 * s.of_pairs.x * symmetric_times(d.adjugate, s.axes[0]);
    let u1 = 2.0 * s.of_pairs.y * symmetric_times(d.adjugate, s.axes[1]);
    let u2 = 2.0 * s.of_pairs.z * symmetric_times(d.adjugate, s.axes[2]);
    // A scale is in its own variance, and in the products that the other axes have.
    let by_pairs = vec3(dot(s.axes[0], u0), dot(s.axes[1], u1), dot(s.axes[2], u2));
    out.log_scale = vec3(dot(s.axes[0], v0), dot(s.axes[1], v1), dot(s.axes[2], v2)) + (by_pairs.yzx + by_pairs.zxy);
    let g0 = v0 + u0;
    let g1 = v1 + u1;
    let g2 = v2 + u2;
    let c0 = r0 * g0.x + r1 * g0.y + r2 * g0.z;
    let c1 = r0 * g1.x + r1 * g1.y + r2 * g1.z;
    let c2 = r0 * g2.x + r1 * g2.y + r2 * g2.z;
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
