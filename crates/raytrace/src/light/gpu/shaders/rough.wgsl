// cache/field.rs: the cells of a tile within which interpolation is likely to be poor; then the tile is there. A workgroup is a
// tile, a thread a cell.

const TOLERANCE = 0.01;
const CONTRAST = 0.3;

var<workgroup> level: array<f32, MOST_POINTS>;
var<workgroup> weight: array<f32, MOST_POINTS>;
var<workgroup> rough: array<atomic<u32>, 2>;

// Error of linear interpolation between a point and the next, by second differences along the points' own line.
fn bent(i: u32, along_line: u32, count: u32, step: u32) -> f32 {
    if (along_line == 0u || along_line + 1u >= count) { return 0.0; }
    return abs(level[i + step] - 2.0 * level[i] + level[i - step]) / 8.0;
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let tile = group_number(id);
    let job = jobs[min(tile, params.count - 1u)];
    let n = charts[job.chart].normal * select(1.0, -1.0, job.side == 1u);
    for (var k = thread; k < point_count(job); k += 64u) {
        let p = point_at(job.head, k);
        level[k] = luminance(received_at(p.received, n));
        weight[k] = p.weight;
    }
    if (thread < 2u) { atomicStore(&rough[thread], 0u); }
    workgroupBarrier();
    let x = thread % 8u;
    let y = thread / 8u;
    if (x < max(job.points.x - 1u, 1u) && y < max(job.points.y - 1u, 1u)) {
        var sum = 0.0;
        var least = INFINITE;
        var most = 0.0;
        var curve = 0.0;
        var doubtful = false;
        for (var k = 0u; k < 4u; k++) {
            let i = min(x + k % 2u, job.points.x - 1u);
            let j = min(y + k / 2u, job.points.y - 1u);
            let at = i + j * job.points.x;
            sum += level[at];
            least = min(least, level[at]);
            most = max(most, level[at]);
            curve = max(curve, max(bent(at, i, job.points.x, 1u), bent(at, j, job.points.y, job.points.x)));
            doubtful = doubtful || weight[at] < 1.0;
        }
        let mean = max(0.25 * sum, params.dark);
        if (curve > TOLERANCE * mean || doubtful || most - least > CONTRAST * mean) {
            atomicOr(&rough[thread / 32u], 1u << (thread % 32u));
        }
    }
    workgroupBarrier();
    if (thread == 0u && tile < params.count) {
        put(job.head, vec4(atomicLoad(&rough[0]), atomicLoad(&rough[1]), 0u, 0u));
        slots[job.slot] = job.head + FILLED;
    }
}
