// Σ w·h(y)h(z)ᵀ over a chunk of directions, with their harmonics h(x) = (1, 0, cos x, sin x, cos 2x, …): a workgroup takes a chunk of one list, a thread
// four neighbours of a row of the table. Chunks lie behind each other, to be added up in order.
const BATCH = 32u;
// One more, so that neither harmonics nor directions lie in one bank.
const PITCH = BATCH + 1u;

var<workgroup> of_y: array<Weight, 2u * COLUMNS * PITCH>;
var<workgroup> of_z: array<vec4<f32>, QUADS * PITCH>;

fn stage_y(at: u32, d: Direction) {
    let turn = sin_cos(d.phases.x).yx;
    var h = vec2(1.0, 0.0);
    for (var l = 0u; l < COLUMNS; l++) {
        of_y[2u * l * PITCH + at] = h.x * d.weight;
        of_y[(2u * l + 1u) * PITCH + at] = h.y * d.weight;
        h = turned(h, turn);
    }
}

fn stage_z(at: u32, d: Direction) {
    let turn = sin_cos(d.phases.y).yx;
    var h = vec2(1.0, 0.0);
    for (var q = 0u; q < QUADS; q++) {
        let next = turned(h, turn);
        of_z[q * PITCH + at] = vec4(h, next);
        h = turned(next, turn);
    }
}

@compute @workgroup_size(THREADS)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let count = directions();
    let chunks = (count + CHUNK - 1u) / CHUNK;
    let group = group_number(id);
    let list = group / chunks;
    // Rows of workgroups are filled up.
    if (list >= lists()) { return; }
    let first = group % chunks * CHUNK;
    let end = min(first + CHUNK, count);
    // Threads behind the last entry compute what nobody reads.
    let row = min(t / QUADS, 2u * COLUMNS - 1u) * PITCH;
    let quad = t % QUADS * PITCH;
    DECLARE
    for (var base = first; base < end; base += BATCH) {
        workgroupBarrier();
        if (t < 2u * BATCH) {
            let at = t % BATCH;
            let d = direction(list, min(base + at, end - 1u), base + at < end);
            if (t < BATCH) { stage_y(at, d); } else { stage_z(at, d); }
        }
        workgroupBarrier();
        for (var k = 0u; k < BATCH; k++) {
            let y = of_y[row + k];
            let z = of_z[quad + k];
            ADD
        }
    }
    if (t < ENTRIES) {
        STORE
    }
}
