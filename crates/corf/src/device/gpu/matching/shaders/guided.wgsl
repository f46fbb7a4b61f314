// depth/matching.rs, `match_pixel`: a workgroup is a pixel. In the search a thread has every sixteenth candidate and every second neighbour, in
// the refinement one neighbour at one of two inverse depths.

const LANES = 16u;
const HALVES = 2u;

// Neighbours that take part.
var<workgroup> useful: array<u32, THREADS>;
var<workgroup> useful_count: u32;
// Sums over a half of them, of each candidate.
var<workgroup> parts: array<f32, HALVES * MOST_CANDIDATES>;
var<workgroup> values: array<f32, 2u * THREADS>;
var<workgroup> goes_on: u32;

var<private> ray: vec3<f32>;
// The patch leans as the prior does, in proportion to the inverse depth tried.
var<private> lean: vec2<f32>;

fn at(n: u32, w: f32) -> Warp {
    return warp(views[n].there, views[0].image.focal, views[n].image, ray, w, lean * w);
}


// Scores of two inverse depths, all threads together.
fn pair(thread: u32, n: u32, low: f32, high: f32) -> vec2<f32> {
    for (var i = thread; i < 2u * n; i += THREADS) {
        let z = correlation(views[useful[i / 2u]].image, at(useful[i / 2u], select(low, high, i % 2u == 1u)));
        values[i] = select(z, 0.0, z == MISSED);
    }
    workgroupBarrier();
    var sum = vec2(0.0);
    for (var j = 0u; j < n; j++) { sum += vec2(values[2u * j], values[2u * j + 1u]); }
    workgroupBarrier();
    return sum / f32(n);
}

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let group = group_number(id);
    if (group >= job.count) { return; }
    let item = job.first + group;
    let start = starts[item];
    let is_patch = take_patch(thread, views[0].image, start.pixel);
    ray = ray_of(views[0].image, vec2<f32>(start.pixel) + 0.5);
    lean = start.slope / start.guess;
    let low = start.guess * (1.0 - job.range);
    let high = start.guess * (1.0 + job.range);
    var step = (high - low) / f32(job.candidates - 1u);

    // A neighbour takes part where both ends of the range land inside it, far enough apart, and all between them, which only a mask leaves out.
    if (thread < job.neighbours) {
        let n = 1u + thread;
        let image = views[n].image;
        let first = at(n, low);
        let last = at(n, high);
        var takes_part = is_patch && lands_inside(image, first) && lands_inside(image, last);
        takes_part = takes_part && length(first.center - last.center) > job.shortest_px;
        if (image.left_out_at != ALL_COUNT) {
            for (var k = 0u; k < job.candidates && takes_part; k++) { takes_part = lands_inside(image, at(n, low + step * f32(k))); }
        }
        values[thread] = select(0.0, 1.0, takes_part);
    }
    workgroupBarrier();
    if (thread == 0u) {
        var count = 0u;
        for (var j = 0u; j < job.neighbours; j++) {
            if (values[j] == 1.0) {
                useful[count] = 1u + j;
                count++;
            }
        }
        useful_count = count;
        found[item] = NONE;
    }
    let n = workgroupUniformLoad(&useful_count);
    if (n == 0u) { return; }

    let half = thread / LANES;
    for (var k = thread % LANES; k < job.candidates; k += LANES) {
        let w = low + step * f32(k);
        var sum = 0.0;
        for (var j = half; j < n; j += HALVES) {
            let z = correlation(views[useful[j]].image, at(useful[j], w));
            sum += select(z, 0.0, z == MISSED);
        }
        parts[HALVES * k + half] = sum;
    }
    workgroupBarrier();
    var best = 0u;
    var peak = MISSED;
    var worst = 1e9;
    for (var k = 0u; k < job.candidates; k++) {
        let score = (parts[HALVES * k] + parts[HALVES * k + 1u]) / f32(n);
        if (score >= peak) {
            best = k;
            peak = score;
        }
        worst = min(worst, score);
    }
    // At an end of the range the true minimum may lie outside.
    let inside = best > 0u && best < job.candidates - 1u;
    let passes = inside && peak >= job.min_zncc && 1.0 - worst > job.cost_ratio * (1.0 - peak);
    if (thread == 0u) { goes_on = select(0u, 1u, passes); }
    if (workgroupUniformLoad(&goes_on) == 0u) { return; }

    // Steps are halved towards the best correlation until they are short on the screen, then a parabola.
    var center = low + step * f32(best);
    for (var j = thread; j < n; j += THREADS) {
        let here = at(useful[j], center);
        let there = at(useful[j], center + step);
        values[j] = select(0.0, length(here.center - there.center), here.before && there.before);
    }
    workgroupBarrier();
    var step_px = 0.0;
    for (var j = 0u; j < n; j++) { step_px = max(step_px, values[j]); }
    for (var round = 0u; round < MOST_HALVINGS; round++) {
        workgroupBarrier();
        if (thread == 0u) { goes_on = select(0u, 1u, step_px > FINEST_STEP_PX); }
        if (workgroupUniformLoad(&goes_on) == 0u) { break; }
        step *= 0.5;
        step_px *= 0.5;
        let around = vec2(center - step, center + step);
        let scores = pair(thread, n, around.x, around.y);
        if (scores.x > peak) {
            center = around.x;
            peak = scores.x;
        }
        if (scores.y > peak) {
            center = around.y;
            peak = scores.y;
        }
    }
    let scores = pair(thread, n, center - step, center + step);
    if (thread == 0u) { found[item] = center + step * parabola_offset(scores.x, peak, scores.y); }
}
