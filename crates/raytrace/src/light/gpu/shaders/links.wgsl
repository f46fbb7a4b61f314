// cache/solve.rs: the walks of the coarse lattice's points. A workgroup is a point. Of each point `links` gets a word of four a
// walk: the point at its
// end (NONE without one) and the throughput between them; then three with the light that its walks met on the way.

const STAGE_SOLVE = 0xcac4e001u;

// One of the four points around a spot of the coarse lattice, drawn by its weight in the interpolation.
fn picked(spot: Spot, u: f32) -> u32 {
    let corners = corners_of(0u, spot);
    let head = slot_state(corners.slot) - FILLED;
    let first = word(head).z;
    var weights = corners.shares;
    for (var k = 0u; k < 4u; k++) { weights[k] *= point_at(head, corners.numbers[k]).weight; }
    var left = u * (weights.x + weights.y + weights.z + weights.w);
    for (var k = 0u; k < 4u; k++) {
        if (left < weights[k]) { return first + corners.numbers[k]; }
        left -= weights[k];
    }
    return first + corners.numbers.x;
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let i = params.first * params.points + group_number(id);
    let tile = min(i / params.points, params.count - 1u);
    let k = i % params.points;
    let job = jobs[tile];
    let is_point = i / params.points < params.count && k < point_count(job);
    let first = sites_at(tile, k);
    let count = select(0u, site_count(first), is_point);
    var open = 0.0;
    for (var s = 0u; s < count; s++) { open += sites[first + s].open; }
    let point = job.first_point + k;
    let record = (job.first_record + k) * (params.rays + 3u);
    let normal = charts[job.chart].normal * select(1.0, -1.0, job.side == 1u);
    let world_from_local = frame_of(normal);
    var frame = rng_keyed(params.seed, STAGE_PIXEL, vec2(STAGE_SOLVE, 0u));
    var draws = draws_of(rng_next(&frame), vec2(point, 0u));
    var sum = none_received();
    let walks = select(0u, params.rays, is_point);
    for (var w = thread; w < walks; w += 64u) {
        var link = vec4(NONE, 0u, 0u, 0u);
        if (count > 0u) {
            let site = sites[first + w % count];
            draws.index = w;
            let direction = world_from_local * sample_cosine(pair(draws, 0u));
            let met = walk(half_line(start_of(site), direction), 0.0, draws, FIRST_WALK_PAIR);
            // Sites count by how open they lie.
            let weight = site_receives(site, dot(direction, normal)) * site.open * f32(count) / open;
            sum = with_scaled(sum, received_from(spread(normal, direction), met.light * weight), 1.0 / f32(params.rays));
            if (any(met.throughput != vec3(0.0))) {
                link = vec4(picked(met.spot, pair(draws, 1u).x), bitcast<vec3<u32>>(met.throughput * weight));
            }
        }
        links[record + w] = link;
    }
    let all = reduce(thread, sum, 0.0);
    if (thread == 0u && is_point) {
        for (var row = 0u; row < 3u; row++) { links[record + params.rays + row] = bitcast<vec4<u32>>(all[row]); }
    }
}
