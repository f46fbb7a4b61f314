// cache/site.rs: sites spread over the surroundings that a point of the coarse lattice stands for. A thread is a point. `list` is
// 0 for direct light,
// 1 for walks: each has sites of its own.

const PARTS = 6u;
const MORE_PARTS = 12u;
const OPENNESS_RAYS = 12u;
const FEW_OPENNESS_RAYS = 4u;
const STAGE_DIRECT = 0xd10002u;
const STAGE_SOLVE = 0xcac4e001u;

fn site_openness(site: Site, near_m: f32, rays: u32) -> f32 {
    let world_from_local = frame_of(site.normal);
    var buried = 0.0;
    for (var k = 0u; k < rays; k++) {
        let u = vec2((f32(k) + 0.5) / f32(rays), fract(f32(k) * 0.618034));
        let ray = half_line(start_of(site), world_from_local * sample_cosine(u));
        let hit = closest_where(ray, 0.5, false);
        if (hit.triangle != NONE && buries(ray, hit, near_m)) { buried += 1.0; }
    }
    return openness(buried / f32(rays));
}

fn part_of(job: Job, centre: vec2<f32>, k: u32, start: vec2<f32>) -> Site {
    let spacing_m = params.spacing_m[job.field].x;
    let size = charts[job.chart].size;
    let cells = max(lattices[job.field * params.charts + job.chart].yz, vec2(1u));
    let at = centre + (plastic(k, start) - vec2(0.5)) * (size / vec2<f32>(cells));
    // Beyond the edge it comes back, so that what lies along an edge counts in full.
    return site_near(job, min(abs(at), 2.0 * size - at), 1e-3 * spacing_m, 1e-2 * spacing_m);
}

fn put_sites_around(job: Job, k: u32, first: u32) {
    let spacing_m = params.spacing_m[job.field].x;
    let point = vec2(k % job.points.x, k / job.points.x);
    let centre = coordinates_of(job, point);
    var state = rng_keyed(
        vec2(params.seed.x ^ job.number, params.seed.y), vec2(STAGE_DIRECT, bitcast<u32>(spacing_m)), vec2(k, 0u),
    );
    if (params.list == 1u) { state = rng_keyed(params.seed, vec2(STAGE_SOLVE, 0u), vec2(job.first_point + k, 0u)); }
    let x = rng_uniform(&state);
    let start = vec2(x, rng_uniform(&state));
    var count = 0u;
    var is_seen = false;
    for (var part = 0u; part < PARTS + MORE_PARTS; part++) {
        let more = part >= PARTS;
        // Of what is mostly buried the rest is all that anybody sees: more parts are tried, and only what is seen counts.
        if (part == PARTS && is_seen) { break; }
        var site = part_of(job, centre, part, start);
        if (site.is_there == 0u) { continue; }
        if (more && site_openness(site, spacing_m, FEW_OPENNESS_RAYS) < SEEN) { continue; }
        site.open = site_openness(site, spacing_m, OPENNESS_RAYS);
        if (more && site.open < SEEN) { continue; }
        is_seen = is_seen || (!more && site.open >= SEEN);
        sites[first + count] = site;
        count += 1u;
    }
    if (count == 0u) {
        var site = site_of(job, point);
        if (site.is_there != 0u) {
            site.open = site_openness(site, spacing_m, OPENNESS_RAYS);
            sites[first] = site;
            count = 1u;
        }
    }
    if (count < SITES) { sites[first + count].is_there = 0u; }
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let i = group_number(id) * 64u + thread;
    if (i >= params.count * params.points) { return; }
    let tile = i / params.points;
    let k = i % params.points;
    if (k < point_count(jobs[tile])) { put_sites_around(jobs[tile], k, sites_at(tile, k)); }
}
