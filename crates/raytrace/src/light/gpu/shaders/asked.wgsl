// cache/direct.rs: light straight from patches at a site. The threads of a workgroup share the patches' closed forms and the
// rays.

const STAGE_DIRECT = 0xd10002u;

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

// One thread's part of the light of a site.
struct Part {
    sum: Received,
    // Share of the rays that arrived.
    lit: f32,
}

// The stream of a tile's point.
fn stream_of(job: Job, k: u32) -> vec2<u32> {
    return rng_keyed(
        vec2(params.seed.x ^ job.number, params.seed.y),
        vec2(STAGE_DIRECT, bitcast<u32>(params.spacing_m[job.field].x)),
        vec2(k, 0u),
    );
}

fn part_at(thread: u32, site: Site, first: u32, count: u32, ray_count: u32, stream: vec2<u32>) -> Part {
    var state = stream;
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
    let n = f32(ray_count);
    let rays = select(0u, ray_count, count > 0u);
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
    return Part(sum, lit);
}
