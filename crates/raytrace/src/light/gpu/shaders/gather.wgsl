// cache/gather.rs: indirect light at a lattice point, gathered from the coarse lattice. A workgroup is a point, its threads share
// the walks.

const STAGE_GATHER = 0xcac4e100u;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let i = params.first * params.points + group_number(id);
    let tile = min(i / params.points, params.count - 1u);
    let k = i % params.points;
    let job = jobs[tile];
    let is_point = i / params.points < params.count && k < point_count(job);
    let site = sites[sites_at(tile, k)];
    let is_there = is_point && site.is_there != 0u;
    let spacing_m = params.spacing_m[job.field].x;
    let bits = bitcast<u32>(spacing_m);
    var frame = rng_keyed(params.seed, STAGE_PIXEL, vec2(STAGE_GATHER ^ (bits << 16u), bits >> 16u));
    var draws = draws_of(rng_next(&frame), vec2((job.number << 8u) | k, job.number >> 24u));
    let n = f32(params.rays);
    let world_from_local = frame_of(site.normal);
    var sum = none_received();
    var hidden = 0.0;
    let walks = select(0u, params.rays, is_there);
    for (var w = thread; w < walks; w += 64u) {
        draws.index = w;
        let direction = world_from_local * sample_cosine(pair(draws, 0u));
        let met = walk(half_line(start_of(site), direction), spacing_m, draws, FIRST_WALK_PAIR);
        var light = met.light;
        if (any(met.throughput != vec3(0.0))) { light += met.throughput * received_at(read_coarse(met.spot), met.normal); }
        hidden += f32(met.buried);
        let weight = site_receives(site, dot(direction, site.normal)) / n;
        sum = with_scaled(sum, received_from(spread(site.normal, direction), light), weight);
    }
    let all = reduce(thread, sum, hidden);
    if (thread == 0u && is_point) { put_point(job, k, all, select(0.0, openness(all[0].w / n), is_there)); }
}
