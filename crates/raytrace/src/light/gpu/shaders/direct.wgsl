// cache/direct.rs: light straight from patches at a lattice point. A workgroup is a point; its threads share the patches' closed forms and the rays.

const STAGE_DIRECT = 0xd10002u;
const LIT_ENOUGH = 0.3;
const OPENNESS_RAYS = 12u;

var<workgroup> buried: array<u32, OPENNESS_RAYS>;

// The candidate whose interval holds `at`.
fn candidate_of(first: u32, count: u32, at: f32) -> u32 {
    var low = 0u;
    var high = count - 1u;
    while (low < high) {
        let middle = (low + high) / 2u;
        if (candidates[first + middle].cumulative <= at) { low = middle + 1u; } else { high = middle; }
    }
    return low;
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let i = params.first * MOST_POINTS + group_number(id);
    let tile = min(i / MOST_POINTS, params.count - 1u);
    let k = i % MOST_POINTS;
    let job = jobs[tile];
    let is_point = i / MOST_POINTS < params.count && k < point_count(job);
    var site = sites[tile * MOST_POINTS + k];
    let is_there = is_point && site.is_there != 0u;
    let first = tile * params.emitters;
    let count = select(0u, job.candidates, is_there);
    let spacing_m = params.spacing_m[job.field].x;
    var state = rng_keyed(
        vec2(params.seed.x ^ job.number, params.seed.y), vec2(STAGE_DIRECT, bitcast<u32>(spacing_m)), vec2(k, 0u),
    );
    let start = rng_uniform(&state);
    let shift_x = rng_uniform(&state);
    let shift = vec2(shift_x, rng_uniform(&state));
    var sum = none_received();
    var lit = 0.0;
    for (var c = thread; c < count; c += 64u) {
        let candidate = candidates[first + c];
        if (candidate.beta > 0.0) {
            let vector = solid_angle_vector(candidate.emitter, site.position, site.normal);
            sum = with_scaled(sum, received_from(vector, emitters[candidate.emitter].power), candidate.beta * INVERSE_PI);
        }
    }
    let n = f32(params.rays);
    let rays = select(0u, params.rays, count > 0u);
    for (var j = thread; j < rays; j += 64u) {
        let next = candidate_of(first, count, (f32(j) + start) / n);
        let candidate = candidates[first + next];
        // Which of the candidate's own points this is: how many rays came before that hold it.
        var begun = 0u;
        if (next > 0u) {
            let low = candidates[first + next - 1u].cumulative;
            begun = min(u32(max(ceil(low * n - start), 0.0)), j);
            while (begun < j && (f32(begun) + start) / n < low) { begun += 1u; }
            while (begun > 0u && (f32(begun - 1u) + start) / n >= low) { begun -= 1u; }
        }
        let u = plastic(j - begun, shift + f32(next) * vec2(0.381966, 0.7236));
        let p = patch_toward(candidate.emitter, site.position, u);
        if (p.solid_angle <= 0.0) { continue; }
        let direction = normalize(p.position - site.position);
        let cosine = dot(direction, site.normal);
        if (cosine <= 0.0) { continue; }
        let share = transmittance(segment(start_of(site), p.position));
        lit += f32(any(share != vec3(0.0))) / n;
        let found = p.radiance * share * site_receives(site, cosine) - emitters[candidate.emitter].power * candidate.beta;
        sum = with_scaled(sum, received_from(direction, found), p.solid_angle * INVERSE_PI / (candidate.probability * n));
    }
    let all = reduce(thread, sum, lit);
    // Most points are lit, and so lie open.
    let is_dark = is_there && all[0].w < LIT_ENOUGH;
    if (thread < OPENNESS_RAYS) {
        buried[thread] = 0u;
        if (is_dark) {
            let u = vec2((f32(thread) + 0.5) / f32(OPENNESS_RAYS), fract(f32(thread) * 0.618034));
            let ray = half_line(start_of(site), frame_of(site.normal) * sample_cosine(u));
            let hit = closest_where(ray, 0.5, false);
            if (hit.triangle != NONE && buries(ray, hit, spacing_m)) { buried[thread] = 1u; }
        }
    }
    workgroupBarrier();
    if (thread == 0u && is_point) {
        var weight = select(0.0, 1.0, is_there);
        if (is_dark) {
            var total = 0u;
            for (var r = 0u; r < OPENNESS_RAYS; r++) { total += buried[r]; }
            weight = openness(f32(total) / f32(OPENNESS_RAYS));
        }
        put_point(job, k, all, weight);
    }
}
