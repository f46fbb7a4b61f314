// cache/direct.rs: the patches that may light a tile, with how often and how to ask them. A workgroup is a tile, a thread one of
// 64 emitters.

const STAGE_PILOT = 0xd10001u;
const PILOT_POINTS = 16u;
const PILOT_RAYS = 6u;
// Numbers that a pilot ray draws.
const DRAWS = 3u;
const WORTH_A_LOOK = 2e-3;
const LEAST_WORTH = 0.02;
const SUSPICION = 0.02;

// The sites of the tile's points that are there, and the box of them.
var<workgroup> there: array<u32, MOST_POINTS * SITES>;
var<workgroup> there_count: u32;
var<workgroup> low: vec3<f32>;
var<workgroup> high: vec3<f32>;
var<workgroup> scanned: array<vec3<f32>, 64>;

// Sums over the threads up to and including this one; counts are exact below 2²⁴.
fn scan(thread: u32, value: vec3<f32>) -> vec3<f32> {
    var sum = value;
    scanned[thread] = sum;
    workgroupBarrier();
    for (var step = 1u; step < 64u; step *= 2u) {
        var before = vec3(0.0);
        if (thread >= step) { before = scanned[thread - step]; }
        workgroupBarrier();
        sum += before;
        scanned[thread] = sum;
        workgroupBarrier();
    }
    return sum;
}

fn probe(k: u32, n: u32) -> u32 {
    if (n <= 2u) { return k; }
    if (n < 36u) { return k * (n / 2u); }
    return select(k * n / 4u, n - 1u, k == 4u);
}

fn worth_of(i: u32, n: u32) -> f32 {
    let probes = select(select(5u, 2u, n < 36u), n, n <= 2u);
    var seen = 0.0;
    for (var k = 0u; k < probes; k++) {
        let site = sites[there[probe(k, n)]];
        seen += max(dot(solid_angle_vector(i, site.position, site.normal), site.normal), 0.0);
    }
    return luminance(emitters[i].power) * seen / f32(probes) + LEAST_WORTH * importance_in(i, low, high);
}

// How many of the pilot rays from the tile to a patch pass.
fn pilots(i: u32, n: u32, state: vec2<u32>) -> f32 {
    var draws = state;
    var visible = 0.0;
    for (var k = 0u; k < PILOT_RAYS; k++) {
        let site = sites[there[rng_below(&draws, n)]];
        let x = rng_uniform(&draws);
        let on_light = patch_toward(i, site.position, vec2(x, rng_uniform(&draws)));
        if (on_light.solid_angle > 0.0
            && max3(transmittance(segment(start_of(site), on_light.position))) > 0.5) { visible += 1.0; }
    }
    return visible;
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let tile = min(group_number(id), params.count - 1u);
    let job = jobs[tile];
    let scratch_at = tile * params.emitters;
    if (thread == 0u) {
        var count = 0u;
        var least = vec3(INFINITE);
        var most = vec3(-INFINITE);
        // Buried sites say nothing about what lights the others; where all are, they count.
        for (var pass_number = 0u; pass_number < 2u && count == 0u; pass_number++) {
            for (var k = 0u; k < point_count(job); k++) {
                let first = sites_at(tile, k);
                for (var i = first; i < first + site_count(first); i++) {
                    if (pass_number == 0u && sites[i].open < SEEN) { continue; }
                    there[count] = i;
                    count += 1u;
                    least = min(least, sites[i].position);
                    most = max(most, sites[i].position);
                }
            }
        }
        there_count = count;
        low = least;
        high = most;
    }
    let n = workgroupUniformLoad(&there_count);
    // Where nothing is there, nothing is asked.
    let patches = select(0u, params.first_punctual, n > 0u);
    var own = 0.0;
    for (var i = thread; i < patches; i += 64u) {
        let worth = worth_of(i, n);
        candidates[scratch_at + i].probability = worth;
        own += worth;
    }
    scan(thread, vec3(own, 0.0, 0.0));
    let total = scanned[63].x;
    workgroupBarrier();
    let stream = rng_keyed(
        vec2(params.seed.x ^ job.number, params.seed.y),
        vec2(STAGE_PILOT, 0u),
        vec2(bitcast<u32>(params.spacing_m[job.field].x), 0u),
    );
    // Candidates, pilots and probabilities so far.
    var before = vec3(0.0);
    for (var base = 0u; base < patches; base += 64u) {
        let i = base + thread;
        var worth = 0.0;
        if (i < patches) { worth = candidates[scratch_at + i].probability; }
        let looked = worth > WORTH_A_LOOK * total;
        let ranks = scan(thread, vec3(f32(worth > 0.0), f32(looked), 0.0));
        let block = scanned[63].xy;
        workgroupBarrier();
        var beta = 0.0;
        var variance = 0.25;
        if (looked) {
            let prior = seen_from(sites[there[n / 2u]].position, i);
            var seen = prior;
            var asked = 1.0;
            beta = prior;
            if (n >= PILOT_POINTS) {
                let rank = u32(before.y + ranks.y) - 1u;
                let visible = pilots(i, n, rng_ahead(stream, rank * PILOT_RAYS * DRAWS));
                beta = visible / f32(PILOT_RAYS);
                seen += visible;
                asked += f32(PILOT_RAYS);
            }
            let share = seen / asked;
            variance = share * (1.0 - share) + SUSPICION;
        }
        let probability = worth * sqrt(variance);
        let sums = scan(thread, vec3(probability, 0.0, 0.0));
        let block_sum = scanned[63].x;
        workgroupBarrier();
        if (worth > 0.0) {
            let at = scratch_at + u32(before.x + ranks.x) - 1u;
            candidates[at] = Candidate(i, before.z + sums.x, probability, beta);
        }
        before += vec3(block, block_sum);
        storageBarrier();
    }
    let count = u32(before.x);
    for (var c = thread; c < count; c += 64u) {
        candidates[scratch_at + c].cumulative /= before.z;
        candidates[scratch_at + c].probability /= before.z;
    }
    if (thread == 0u) { jobs[tile].candidates = count; }
}
