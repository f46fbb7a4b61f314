// Rays against the tree (bvh/): closest hit and what passes along a shadow ray. Two boxes a step, the nearer child first.
//
// Watertight: an edge's function is dot(cross(e, p + q), d), exactly opposite in the two triangles that share it whether or not
// the driver fuses products.

struct Ray {
    origin: vec3<f32>,
    t_min: f32,
    direction: vec3<f32>,
    t_max: f32,
}

struct Hit {
    t: f32,
    u: f32,
    v: f32,
    triangle: u32,
}

const LEAF = 0x80000000u;
const INFINITE = 3.0e38;
// Twice that of the processor, whose reciprocals are correctly rounded.
const FAR_SLACK = 1.0 + 8.0 * 1.1920929e-7;
const SMALLEST_COMPONENT = 1e-20;

fn half_line(origin: vec3<f32>, direction: vec3<f32>) -> Ray {
    return Ray(origin, 0.0, direction, INFINITE);
}

fn segment(start: vec3<f32>, end: vec3<f32>) -> Ray {
    return Ray(start, 0.0, end - start, 1.0);
}

fn reciprocal(direction: vec3<f32>) -> vec3<f32> {
    let small = abs(direction) < vec3(SMALLEST_COMPONENT);
    return 1.0 / select(direction, select(vec3(SMALLEST_COMPONENT), vec3(-SMALLEST_COMPONENT), direction < vec3(0.0)), small);
}

// The distance at which a ray enters a box, or INFINITE where it does not.
fn entry(low: vec3<f32>, high: vec3<f32>, ray: Ray, inverse: vec3<f32>, t_max: f32) -> f32 {
    let a = (low - ray.origin) * inverse;
    let b = (high - ray.origin) * inverse;
    let enter = min(a, b);
    let leave = max(a, b) * FAR_SLACK;
    let near = max(max(enter.x, enter.y), max(enter.z, ray.t_min));
    let far = min(min(leave.x, leave.y), min(leave.z, t_max));
    return select(INFINITE, near, near <= far);
}

fn edge(p: vec3<f32>, q: vec3<f32>, direction: vec3<f32>) -> f32 {
    return dot(cross(q - p, p + q), direction);
}

// The hit of a triangle in (t_min, t_max); `triangle` is NONE without.
fn meet(ray: Ray, number: u32, t_max: f32) -> Hit {
    let triangle = triangles[number];
    let a = triangle.a - ray.origin;
    let b = triangle.b - ray.origin;
    let c = triangle.c - ray.origin;
    let of_a = edge(b, c, ray.direction);
    let of_b = edge(c, a, ray.direction);
    let of_c = edge(a, b, ray.direction);
    let least = min(of_a, min(of_b, of_c));
    let most = max(of_a, max(of_b, of_c));
    let sum = of_a + of_b + of_c;
    if ((least < 0.0 && most > 0.0) || sum == 0.0) { return Hit(t_max, 0.0, 0.0, NONE); }
    let u = of_b / sum;
    let v = of_c / sum;
    let t = dot(a * (of_a / sum) + b * u + c * v, ray.direction) / dot(ray.direction, ray.direction);
    return Hit(t, u, v, select(NONE, number, t > ray.t_min && t < t_max));
}

// Of the ray on its way; a variable of the functions would be set to zero for every ray.
var<private> stack: array<u32, STACK>;

// The closest hit of whose surface more than `least` is there, panes left out if they are to be.
fn closest_where(ray: Ray, least: f32, with_panes: bool) -> Hit {
    let inverse = reciprocal(ray.direction);
    var best = Hit(ray.t_max, 0.0, 0.0, NONE);
    var top = 0u;
    var at = 0u;
    loop {
        if ((at & LEAF) == 0u) {
            let node = nodes[at];
            let a = entry(node.low_a, node.high_a, ray, inverse, best.t);
            let b = entry(node.low_b, node.high_b, ray, inverse, best.t);
            if (min(a, b) < INFINITE) {
                let a_first = a <= b;
                at = select(node.b, node.a, a_first);
                if (max(a, b) < INFINITE) {
                    stack[top] = select(node.a, node.b, a_first);
                    top += 1u;
                }
                continue;
            }
        } else {
            let first = (at & ~LEAF) >> 3u;
            for (var k = first; k <= first + (at & 7u); k++) {
                let hit = meet(ray, k, best.t);
                if (hit.triangle == NONE) { continue; }
                if (!ALL_OPAQUE) {
                    let cover = triangles[k].cover;
                    if (!with_panes && (cover & COVER_PANE) != 0u) { continue; }
                    if ((cover & COVER_ALPHA) != 0u && coverage(k, hit.u, hit.v) <= least) { continue; }
                }
                best = hit;
            }
        }
        if (top == 0u) { break; }
        top -= 1u;
        at = stack[top];
    }
    return best;
}

fn closest(ray: Ray) -> Hit {
    return closest_where(ray, 0.0, true);
}

// Share of light, per channel, that passes along a shadow ray.
fn transmittance(ray: Ray) -> vec3<f32> {
    let inverse = reciprocal(ray.direction);
    var share = vec3(1.0);
    var top = 0u;
    var at = 0u;
    loop {
        if ((at & LEAF) == 0u) {
            let node = nodes[at];
            let a = entry(node.low_a, node.high_a, ray, inverse, ray.t_max);
            let b = entry(node.low_b, node.high_b, ray, inverse, ray.t_max);
            if (min(a, b) < INFINITE) {
                let a_first = a <= b;
                at = select(node.b, node.a, a_first);
                if (max(a, b) < INFINITE) {
                    stack[top] = select(node.a, node.b, a_first);
                    top += 1u;
                }
                continue;
            }
        } else {
            let first = (at & ~LEAF) >> 3u;
            for (var k = first; k <= first + (at & 7u); k++) {
                let hit = meet(ray, k, ray.t_max);
                if (hit.triangle == NONE) { continue; }
                if (ALL_OPAQUE) { return vec3(0.0); }
                let cover = triangles[k].cover;
                if (cover == 0u) { return vec3(0.0); }
                var there = 1.0;
                if ((cover & COVER_ALPHA) != 0u) { there = coverage(k, hit.u, hit.v); }
                var through = vec3(0.0);
                if ((cover & COVER_PANE) != 0u) { through = pane_transmittance(hit, ray.direction); }
                else if (there >= 1.0) { return vec3(0.0); }
                share *= vec3(1.0 - there) + through * there;
            }
        }
        if (top == 0u) { break; }
        top -= 1u;
        at = stack[top];
    }
    return share;
}
