// cache/site.rs and cache/charts.rs: where on its surface a place of a chart lies.

const FEW_TRIANGLES = 16u;

struct Nearest {
    triangle: u32,
    distance: f32,
    weights: vec3<f32>,
}

// Barycentric weights of the point of a triangle nearest to a position.
fn nearest_on(a: vec3<f32>, b: vec3<f32>, c: vec3<f32>, p: vec3<f32>) -> vec3<f32> {
    let ab = b - a;
    let ac = c - a;
    let d1 = dot(ab, p - a);
    let d2 = dot(ac, p - a);
    if (d1 <= 0.0 && d2 <= 0.0) { return vec3(1.0, 0.0, 0.0); }
    let d3 = dot(ab, p - b);
    let d4 = dot(ac, p - b);
    if (d3 >= 0.0 && d4 <= d3) { return vec3(0.0, 1.0, 0.0); }
    let vc = d1 * d4 - d3 * d2;
    if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) {
        let t = d1 / (d1 - d3);
        return vec3(1.0 - t, t, 0.0);
    }
    let d5 = dot(ab, p - c);
    let d6 = dot(ac, p - c);
    if (d6 >= 0.0 && d5 <= d6) { return vec3(0.0, 0.0, 1.0); }
    let vb = d5 * d2 - d1 * d6;
    if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) {
        let t = d2 / (d2 - d6);
        return vec3(1.0 - t, 0.0, t);
    }
    let va = d3 * d6 - d5 * d4;
    if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0) {
        let t = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        return vec3(0.0, 1.0 - t, t);
    }
    let sum = va + vb + vc;
    if (sum > 0.0) { return vec3(va, vb, vc) / sum; }
    return vec3(1.0 / 3.0);
}

// Weights moved inwards until the point is about `inset_m` from every edge, or a fifth of the way to the opposite corner.
fn inset_weights(a: vec3<f32>, b: vec3<f32>, c: vec3<f32>, weights: vec3<f32>, inset_m: f32) -> vec3<f32> {
    let double_area = length(cross(b - a, c - a));
    let least = vec3(length(c - b), length(a - c), length(b - a)) * (inset_m / max(double_area, 1e-20));
    let moved = max(weights, min(least, vec3(0.2)));
    return moved / (moved.x + moved.y + moved.z);
}

fn nearer(best: Nearest, number: u32, position: vec3<f32>, by_number: bool) -> Nearest {
    let t = triangles[number];
    let w = nearest_on(t.a, t.b, t.c, position);
    let d = length(t.a * w.x + t.b * w.y + t.c * w.z - position);
    let tie = by_number && d == best.distance && best.triangle != NONE && t.number < triangles[min(best.triangle, number)].number;
    if (d < best.distance || tie) { return Nearest(number, d, w); }
    return best;
}

fn meets_box(low: vec3<f32>, high: vec3<f32>, centre: vec3<f32>, reach: f32) -> bool {
    return all(low <= centre + vec3(reach)) && all(high >= centre - vec3(reach));
}

// The point of a chart nearest to a position, looked for no farther than `reach`.
fn nearest_in(chart: u32, position: vec3<f32>, reach: f32) -> Nearest {
    var best = Nearest(NONE, INFINITE, vec3(0.0));
    let first = charts[chart].first;
    let count = charts[chart].count;
    if (count <= FEW_TRIANGLES) {
        for (var k = 0u; k < count; k++) {
            if (members[first + k] != NONE) { best = nearer(best, members[first + k], position, false); }
        }
        return best;
    }
    var stack: array<u32, STACK>;
    var top = 0u;
    var at = 0u;
    loop {
        if ((at & LEAF) == 0u) {
            let node = nodes[at];
            let a = meets_box(node.low_a, node.high_a, position, reach);
            let b = meets_box(node.low_b, node.high_b, position, reach);
            if (a || b) {
                at = select(node.b, node.a, a);
                if (a && b) {
                    stack[top] = node.b;
                    top += 1u;
                }
                continue;
            }
        } else {
            let start = (at & ~LEAF) >> 3u;
            for (var k = start; k <= start + (at & 7u); k++) {
                if (triangles[k].number != NONE && attributes[k].chart == chart) { best = nearer(best, k, position, true); }
            }
        }
        if (top == 0u) { break; }
        top -= 1u;
        at = stack[top];
    }
    return best;
}

fn along(cells: u32, i: u32, size: f32) -> f32 {
    if (cells == 0u) { return 0.5 * size; }
    return f32(i) * (size / f32(cells));
}

// Coordinates of a point of a tile on its chart, metres.
fn coordinates_of(job: Job, point: vec2<u32>) -> vec2<f32> {
    let lattice = lattices[job.field * params.charts + job.chart];
    let size = charts[job.chart].size;
    return vec2(along(lattice.y, job.first.x + point.x, size.x), along(lattice.z, job.first.y + point.y, size.y));
}

fn no_site() -> Site {
    return Site(vec3(0.0), 0u, vec3(0.0), 1.0, 0.0, 0.0, 0.0, 0u);
}

// The site nearest to coordinates of a tile's chart, no farther than `reach_m`.
fn site_near(job: Job, coordinates: vec2<f32>, inset_m: f32, reach_m: f32) -> Site {
    let chart = charts[job.chart];
    let nominal = chart.origin + chart.x_axis * coordinates.x + chart.y_axis * coordinates.y;
    let nearest = nearest_in(job.chart, nominal, min(reach_m, 1.01 * params.spacing_m[job.field].x));
    if (nearest.triangle == NONE || nearest.distance > reach_m) { return no_site(); }
    let t = triangles[nearest.triangle];
    let w = inset_weights(t.a, t.b, t.c, nearest.weights, inset_m);
    let facing = cross(t.b - t.a, t.c - t.a);
    if (dot(facing, facing) <= 1e-36) { return no_site(); }
    let normal = normalize(facing) * select(1.0, -1.0, job.side == 1u);
    let position = t.a * (1.0 - w.y - w.z) + t.b * w.y + t.c * w.z;
    let hit = Hit(1.0, w.y, w.z, nearest.triangle);
    let surface = surface_at(half_line(position + normal, -normal), hit, true);
    let alpha = max(surface.roughness * surface.roughness, MIN_ALPHA);
    let f0_max = max3(f0_of(surface.base_color, surface.metallic, surface.ior));
    return Site(surface.position, 1u, normal, alpha, f0_max, diffuse_scale_of(f0_max, alpha), 1.0, 0u);
}

// Lattice points are kept this share of their spacing off the edges of their surface.
const INSET = 0.11;

fn site_of(job: Job, point: vec2<u32>) -> Site {
    return site_near(job, coordinates_of(job, point), INSET * params.spacing_m[job.field].x, INFINITE);
}
