// Tiles that are being filled: a job (records.rs) each.

// Points of a tile at most.
const MOST_POINTS = 81u;

// A lattice point on its surface (cache/site.rs), or one of SITES that stand for its surroundings; of the reflection, what does
// not depend on the
// viewer.
struct Site {
    position: vec3<f32>,
    // 0 where the chart has no surface nearby; behind the last of several sites.
    is_there: u32,
    normal: vec3<f32>,
    alpha: f32,
    f0_max: f32,
    diffuse_scale: f32,
    // How far it is to be believed, where that was asked.
    open: f32,
    unused: u32,
}

// A patch, as a tile sees it (cache/direct.rs).
struct Candidate {
    emitter: u32,
    cumulative: f32,
    probability: f32,
    beta: f32,
}

var<private> shadows: u32;

fn slot_state(slot: u32) -> u32 {
    return slots[slot];
}

fn start_of(site: Site) -> vec3<f32> {
    return site.position + site.normal * offset_at(site.position);
}

fn site_receives(site: Site, cosine: f32) -> f32 {
    return received_weight(cosine, site.alpha, site.f0_max, site.diffuse_scale);
}

// Place of the first site of a tile's point.
fn sites_at(tile: u32, k: u32) -> u32 {
    return (tile * params.points + k) * SITES;
}

// Number of a point's sites.
fn site_count(first: u32) -> u32 {
    var count = 0u;
    while (count < SITES && sites[first + count].is_there != 0u) { count += 1u; }
    return count;
}

fn point_count(job: Job) -> u32 {
    return job.points.x * job.points.y;
}

// Whether what a ray met hides its origin: the back of a surface with one side, or a surface nearer than `near_m`.
fn buries(ray: Ray, hit: Hit, near_m: f32) -> bool {
    let t = triangles[hit.triangle];
    let behind = dot(cross(t.b - t.a, t.c - t.a), ray.direction) > 0.0;
    return hit.t < near_m || (behind && materials[attributes[hit.triangle].material].double_sided == 0u);
}

// Sites at least this open are seen by others.
const SEEN = 0.1;
const OPEN = 0.6;
const BURIED = 0.9;
const DOUBTFUL = 1e-3;

fn openness(buried: f32) -> f32 {
    let o = clamp((BURIED - buried) / (BURIED - OPEN), 0.0, 1.0);
    return max(o * o, DOUBTFUL);
}

// Point k of the R₂ sequence, shifted.
fn plastic(k: u32, shift: vec2<f32>) -> vec2<f32> {
    return fract(shift + f32(k) * vec2(0.7548777, 0.5698403));
}
