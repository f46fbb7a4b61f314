// Direct light at points of the coarse lattice, lights without extent included: the mean over their sites. A workgroup is a
// point.

// Numbers that a point draws for its sites, and each of them for its light.
const SITE_DRAWS = 2u;
const LIGHT_DRAWS = 3u;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let i = params.first * params.points + group_number(id);
    let tile = min(i / params.points, params.count - 1u);
    let k = i % params.points;
    let job = jobs[tile];
    let is_point = i / params.points < params.count && k < point_count(job);
    let first = sites_at(tile, k);
    let count = select(0u, site_count(first), is_point);
    let rays = (params.rays + max(count, 1u) - 1u) / max(count, 1u);
    let stream = stream_of(job, k);
    var sum = none_received();
    var total = 0.0;
    var weight = 0.0;
    for (var s = 0u; s < count; s++) {
        let site = sites[first + s];
        let part = part_at(
            thread, site, tile * params.emitters, job.candidates, rays, rng_ahead(stream, SITE_DRAWS + s * LIGHT_DRAWS),
        );
        sum = with_scaled(sum, part.sum, site.open);
        for (var e = params.first_punctual + thread; e < params.emitters; e += 64u) {
            let light = punctual_at(e, site.position);
            let direction = normalize(light.to_light);
            let cosine = dot(direction, site.normal);
            if (light.there == 0u || cosine <= 0.0) { continue; }
            let arrived = light.irradiance * transmittance(segment(start_of(site), site.position + light.to_light));
            sum = with_scaled(sum, received_from(direction, arrived), site.open * site_receives(site, cosine) * INVERSE_PI);
        }
        total += site.open;
        weight = max(weight, site.open);
    }
    let all = reduce(thread, sum, 0.0);
    if (thread == 0u && is_point) { put_point(job, k, all * select(1.0, 1.0 / total, total > 0.0), weight); }
}
