// Direct light at lattice points. A workgroup is a point.

const LIT_ENOUGH = 0.3;
const OPENNESS_RAYS = 12u;

var<workgroup> buried: array<u32, OPENNESS_RAYS>;

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let i = params.first * params.points + group_number(id);
    let tile = min(i / params.points, params.count - 1u);
    let k = i % params.points;
    let job = jobs[tile];
    let is_point = i / params.points < params.count && k < point_count(job);
    let site = sites[sites_at(tile, k)];
    let is_there = is_point && site.is_there != 0u;
    let part = part_at(
        thread, site, tile * params.emitters, select(0u, job.candidates, is_there), params.rays, stream_of(job, k),
    );
    let all = reduce(thread, part.sum, part.lit);
    // Most points are lit, and so lie open.
    let is_dark = is_there && all[0].w < LIT_ENOUGH;
    if (thread < OPENNESS_RAYS) {
        buried[thread] = 0u;
        if (is_dark) {
            let u = vec2((f32(thread) + 0.5) / f32(OPENNESS_RAYS), fract(f32(thread) * 0.618034));
            let ray = half_line(start_of(site), frame_of(site.normal) * sample_cosine(u));
            let hit = closest_where(ray, 0.5, false);
            if (hit.triangle != NONE && buries(ray, hit, params.spacing_m[job.field].x)) { buried[thread] = 1u; }
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
