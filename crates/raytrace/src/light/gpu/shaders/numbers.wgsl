// Functions that drivers round as they like, where it matters.

const PI = 3.14159265358979;
const INVERSE_PI = 0.318309886183791;
const NONE = 0xffffffffu;

// Cosine and sine of 2π·turns, turns in [0, 1]: by octants and Taylor's series, to 1e-7.
fn cos_sin_turns(turns: f32) -> vec2<f32> {
    let octant = floor(turns * 8.0 + 0.5);
    // At most π/8.
    let x = (turns - octant * 0.125) * (2.0 * PI);
    let x2 = x * x;
    let c = 1.0 - x2 * (0.5 - x2 * (1.0 / 24.0 - x2 * (1.0 / 720.0 - x2 * (1.0 / 40320.0))));
    let s = x * (1.0 - x2 * (1.0 / 6.0 - x2 * (1.0 / 120.0 - x2 * (1.0 / 5040.0))));
    let k = u32(octant) & 7u;
    let h = 0.70710678118655;
    // Cosine and sine of the octant's own angle.
    let along = select(select(0.0, h, k == 1u || k == 7u) - select(0.0, h, k == 3u || k == 5u), 1.0, k == 0u)
        - select(0.0, 1.0, k == 4u);
    let across = select(select(0.0, h, k == 1u || k == 3u) - select(0.0, h, k == 5u || k == 7u), 1.0, k == 2u)
        - select(0.0, 1.0, k == 6u);
    return vec2(along * c - across * s, across * c + along * s);
}

// Angle of (x, y) for y ≥ 0, in [0, π], to 2e-7.
fn angle(y: f32, x: f32) -> f32 {
    let a = abs(x);
    let most = max(a, y);
    if (most <= 0.0) { return 0.0; }
    let steep = y > a;
    let z = min(a, y) / most;
    // arctan of [0, 1], about tan(π/8) where it is beyond it.
    let far = z > 0.414213562;
    let w = select(z, (z - 1.0) / (z + 1.0), far);
    let w2 = w * w;
    let series = ((8.05374449538e-2 * w2 - 1.38776856032e-1) * w2 + 1.99777106478e-1) * w2 - 3.33329491539e-1;
    var t = series * w2 * w + w + select(0.0, 0.25 * PI, far);
    t = select(t, 0.5 * PI - t, steep);
    return select(t, PI - t, x < 0.0);
}

fn is_finite(v: f32) -> bool {
    return (bitcast<u32>(v) & 0x7f800000u) != 0x7f800000u;
}

fn all_finite(v: vec3<f32>) -> bool {
    return is_finite(v.x) && is_finite(v.y) && is_finite(v.z);
}

fn max3(v: vec3<f32>) -> f32 {
    return max(v.x, max(v.y, v.z));
}

fn luminance(c: vec3<f32>) -> f32 {
    return dot(c, vec3(0.2126, 0.7152, 0.0722));
}

fn normalize_or(v: vec3<f32>, other: vec3<f32>) -> vec3<f32> {
    let squared = dot(v, v);
    return select(other, v / sqrt(squared), squared > 1e-36);
}

// Two directions orthogonal to a unit vector and to each other, as glam's `any_orthonormal_pair` (Duff et al. 2017).
fn orthonormal_pair(n: vec3<f32>) -> array<vec3<f32>, 2> {
    let sign = select(1.0, -1.0, (bitcast<u32>(n.z) >> 31u) == 1u);
    let a = -1.0 / (sign + n.z);
    let b = n.x * n.y * a;
    return array(vec3(1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x), vec3(b, sign + n.y * n.y * a, -n.y));
}

// w = p² / (p² + q²); p below zero stands for infinity: the other technique cannot make this path.
fn power_heuristic(p: f32, q: f32) -> f32 {
    if (p < 0.0) { return 1.0; }
    let ratio = q / p;
    return 1.0 / (1.0 + ratio * ratio);
}
