// depth/triangulate.rs, `sweep_pixel`: a workgroup is a pixel of the coarse image, a thread has every 64th inverse depth.

// Stands for all neighbours, in place of one.
const ALL = 0u;

var<workgroup> scores: array<f32, MOST_CANDIDATES>;
var<workgroup> values: array<f32, THREADS>;
var<workgroup> goes_on: u32;

// Of the patch that is compared.
var<private> ray: vec3<f32>;

fn there(n: u32, w: f32) -> Warp { return warp(views[n].there, views[0].image.focal, views[n].image, ray, w, vec2(0.0)); }

fn back(n: u32, w: f32) -> Warp { return warp(views[n].back, views[n].image.focal, views[0].image, ray, w, vec2(0.0)); }

// Mean correlation with the neighbours that see an inverse depth, or that of the reference with a patch of neighbour `n`.
fn score(n: u32, w: f32) -> f32 {
    if (n != ALL) { return correlation(views[0].image, back(n, w)); }
    var sum = 0.0;
    var seen = 0.0;
    for (var j = 1u; j <= job.neighbours; j++) {
        let z = correlation(views[j].image, there(j, w));
        if (z != MISSED) {
            sum += z;
            seen += 1.0;
        }
    }
    if (seen == 0.0) { return MISSED; }
    return sum / seen;
}

// The scores of two inverse depths, all threads together: a thread has one neighbour at one of them. What is not above `least` is not seen.
fn pair(thread: u32, n: u32, around: vec2<f32>, least: f32) -> vec2<f32> {
    let count = select(1u, job.neighbours, n == ALL);
    workgroupBarrier();
    if (thread < 2u * count) {
        let w = select(around.x, around.y, thread % 2u == 1u);
        let j = 1u + thread / 2u;
        var z = MISSED;
        if (w > least) {
            if (n == ALL) { z = correlation(views[j].image, there(j, w)); } else { z = correlation(views[0].image, back(n, w)); }
        }
        values[thread] = z;
    }
    workgroupBarrier();
    var sum = vec2(0.0);
    var seen = vec2(0.0);
    for (var j = 0u; j < count; j++) {
        let z = vec2(values[2u * j], values[2u * j + 1u]);
        let is_seen = z != vec2(MISSED);
        sum += select(vec2(0.0), z, is_seen);
        seen += select(vec2(0.0), vec2(1.0), is_seen);
    }
    return select(sum / max(seen, vec2(1.0)), vec2(MISSED), seen == vec2(0.0));
}

// The best of the scores, the last of equals, and its place.
fn best_score() -> vec2<f32> {
    var best = vec2(MISSED, 0.0);
    for (var k = 0u; k < job.candidates; k++) {
        if (scores[k] >= best.x) { best = vec2(scores[k], f32(k)); }
    }
    return best;
}

// Halves the step around the best hypothesis, then a parabola: inverse depth and score.
fn refine(thread: u32, n: u32, first: f32, first_score: f32) -> vec2<f32> {
    var center = first;
    var best = first_score;
    var step = job.step;
    for (var round = 0u; round < HALVINGS; round++) {
        step *= 0.5;
        let around = vec2(center - step, center + step);
        let z = pair(thread, n, around, 0.5 * job.far);
        if (z.x > best) {
            center = around.x;
            best = z.x;
        }
        if (z.y > best) {
            center = around.y;
            best = z.y;
        }
    }
    let z = pair(thread, n, vec2(center - step, center + step), NO_LEAST);
    if (any(z == vec2(MISSED)) || any(z > vec2(best))) { return vec2(center, best); }
    return vec2(center + step * parabola_offset(z.x, best, z.y), best);
}

// Whether all go on: what thread 0 says.
fn all_go_on(thread: u32, goes: bool) -> bool {
    workgroupBarrier();
    if (thread == 0u) { goes_on = select(0u, 1u, goes); }
    return workgroupUniformLoad(&goes_on) == 1u;
}

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let group = group_number(id);
    if (group >= job.count) { return; }
    let item = job.first + group;
    let pixel = starts[item].pixel;
    let is_patch = take_patch(thread, views[0].image, pixel);
    if (thread == 0u) { found[item] = NONE; }
    if (!all_go_on(thread, is_patch)) { return; }
    let own_ray = ray_of(views[0].image, vec2<f32>(pixel) + 0.5);
    ray = own_ray;
    for (var k = thread; k < job.candidates; k += THREADS) { scores[k] = score(ALL, job.far + job.step * f32(k)); }
    workgroupBarrier();
    let best = best_score();
    var rival = -1.0;
    for (var k = 0u; k < job.candidates; k++) {
        if (abs(f32(k) - best.y) >= PEAK_STEPS) { rival = max(rival, scores[k]); }
    }
    if (!all_go_on(thread, best.x != MISSED && 1.0 - rival > 0.0)) { return; }
    // The coarse steps may straddle a narrow peak: climb it before judging.
    let climbed = refine(thread, ALL, job.far + job.step * best.y, best.x);
    let w = climbed.x;
    if (!all_go_on(thread, climbed.y >= job.min_zncc && 1.0 - climbed.y <= UNIQUENESS * (1.0 - rival))) { return; }

    // The match in the neighbour that agrees best, swept back alone, must return to where it came from.
    if (thread < job.neighbours) { values[thread] = correlation(views[1u + thread].image, there(1u + thread, w)); }
    workgroupBarrier();
    var judge = 0u;
    var agreed = MISSED;
    for (var j = 0u; j < job.neighbours; j++) {
        if (values[j] > MISSED && values[j] >= agreed) {
            judge = 1u + j;
            agreed = values[j];
        }
    }
    if (!all_go_on(thread, judge != 0u)) { return; }
    let landed = vec2<u32>(there(judge, w).center);
    let is_patch_there = take_patch(thread, views[judge].image, landed);
    if (!all_go_on(thread, is_patch_there)) { return; }
    ray = ray_of(views[judge].image, vec2<f32>(landed) + 0.5);
    for (var k = thread; k < job.candidates; k += THREADS) { scores[k] = score(judge, job.far + job.step * f32(k)); }
    workgroupBarrier();
    let best_back = best_score();
    if (!all_go_on(thread, best_back.x != MISSED)) { return; }
    let returned = back(judge, refine(thread, judge, job.far + job.step * best_back.y, best_back.x).x);
    // Where the pixel's centre itself would return to at the depth claimed: removes the rounding of `landed`.
    let p = point_of(views[judge].there, own_ray, w);
    let claimed = back(judge, w / max(p.z, 1e-3));
    let returns = returned.before && claimed.before && p.z > 1e-3 && length(claimed.center - returned.center) <= LEFT_RIGHT_PX;
    if (thread == 0u && returns) { found[item] = w; }
}
