// Tables from the parts of their chunks, added up in order, and weighted where that makes a beam of them: one thread an entry.
@group(0) @binding(1) var<storage, read> parts: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read_write> tables: array<vec4<f32>>;

// Weights of two neighbouring lags, cosines and sines.
fn weight(entry: u32) -> vec4<f32> {
    let of_y = share(entry / QUADS / 2u, COLUMNS);
    let of_z = vec2(share(2u * (entry % QUADS), ROWS), share(2u * (entry % QUADS) + 1u, ROWS));
    return of_y * of_z.xxyy;
}

// Pairs of elements at a lag, twice for a lag that stands for both signs, as a share of all elements squared.
fn share(lag: u32, elements: u32) -> f32 {
    return select(2.0, 1.0, lag == 0u) * f32(elements - lag) / f32(elements * elements);
}

@compute @workgroup_size(64)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) t: u32) {
    let i = 64u * group_number(id) + t;
    let table = i / ENTRIES;
    if (table >= TABLES) { return; }
    let entry = i % ENTRIES;
    let chunks = (DIRECTIONS + CHUNK - 1u) / CHUNK;
    // Four sums at once: none waits for the memory that another waits for.
    var totals = mat4x4<f32>();
    var at = table * chunks * ENTRIES + entry;
    var c = 0u;
    for (; c + 4u <= chunks; c += 4u) {
        totals[0] += parts[at];
        totals[1] += parts[at + ENTRIES];
        totals[2] += parts[at + 2u * ENTRIES];
        totals[3] += parts[at + 3u * ENTRIES];
        at += 4u * ENTRIES;
    }
    for (; c < chunks; c++) {
        totals[0] += parts[at];
        at += ENTRIES;
    }
    tables[i] = WEIGHT * ((totals[0] + totals[1]) + (totals[2] + totals[3]));
}
