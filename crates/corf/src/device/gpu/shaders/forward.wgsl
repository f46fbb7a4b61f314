// cpu/blend.rs, Forward. A batch of splats, one a thread.
var<workgroup> batch_place: array<vec4<f32>, AREA>;
var<workgroup> batch_power: array<vec3<f32>, AREA>;
var<workgroup> batch_color: array<vec3<f32>, AREA>;
var<workgroup> batch_radio: array<vec4<f32>, RADIO_AREA>;
var<workgroup> batch_owner: array<u32, AREA>;
var<workgroup> open: atomic<u32>;
var<workgroup> any_open: u32;

// The splat of the largest weight so far.
struct Best { weight: f32, owner: u32 }

fn add_four(p: ptr<function, Pixel>, best: ptr<function, Best>, slot: u32, f: vec4<f32>) {
    let weights = vec4(add(p, slot, f.x), add(p, slot + 1u, f.y), add(p, slot + 2u, f.z), add(p, slot + 3u, f.w));
    if (MAIN_CONTRIBUTOR) {
        if (weights.x > (*best).weight) { *best = Best(weights.x, batch_owner[slot]); }
        if (weights.y > (*best).weight) { *best = Best(weights.y, batch_owner[slot + 1u]); }
        if (weights.z > (*best).weight) { *best = Best(weights.z, batch_owner[slot + 2u]); }
        if (weights.w > (*best).weight) { *best = Best(weights.w, batch_owner[slot + 3u]); }
    }
}

// Front to back.
@compute @workgroup_size(AREA)
fn main(@builtin(workgroup_id) id: vec3<u32>, @builtin(local_invocation_index) thread: u32) {
    let index = group_number(id);
    if (index >= params.tile_total) { return; }
    let tile = tile_of(index, thread);
    let centre = vec2<f32>(tile.pixel - tile.corner) + 0.5;
    let list = lists[index];
    var p = Pixel(vec2(select(0.0, 1.0, tile.inside)), vec4(0.0), vec4(0.0));
    if (!BOTH) { p.t.y = 0.0; }
    var best = Best(0.0, 0xffffffffu);
    // The next batch is fetched while one is drawn.
    var owner = 0u;
    var next = nothing();
    if (thread < list.count) {
        owner = entries[list.first + thread].x;
        next = drawn(owner, tile.corner);
    }
    var begin = 0u;
    for (; begin < list.count; begin += AREA) {
        if (thread == 0u) { atomicStore(&open, 0u); }
        workgroupBarrier();
        if (max(p.t.x, p.t.y) >= MIN_TRANSMITTANCE) { atomicStore(&open, 1u); }
        batch_place[thread] = next.place;
        batch_power[thread] = next.power;
        batch_color[thread] = next.color;
        if (BOTH) { batch_radio[thread] = next.radio; }
        if (MAIN_CONTRIBUTOR) { batch_owner[thread] = owner; }
        workgroupBarrier();
        if (thread == 0u) { any_open = atomicLoad(&open); }
        if (workgroupUniformLoad(&any_open) == 0u) { break; }
        next = nothing();
        if (begin + AREA + thread < list.count) {
            owner = entries[list.first + begin + AREA + thread].x;
            next = drawn(owner, tile.corner);
        }
        // In eights: their exponentials wait neither for each other nor for T. Beyond the end are splats of opacity 0.
        let count = min(AREA, list.count - begin);
        for (var slot = 0u; slot < count; slot += 8u) {
            if (KEEP && slot % BUCKET == 0u && begin + slot > 0u) {
                save(p, list.checkpoint + (begin + slot) / BUCKET - 1u, thread);
            }
            let a = falloffs(slot, centre);
            let b = falloffs(slot + 4u, centre);
            add_four(&p, &best, slot, a);
            add_four(&p, &best, slot + 4u, b);
        }
        workgroupBarrier();
    }
    if (KEEP && thread == 0u) { visited[index] = min(begin, list.count); }
    if (tile.inside) {
        finish(tile, p);
        if (MAIN_CONTRIBUTOR) {
            if (best.weight > 0.0) { best.owner = gaussian_of[best.owner]; }
            main_contributor[tile.at] = best.owner;
        }
    }
}
