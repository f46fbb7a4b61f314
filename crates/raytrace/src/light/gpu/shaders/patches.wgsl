// emitter.rs and triangle.rs: emitting patches as points and tiles of lattices see them.

const NEAR = 4.0;

// ½ Σ θ Γ over the edges of a triangle clipped to the half-space n·x > 0; corners relative to the viewpoint.
fn polygon_vector(a: vec3<f32>, b: vec3<f32>, c: vec3<f32>, n: vec3<f32>) -> vec3<f32> {
    var corners = array<vec3<f32>, 3>(a, b, c);
    var polygon: array<vec3<f32>, 4>;
    var count = 0u;
    for (var k = 0u; k < 3u; k++) {
        let p = corners[k];
        let q = corners[(k + 1u) % 3u];
        let above_p = dot(p, n);
        let above_q = dot(q, n);
        if (above_p > 0.0) {
            polygon[count] = p;
            count += 1u;
        }
        if ((above_p > 0.0) != (above_q > 0.0)) {
            polygon[count] = p + (q - p) * (above_p / (above_p - above_q));
            count += 1u;
        }
    }
    var sum = vec3(0.0);
    for (var k = 0u; k < count; k++) {
        let p = polygon[k];
        let q = polygon[select(k + 1u, 0u, k + 1u == count)];
        let across = cross(p, q);
        let sine = length(across);
        if (sine > 0.0) { sum += across * (angle(sine, dot(p, q)) / sine); }
    }
    return sum * 0.5;
}

// ∫ l dω over the part of a patch above a plane through a point, unshadowed; zero behind patches of one side.
fn solid_angle_vector(i: u32, at: vec3<f32>, n: vec3<f32>) -> vec3<f32> {
    let e = emitters[i];
    let height = dot(e.normal, at - e.a);
    if (abs(height) < 1e-6 || (height < 0.0 && (e.kind & DOUBLE_SIDED) == 0u)) { return vec3(0.0); }
    let vector = polygon_vector(e.a - at, e.b - at, e.c - at, n);
    return select(vector, -vector, height > 0.0);
}

// Bound on a patch's contribution to the points of a box.
fn importance_in(i: u32, low: vec3<f32>, high: vec3<f32>) -> f32 {
    let e = emitters[i];
    let double_sided = (e.kind & DOUBLE_SIDED) != 0u;
    let centre = 0.5 * (low + high);
    let radius2 = 0.25 * dot(high - low, high - low);
    let middle = (e.a + e.b + e.c) / 3.0;
    let extent = high - centre;
    let height = dot(e.normal, centre - e.a);
    let reach = dot(abs(e.normal), extent) + 1e-3 * (1.0 + max3(extent));
    let above = height + reach;
    let below = reach - height;
    if (above <= 0.0 && !double_sided) { return 0.0; }
    let distance2 = max(dot(centre - middle, centre - middle), 0.25 * radius2 + 0.1 * e.area);
    let best = select(above, max(above, below), double_sided);
    let cosine = select(max(height, 0.0), abs(height), double_sided) / sqrt(distance2);
    let most = min(best / sqrt(distance2), 1.0);
    return e.luminance * e.area * clamp(cosine, 0.1 * most, 1.0) / distance2;
}

fn across_to(v: vec3<f32>, axis: vec3<f32>) -> vec3<f32> {
    return normalize_or(v - axis * dot(v, axis), vec3(0.0));
}

fn dihedral(p: vec3<f32>, q: vec3<f32>) -> f32 {
    return angle(length(cross(p, q)), dot(p, q));
}

// A direction drawn evenly over the triangle that three corners span as seen from the origin (Arvo 1995), and its solid angle
// (van Oosterom and Strackee 1983), 0 where it has none.
fn spherical_triangle(p: vec3<f32>, q: vec3<f32>, r: vec3<f32>, u: vec2<f32>) -> vec4<f32> {
    let a = normalize(p);
    let b = normalize(q);
    let c = normalize(r);
    let solid_angle = 2.0 * angle(abs(dot(a, cross(b, c))), 1.0 + dot(a, b) + dot(b, c) + dot(c, a));
    let alpha = dihedral(cross(a, b), -cross(c, a));
    let turn = cos_sin_turns(alpha / (2.0 * PI));
    if (!(solid_angle > 1e-7) || !(turn.y > 1e-6)) { return vec4(0.0); }
    let st = cos_sin_turns(fract((u.x * solid_angle - alpha) / (2.0 * PI)));
    let x = st.x - turn.x;
    let y = st.y + turn.y * dot(a, b);
    let cos_side = clamp(((y * st.x - x * st.y) * turn.x - y) / ((y * st.y + x * st.x) * turn.y), -1.0, 1.0);
    let c_part = a * cos_side + across_to(c, a) * sqrt(max(1.0 - cos_side * cos_side, 0.0));
    let z = 1.0 - u.y * (1.0 - dot(c_part, b));
    return vec4(normalize_or(b * z + across_to(c_part, b) * sqrt(max(1.0 - z * z, 0.0)), b), solid_angle);
}

// Point of a patch as seen from `at`: drawn over the solid angle of near patches, over the area of others.
fn patch_toward(i: u32, at: vec3<f32>, u: vec2<f32>) -> PatchPoint {
    let e = emitters[i];
    let away = (e.a + e.b + e.c) / 3.0 - at;
    if (dot(away, away) > NEAR * e.area) { return patch_point(i, at, u); }
    let none = PatchPoint(vec3(0.0), 0.0, vec3(0.0));
    let height = dot(e.normal, at - e.a);
    if (abs(height) < 1e-6 || (height < 0.0 && (e.kind & DOUBLE_SIDED) == 0u)) { return none; }
    let drawn = spherical_triangle(e.a - at, e.b - at, e.c - at, u);
    if (drawn.w <= 0.0) { return none; }
    let p = at - drawn.xyz * (height / dot(e.normal, drawn.xyz)) - e.a;
    // Barycentric in the patch, then in the whole triangle.
    let e1 = e.b - e.a;
    let e2 = e.c - e.a;
    let d11 = dot(e1, e1);
    let d12 = dot(e1, e2);
    let d22 = dot(e2, e2);
    let determinant = max(d11 * d22 - d12 * d12, 1e-30);
    let b1 = clamp((d22 * dot(p, e1) - d12 * dot(p, e2)) / determinant, 0.0, 1.0);
    let b2 = clamp((d11 * dot(p, e2) - d12 * dot(p, e1)) / determinant, 0.0, 1.0 - b1);
    let weights = e.weight_a * (1.0 - b1 - b2) + e.weight_b * b1 + e.weight_c * b2;
    let on_light = e.a + e1 * b1 + e2 * b2;
    return PatchPoint(
        on_light + e.normal * (offset_at(on_light) * select(1.0, -1.0, height < 0.0)),
        drawn.w,
        emission(e.triangle, weights.x, weights.y),
    );
}

// The share of an emitter that the visibility rays of a point's cell saw.
fn seen_from(at: vec3<f32>, i: u32) -> f32 {
    let byte = cell_of(at) * params.emitters + i;
    return f32((guides[params.seen_at + byte / 4u] >> (8u * (byte % 4u))) & 255u) / 255.0;
}
